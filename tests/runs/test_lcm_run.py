"""A run over LCM: in a process of its own, against a sender here; and what becomes of either's death."""

import gc
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from pydrake.common.yaml import yaml_dump_typed

from tactopose_drake.drivers.lcm_inbox import LcmConnection, open_lcm
from tactopose_drake.drivers.lcm_messages import HandSensesMessage, ObjectBeliefMessage, ObjectPoseMessage
from tactopose_drake.errors import BusError, InvalidFileError, InvalidInputError
from tactopose_drake.hand.hand_config import load_hand_config
from tactopose_drake.hand.hand_in_plant import make_hand_plant
from tactopose_drake.hand.named_joints import NamedJoints
from tactopose_drake.runs.scenario_run import run_scenario
from tactopose_drake.runs.stepping import RunView
from tactopose_drake.station.message_channels import LcmPublishing, LcmSenses
from tactopose_drake.station.scenario import Scenario, load_scenario
from tactopose_drake.systems.pose_tracking import PoseTrackingParams
from tests import held_cube

pytest.importorskip("lcm")


def scenario(url: str) -> Scenario:
    scenario = load_scenario("shadow_like")
    scenario.object = "cube"
    scenario.senses = LcmSenses(url=url, vision="VISION", max_age=0.3)
    scenario.publish = LcmPublishing(url=url)
    scenario.tracking = PoseTrackingParams(use_joint_velocities=False, use_hand_volume=False)
    return scenario


class Sender:
    """A hand that holds the cube, and hears what is believed."""

    def __init__(self, link: LcmConnection) -> None:
        self._link, self._generator = link, np.random.default_rng(0)
        self.sequence = 0
        self.got: list[ObjectBeliefMessage] = []
        link.subscribe("OBJECT_BELIEF", lambda _, data: self.got.append(ObjectBeliefMessage.decode(data)))

    def send(self, **changes: object) -> None:
        wrenches = {name: F_S + 1e-3 * self._generator.normal(size=6) for name, F_S in held_cube.WRENCHES.items()}
        message = HandSensesMessage(
            utime=round(1e6 * time.time()), sequence=self.sequence, joints=joints(), wrenches=wrenches
        )
        for name, value in changes.items():
            setattr(message, name, value)
        self.sequence += 1
        self._link.publish("HAND_SENSES", message.encode())

    def see(self) -> None:
        """Vision, once."""
        prior = held_cube.prior(1e-3 * self._generator.normal(size=3))
        wxyz = prior.X_PO.rotation().ToQuaternion().wxyz()
        covariance = np.diag(np.repeat([0.04, 4e-4], 3))
        message = ObjectPoseMessage(
            utime=round(1e6 * time.time()), position=prior.mean[:, 3], quaternion_wxyz=wxyz, covariance=covariance
        )
        self._link.publish("VISION", message.encode())

    def hear(self) -> None:
        while self._link.handle_timeout(1) > 0:
            pass

    def until(self, said: str, timeout: float = 120.0) -> ObjectBeliefMessage:
        """Sends 100 times a second until a belief says something; for "ok", and is right."""
        self.got.clear()
        end = time.monotonic() + timeout
        while time.monotonic() < end:
            self.see()
            self.send()
            time.sleep(0.01)
            self.hear()
            for belief in self.got:
                if said in belief.status and (said != "ok" or is_right(belief)):
                    return belief
        raise AssertionError(f"nobody says {said!r}; last said: {self.got[-1].status if self.got else 'nothing'}")

    def wait_for(self, said: str, timeout: float = 60.0) -> ObjectBeliefMessage:
        """Listens without sending."""
        self.got.clear()
        end = time.monotonic() + timeout
        while time.monotonic() < end:
            self.hear()
            for belief in self.got:
                if said in belief.status:
                    return belief
        raise AssertionError(f"nobody says {said!r}")


def is_right(belief: ObjectBeliefMessage) -> bool:
    return bool(np.linalg.norm(belief.position[0] - held_cube.X_PO[:, 3]) < 0.006)


def joints() -> dict[str, float]:
    if not _JOINTS:
        names = NamedJoints(*make_hand_plant(load_hand_config("shadow_like"))).names
        _JOINTS.update(zip(names, held_cube.Q.tolist(), strict=True))
    return dict(_JOINTS)


_JOINTS: dict[str, float] = {}


def start(file: Path) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-c", "from tactopose_drake.cli.entry import start; start()", "run", str(file)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE)


@pytest.fixture
def url() -> str:
    """On this machine alone, and of this test alone."""
    url = f"udpm://239.255.76.67:{20000 + os.getpid() % 20000}?ttl=0"
    try:
        link = open_lcm(url)
    except BusError as error:
        pytest.skip(f"there is no multicast here: {error}")
    heard: list[bytes] = []
    link.subscribe("SELF", lambda _, data: heard.append(data))
    link.publish("SELF", b"")
    if not link.handle_timeout(1000):
        pytest.skip("multicast does not come back to this machine")
    return url


@pytest.fixture
def file(url: str, tmp_path: Path) -> Path:
    path = tmp_path / "lcm.scenario.yaml"
    path.write_text(yaml_dump_typed(scenario(url)))
    return path


@pytest.fixture
def estimator(file: Path) -> Iterator[subprocess.Popen[bytes]]:
    process = start(file)
    yield process
    process.kill()
    process.communicate()


def test_two_processes_and_the_death_of_either(url: str, file: Path, estimator: subprocess.Popen[bytes]) -> None:
    sender = Sender(open_lcm(url))
    first = sender.until("ok")
    np.testing.assert_allclose(np.linalg.norm(first.quaternion_wxyz, axis=1), 1.0)

    # 200 a second for a second: each is received or said to be lost, whatever of them a belief was made of.
    before, until = sender.got[-1], sender.sequence + 200
    while sender.sequence < until:
        sender.send()
        time.sleep(0.005)
    last = sender.until("ok")
    while last.sequence < until:
        last = sender.until("ok")
    accounted = last.received + last.lost - before.received - before.lost
    assert accounted == last.sequence - before.sequence
    assert last.session == before.session

    # The sender dies, and comes back with a counter of its own.
    silent = sender.wait_for("lost: no senses for ")
    assert silent.sequence == sender.sequence - 1
    sender = Sender(open_lcm(url))
    back = sender.until("the senses' sender began anew")
    assert "the senses are back after" in back.status

    # The estimator is killed, and started again.
    estimator.send_signal(signal.SIGKILL)
    estimator.wait()
    again = start(file)
    try:
        found = sender.until("ok")
        assert found.session != last.session
        assert found.received <= found.sequence
        again.send_signal(signal.SIGINT)
        out, error = again.communicate(timeout=120)
        assert again.returncode == 0, error
        assert b"object at" in out
    finally:
        again.kill()
        again.communicate()


class Duet:
    """A run in a thread, and a sender beside it, on one connection each."""

    def __init__(self, url: str, duration: float) -> None:
        self.views: list[float] = []
        gc.collect()  # A Meshcat that earlier tests have left must end on this thread.
        self.thread = threading.Thread(target=self._run, args=(scenario(url), duration))
        self.thread.start()

    def _run(self, scenario: Scenario, duration: float) -> None:
        self.end = run_scenario(scenario, duration=duration, observer=self._observe)

    def _observe(self, view: RunView) -> None:
        self.views.append(view.time)


def test_what_does_not_fit_is_said_and_the_rest_goes_on(url: str) -> None:
    duet, sender = Duet(url, 8.0), Sender(open_lcm(url))
    sender.until("ok")
    wrenches = {**held_cube.WRENCHES, "pinky": np.zeros(6), "thumb": np.full(6, np.nan)}
    sender.send(wrenches=wrenches, joints={**joints(), "elbow": 1.0}, pressures={"palm": np.zeros(3)})
    said = sender.wait_for("pinky").status
    for text in ("no joint 'elbow'", "no finger 'pinky'", "no pad 'palm'", "thumb: the wrench is not finite"):
        assert text in said
    for covariance, quaternion, text in (
        (np.zeros((6, 6)), np.eye(4)[0], "vision: covariance must have standard deviations of at least 1e-07, not 0"),
        (np.eye(6), np.zeros(4), "vision: its quaternion has the length 0"),
    ):
        message = ObjectPoseMessage(utime=1, covariance=covariance, quaternion_wxyz=quaternion)
        sender._link.publish("VISION", message.encode())
        sender.send()
        sender.wait_for(text)
    sender._link.publish("HAND_SENSES", b"nonsense")
    sender.wait_for("must be a lcmt_hand_senses of this version")
    sender.send(utime=-5)
    assert sender.wait_for("lost: time must be a number >= 0, not -5e-06").sequence == -1
    sender.send(utime=5)
    sender.wait_for("begun anew: the clock went back")
    sender.until("ok")
    duet.thread.join()
    assert len(duet.views) > 5
    assert duet.views == sorted(duet.views)  # whatever the sender's clock says
    assert 0.0 < duet.views[0] < duet.views[-1] <= duet.end.time < 60.0
    assert duet.end.diagram.GetOutputPort("hypotheses").Eval(duet.end.context) is not None


def test_a_simulated_run_publishes_too(url: str) -> None:
    hears = Sender(open_lcm(url))
    made = load_scenario("barrett_like")
    made.publish = LcmPublishing(url=url, max_modes=1)
    made.estimation.use_hand_volume = made.estimation.check_collisions = False
    made.estimation.estimator.period = 0.02
    run_scenario(made, duration=0.06)
    hears.hear()
    assert [belief.utime for belief in hears.got] == [0, 20_000, 40_000]  # each of the touch a period before
    assert all(belief.status for belief in hears.got)
    assert all(len(belief.probability) <= 1 for belief in hears.got)


def test_a_late_belief_is_dated_when_its_senses_were(url: str) -> None:
    hears = Sender(open_lcm(url))
    made = load_scenario("barrett_like")
    made.publish = LcmPublishing(url=url)
    made.estimation.use_hand_volume = made.estimation.check_collisions = False
    made.estimation.estimator.period = 0.02
    made.tracking = PoseTrackingParams(use_hand_volume=False)
    made.tracking.belief.period, made.tracking.belief.latency = 0.02, 0.03
    times: list[float] = []
    run_scenario(made, duration=0.1, observer=lambda view: times.append(view.context.get_time()))
    hears.hear()
    assert len(times) == len(hears.got) == 5
    late = [round(1e6 * moment) - belief.utime for moment, belief in zip(times, hears.got, strict=True)]
    assert late[2:] == [40_000] * 3, late


def test_what_cannot_be_run_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidInputError, match="lcm-logger"):
        run_scenario(scenario("memq://"), record=tmp_path / "recording")
    for change, message in (
        ("senses: !LcmSenses {}", "LcmSenses.url must be LCM's, .*, not empty"),
        ("senses: !LcmSenses {url: 'memq://', channel: ''}", "LcmSenses.channel must be a text, not empty"),
        ("senses: !LcmSenses {url: 'memq://', max_age: 0.0}", "LcmSenses.max_age must be .*, not 0"),
        (
            "senses: !LcmSenses {url: 'memq://', channel: X, vision: X}",
            r"LcmSenses\.vision must be another channel than LcmSenses\.channel, but both are 'X'",
        ),
        (
            "senses: !LcmSenses {url: 'memq://', channel: X}\npublish: {url: 'memq://', channel: X}",
            r"LcmPublishing\.channel must be another channel than LcmSenses\.channel, but both are 'X'",
        ),
        ("publish: {url: 'memq://', max_modes: 0}", "LcmPublishing.max_modes must be .*, not 0"),
        ("publish: {max_modes: 3}", "LcmPublishing.url must be LCM's, .*, not empty"),
    ):
        path = tmp_path / "wrong.scenario.yaml"
        path.write_text(f"hand: shadow_like\n{change}\n")
        with pytest.raises(InvalidFileError, match=message):
            load_scenario(path)
