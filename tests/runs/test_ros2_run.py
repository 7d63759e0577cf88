"""A run over ROS 2's messages: in a process of its own, against a hand here, on this machine alone."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydrake.common.yaml import yaml_dump_typed

from tactopose_drake.core.poses import random_rotations
from tactopose_drake.drivers.ros2_link import Ros2Link, stamp_of
from tactopose_drake.errors import InvalidFileError, InvalidInputError
from tactopose_drake.hand.hand_config import load_hand_config
from tactopose_drake.hand.hand_in_plant import make_hand_plant
from tactopose_drake.hand.named_joints import NamedJoints
from tactopose_drake.runs.ros2_inbox import Ros2Inbox
from tactopose_drake.runs.ros2_poses import increment_covariance, ros_covariance, ros_pose
from tactopose_drake.runs.scenario_run import run_scenario
from tactopose_drake.station.message_channels import Ros2Publishing, Ros2Senses
from tactopose_drake.station.scenario import Scenario, load_scenario
from tactopose_drake.systems.pose_tracking import PoseTrackingParams
from tests import held_cube

pytest.importorskip("cyclonedds")
DOMAIN = 10 + os.getpid() % 80  # of this test alone


def scenario() -> Scenario:
    scenario = load_scenario("shadow_like")
    scenario.object = "cube"
    wrenches = {finger: f"/hand/wrench/{finger}" for finger in held_cube.WRENCHES}
    scenario.senses = Ros2Senses(domain=DOMAIN, wrenches=wrenches, vision="/camera/object_pose", max_age=0.3)
    scenario.publish = Ros2Publishing(domain=DOMAIN, max_modes=3)
    scenario.tracking = PoseTrackingParams(use_joint_velocities=False, use_hand_volume=False)
    return scenario


class Hand:
    """Holds the cube, and hears what is believed."""

    def __init__(self) -> None:
        self._generator = np.random.default_rng(0)
        self.link = Ros2Link(DOMAIN)
        self._joints = self.link.publisher("/joint_states", "sensor_msgs/JointState")
        self._vision = self.link.publisher("/camera/object_pose", "geometry_msgs/PoseWithCovarianceStamped")
        self._wrenches = {
            finger: self.link.publisher(f"/hand/wrench/{finger}", "geometry_msgs/WrenchStamped")
            for finger in held_cube.WRENCHES
        }
        self.names = NamedJoints(*make_hand_plant(load_hand_config("shadow_like"))).names
        self.heard: dict[str, list[Any]] = {"pose": [], "markers": [], "status": []}
        for name, kind in (
            ("pose", "geometry_msgs/PoseWithCovarianceStamped"),
            ("markers", "visualization_msgs/MarkerArray"),
            ("status", "std_msgs/String"),
        ):
            self.link.subscribe(f"/object_{name}", kind, self.heard[name].append)

    def header(self) -> dict[str, Any]:
        return {"stamp": stamp_of(time.time()), "frame_id": "palm"}

    def feel(self, **joints: Any) -> None:
        for finger, F_S in held_cube.WRENCHES.items():
            m_x, m_y, m_z, f_x, f_y, f_z = (F_S + 1e-3 * self._generator.normal(size=6)).tolist()
            wrench = {"force": {"x": f_x, "y": f_y, "z": f_z}, "torque": {"x": m_x, "y": m_y, "z": m_z}}
            self._wrenches[finger]({"header": self.header(), "wrench": wrench})
        self._joints({"header": self.header(), "name": self.names, "position": held_cube.Q, **joints})

    def see(self) -> None:
        prior = held_cube.prior(1e-3 * self._generator.normal(size=3))
        covariance = np.diag(np.repeat([4e-4, 0.04], 3)).reshape(-1)
        pose = {"pose": ros_pose(prior.X_PO), "covariance": covariance}
        self._vision({"header": self.header(), "pose": pose})

    def until(self, said: str, speaks: bool = True, timeout: float = 60.0) -> str:
        """Until a status says something; for "ok", until a pose is right."""
        for heard in self.heard.values():
            heard.clear()
        end = time.monotonic() + timeout
        while time.monotonic() < end:
            if speaks:
                self.see()
                self.feel()
            self.link.wait(0.01)
            found = [status.data for status in self.heard["status"] if said in status.data]
            if found and (said != "ok" or self.is_right()):
                return found[-1]
        statuses = self.heard["status"]
        raise AssertionError(f"nobody says {said!r}; last said: {statuses[-1].data if statuses else 'nothing'}")

    def is_right(self) -> bool:
        places = [message.pose.pose.position for message in self.heard["pose"][-1:]]
        return any(np.linalg.norm(np.array([p.x, p.y, p.z]) - held_cube.X_PO[:, 3]) < 0.006 for p in places)


@pytest.fixture
def estimator(tmp_path: Path) -> Iterator[subprocess.Popen[bytes]]:
    path = tmp_path / "ros2.scenario.yaml"
    path.write_text(yaml_dump_typed(scenario()))
    command = [sys.executable, "-c", "from tactopose_drake.cli.entry import start; start()", "run", str(path)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    yield process
    process.kill()
    process.communicate()


def test_two_processes(estimator: subprocess.Popen[bytes]) -> None:
    hand = Hand()
    hand.until("ok")
    pose, markers = hand.heard["pose"][-1], hand.heard["markers"][-1].markers
    assert pose.header.frame_id == "palm"
    assert abs(time.time() - pose.header.stamp.sec) < 60.0
    covariance = np.reshape(pose.pose.covariance, (6, 6))
    assert np.linalg.eigvalsh(covariance)[0] > 0.0
    assert np.sqrt(covariance[0, 0]) < 0.01  # of the position, m, which comes first
    assert [marker.id for marker in markers] == [0, 1, 2]
    assert markers[0].mesh_resource.startswith("file:///")
    assert markers[0].mesh_resource.endswith("cube.obj")
    assert markers[0].action == 0
    # The hand falls silent, comes back, and says something wrong.
    hand.until("lost: no senses for ", speaks=False)
    assert "the senses are back after" in hand.until("the senses are back")
    # A joint state may be of the whole robot.
    for heard in hand.heard.values():
        heard.clear()
    hand.feel(name=[*hand.names, "elbow"], position=np.append(held_cube.Q, 0.0))
    assert "elbow" not in hand.until("", speaks=False)
    hand.feel(name=hand.names[:3])
    hand.until("a joint state has 3 names and 24 positions", speaks=True)
    estimator.send_signal(signal.SIGINT)
    out, error = estimator.communicate(timeout=60)
    assert estimator.returncode == 0, error
    assert b"object at" in out


class Beside:
    """Stands in for a link: what is subscribed is called by hand."""

    def __init__(self) -> None:
        self.handlers: dict[str, Any] = {}
        self.damaged: list[str] = []

    def subscribe(self, topic: str, kind: str, handler: Any) -> None:
        self.handlers[topic] = handler

    def say(self, topic: str, kind: str, value: dict[str, Any]) -> None:
        from tactopose_drake.drivers.ros2_link import message_of

        self.handlers[topic](message_of(kind, value))


def test_each_joint_state_goes_with_the_newest_of_the_rest() -> None:
    link = Beside()
    senses = Ros2Senses(wrenches={"thumb": "/thumb"}, pressures={"palm": "/palm"}, vision="/seen", max_age=0.1)
    inbox = Ros2Inbox(link, senses)  # type: ignore[arg-type]

    def joints(seconds: float, value: float) -> None:
        state = {"header": {"stamp": stamp_of(seconds)}, "name": ["a"], "position": [value]}
        link.say("/joint_states", "sensor_msgs/JointState", state)

    def wrench(seconds: float, value: float) -> None:
        said = {"header": {"stamp": stamp_of(seconds)}, "wrench": {"force": {"y": value}, "torque": {"x": 1.0}}}
        link.say("/thumb", "geometry_msgs/WrenchStamped", said)

    assert inbox.take() is None
    link.say("/palm", "std_msgs/Float64MultiArray", {"data": [1.0, 2.0]})
    joints(5.0, 0.1)
    said = inbox.take()
    assert said is not None
    assert not said.pressures  # Nobody knows how old a frame is that came before the first joint state.
    wrench(5.01, 2.0)
    wrench(5.0, 7.0)  # overtaken
    link.say("/palm", "std_msgs/Float64MultiArray", {"data": [1.0, 2.0]})
    joints(5.02, 0.2)
    said = inbox.take()
    assert said is not None
    assert (said.utime, said.sequence, said.joints) == (5_020_000, 1, {"a": 0.2})
    np.testing.assert_array_equal(said.wrenches["thumb"], [1.0, 0.0, 0.0, 0.0, 2.0, 0.0])
    np.testing.assert_array_equal(said.pressures["palm"], [1.0, 2.0])
    assert inbox.take() is None
    assert (inbox.received, inbox.passed_over) == (2, 0)
    # What is old counts no more; nor does anything from before the sender's clock began anew.
    joints(5.2, 0.3)
    said = inbox.take()
    assert said is not None
    assert not said.wrenches
    assert not said.pressures
    assert inbox.take_remarks() == (
        "thumb: the wrench is 0.19 s older than the joint state",
        "palm: the pressures are 0.20 s older than the joint state",
    )
    # Nor does what is of the future, which would be fresh for long.
    wrench(8.2, 2.0)
    joints(5.22, 0.3)
    said = inbox.take()
    assert said is not None
    assert not said.wrenches
    assert inbox.take_remarks()[0] == "thumb: the wrench is 2.98 s newer than the joint state"
    wrench(5.2, 2.0)
    joints(1.0, 0.3)
    said = inbox.take()
    assert said is not None
    assert not said.wrenches
    link.damaged = ["/thumb", "/thumb"]
    assert inbox.take_remarks() == ("the senses' sender began anew", "a message on /thumb is damaged")
    assert inbox.take_remarks() == ()
    # A picture waits for the senses of its time.
    seen = {"header": {"stamp": stamp_of(1.2)}, "pose": {"pose": {"orientation": {"w": 1.0}}}}
    link.say("/seen", "geometry_msgs/PoseWithCovarianceStamped", seen)
    assert inbox.take_vision(1_100_000) is None
    assert inbox.take_vision(1_300_000) is not None
    assert inbox.take_vision(1_300_000) is None
    seen["pose"] = {}
    link.say("/seen", "geometry_msgs/PoseWithCovarianceStamped", seen)
    assert inbox.take_vision(1_300_000) is None
    assert inbox.take_remarks() == ("vision: its quaternion is 0",)


def test_joint_states_of_parts_of_a_hand_make_one() -> None:
    link = Beside()
    inbox = Ros2Inbox(link, Ros2Senses(wrenches={"thumb": "/thumb"}, max_age=0.1), {"a", "b", "c"})  # type: ignore[arg-type]

    def said(seconds: float, **joints: float) -> dict[str, float] | None:
        state = {"header": {"stamp": stamp_of(seconds)}, "name": list(joints), "position": list(joints.values())}
        link.say("/joint_states", "sensor_msgs/JointState", state)
        senses = inbox.take()
        return None if senses is None else {"time": 1e-6 * senses.utime} | dict(senses.joints)

    assert said(5.0, a=0.1) == {"time": 5.0, "a": 0.1}
    assert said(5.01, b=0.2, c=0.3) == {"time": 5.01, "a": 0.1, "b": 0.2, "c": 0.3}
    # Another part's may be a little older; only one that is older than these joints' own was overtaken.
    assert said(5.005, a=0.4) == {"time": 5.01, "a": 0.4, "b": 0.2, "c": 0.3}
    assert said(5.001, a=0.5) is None
    assert said(5.06, elbow=1.0) is None
    assert said(5.06, a=0.5, elbow=1.0) == {"time": 5.06, "a": 0.5, "b": 0.2, "c": 0.3}
    assert (inbox.received, inbox.passed_over, inbox.take_remarks()) == (5, 1, ())
    # A part that falls silent is not known any more, and that is said once.
    assert said(5.12, a=0.6) == {"time": 5.12, "a": 0.6}
    assert inbox.take_remarks() == ("b, c: of a joint state 0.11 s older than the newest",)
    assert said(5.13, a=0.6) == {"time": 5.13, "a": 0.6}
    assert said(5.14, b=0.7) == {"time": 5.14, "a": 0.6, "b": 0.7}
    assert inbox.take_remarks() == ()
    # Where a sender's clock begins anew, nothing from before counts.
    assert said(1.0, b=0.8) == {"time": 1.0, "b": 0.8}
    assert inbox.take_remarks() == ("the senses' sender began anew",)
    # Two parts at a time are one message; what a newer state of the same joints replaces is passed over.
    for seconds, name in ((1.01, "a"), (1.02, "b"), (1.03, "a")):
        state = {"header": {"stamp": stamp_of(seconds)}, "name": [name], "position": [seconds]}
        link.say("/joint_states", "sensor_msgs/JointState", state)
    senses = inbox.take()
    assert senses is not None
    assert (senses.utime, dict(senses.joints)) == (1_030_000, {"a": 1.03, "b": 1.02})
    assert (inbox.passed_over, inbox.take()) == (2, None)
    # A part that was silent for long, and whose clock begins anew, is heard again.
    assert said(2.0, a=0.1) == {"time": 2.0, "a": 0.1}
    assert said(0.01, b=0.2) == {"time": 0.01, "b": 0.2}
    assert inbox.take_remarks()[-1] == "the senses' sender began anew"


def test_covariances_are_turned_as_ros_has_them() -> None:
    generator = np.random.default_rng(0)
    R_PO = random_rotations(generator, 1)[0]
    spread = generator.normal(size=(6, 6))
    covariance = spread @ spread.T
    of_ros = ros_covariance(covariance, R_PO)
    np.testing.assert_allclose(increment_covariance(of_ros, R_PO), covariance, atol=1e-12)
    # A standard deviation of a turn about the object's x axis is one about where that axis is in the palm.
    turned = ros_covariance(np.diag([1.0, 0, 0, 0, 0, 0]), R_PO).reshape(6, 6)
    np.testing.assert_allclose(turned[3:, 3:], np.outer(R_PO[:, 0], R_PO[:, 0]), atol=1e-12)
    assert not turned[:3].any()


def test_what_cannot_be_run_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidInputError, match="ros2 bag record"):
        run_scenario(scenario(), record=tmp_path / "recording")
    for change, message in (
        ("senses: !Ros2Senses {joints: joint_states}", r"Ros2Senses\.joints must be a topic .*, not 'joint_states'"),
        ("senses: !Ros2Senses {domain: 300}", "Ros2Senses.domain must be .*, not 300"),
        ("senses: !Ros2Senses {wrenches: {toe: /toe}}", "Ros2Senses.wrenches.*'toe'"),
        ("senses: !Ros2Senses {max_age: 0.0}", "Ros2Senses.max_age must be .*, not 0"),
        ("senses: !Ros2Senses {}", "Ros2Senses must have wrenches, pressures or both, but has neither"),
        (
            "senses: !Ros2Senses {wrenches: {thumb: /a, first: /a}}",
            r"wrenches\[first\] must be another topic than Ros2Senses\.wrenches\[thumb\], but both are '/a'",
        ),
        (
            "senses: !Ros2Senses {wrenches: {thumb: /a}, joints: /a}",
            r"Ros2Senses\.wrenches\[thumb\] must be another topic than Ros2Senses\.joints, but both are '/a'",
        ),
        (
            "publish: !Ros2Publishing {pose: /a, markers: /a}",
            r"Ros2Publishing\.markers must be another topic than Ros2Publishing\.pose, but both are '/a'",
        ),
        (
            "senses: !Ros2Senses {wrenches: {thumb: /a}, vision: /b}\npublish: !Ros2Publishing {pose: /b}",
            r"Ros2Publishing\.pose must be another topic than Ros2Senses\.vision, but both are '/b'",
        ),
        ("publish: !Ros2Publishing {max_modes: 0}", "Ros2Publishing.max_modes must be .*, not 0"),
        ("publish: !Ros2Publishing {status: ''}", r"Ros2Publishing\.status must be a topic .*, not ''"),
    ):
        path = tmp_path / "wrong.scenario.yaml"
        path.write_text(f"hand: shadow_like\n{change}\n")
        with pytest.raises(InvalidFileError, match=message):
            load_scenario(path)


def test_joint_states_of_another_part_or_that_were_overtaken_are_passed_over() -> None:
    link = Beside()
    inbox = Ros2Inbox(link, Ros2Senses(wrenches={"thumb": "/thumb"}), ("a", "b"))  # type: ignore[arg-type]

    def joints(seconds: float, name: str) -> None:
        state = {"header": {"stamp": stamp_of(seconds)}, "name": [name], "position": [seconds]}
        link.say("/joint_states", "sensor_msgs/JointState", state)

    joints(5.0, "a")
    joints(5.004, "arm_1")
    joints(4.996, "a")
    said = inbox.take()
    assert said is not None
    assert said.joints == {"a": 5.0}
    assert (inbox.received, inbox.passed_over) == (2, 1)
    assert inbox.take_remarks() == ()


def test_a_joint_state_that_names_a_joint_of_the_hand_twice_is_left_out() -> None:
    link = Beside()
    inbox = Ros2Inbox(link, Ros2Senses(wrenches={"thumb": "/thumb"}), ("a", "b"))  # type: ignore[arg-type]

    def joints(seconds: float, names: list[str]) -> None:
        state = {"header": {"stamp": stamp_of(seconds)}, "name": names, "position": [0.1, 0.9, 0.2][: len(names)]}
        link.say("/joint_states", "sensor_msgs/JointState", state)

    joints(5.0, ["a", "a", "b"])
    assert inbox.take() is None
    assert inbox.take_remarks() == ("a joint state names a twice",)
    joints(5.1, ["arm", "arm", "b"])  # What is of the arm counts for nothing.
    said = inbox.take()
    assert said is not None
    assert said.joints == {"b": 0.2}
    assert inbox.take_remarks() == ()
