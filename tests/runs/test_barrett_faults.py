"""Every fault of Barrett's hand, while the estimate runs: what is said, what goes on, and that it recovers."""

import re

import numpy as np
import pytest

from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.drivers.barrett_protocol import Puck
from tactopose_drake.drivers.barrett_tactile import PASCALS_PER_RAW
from tactopose_drake.drivers.frames import data_frame
from tactopose_drake.drivers.simulation import faults
from tactopose_drake.drivers.simulation.faults import Fault, Reply
from tactopose_drake.errors import DeviceError
from tactopose_drake.systems.pose_tracking import PoseTrackingParams
from tests import held_can
from tests.runs.stations import Running, pads_running

PADS = ("finger_1", "finger_2", "finger_3", "palm")


def assert_all_is_well(running: Running) -> None:
    assert running.value("sense_status") == "ok"
    assert len(running.value("patches")) == 4
    assert running.value("status").split(":")[0] in ("ok", "ambiguous")
    for row, pad in enumerate(PADS):
        off = np.abs(running.value(f"pressures_{pad}") - held_can.PRESSURES[row])
        assert off.max() < PASCALS_PER_RAW
    assert np.isfinite(running.value("joint_positions")).all()
    assert is_near(running)


def is_near(running: Running) -> bool:
    return bool(np.linalg.norm(running.value("object_pose").translation() - held_can.X_PO[:, 3]) < 0.012)


def is_of(group: int, reply: Reply) -> bool:
    return reply.frame.arbitration_id & 0x1F == group


def of_frames(group: int, fault: Fault) -> Fault:
    """A fault of the answers that have frames of one group, such as 9, the full tactile readings."""

    def chosen(request, replies: list[Reply]) -> list[Reply]:
        return fault(request, replies) if any(is_of(group, reply) for reply in replies) else replies

    return chosen


def wrong_sequence(_, replies: list[Reply]) -> list[Reply]:
    """The third frame of each reading says that it is the fifth."""
    return [
        Reply(
            reply.delay,
            data_frame(
                reply.frame.arbitration_id, bytes([0x40 | reply.frame.data[0] & 0xF]) + bytes(reply.frame.data[1:])
            ),
        )
        if reply.frame.data[0] >> 4 == 2
        else reply
        for reply in replies
    ]


def cut_readings(_, replies: list[Reply]) -> list[Reply]:
    """The last frame of each reading is lost."""
    return [reply for reply in replies if not is_of(9, reply) or reply.frame.data[0] >> 4 != 4]


# The fault, what the status says, and whether the joints are known meanwhile. (Where an answer is missing, the hand is
# searched from time to time, for which its samples pause.)
FAULTS = {
    "silence": (faults.silence, "stale: ", False),
    "late replies": (faults.late(0.3), "stale: ", False),
    "short readings": (cut_readings, "F1: no pressures", None),
    "extra frames": (faults.extra_frames, "F1: tactile frame", True),
    "wrong length": (of_frames(9, faults.wrong_length(5)), "F1: tactile frame must have 8 bytes, not 5", True),
    "wrong sequence numbers": (of_frames(9, wrong_sequence), "must have the sequence number 2", True),
    "out of order": (of_frames(9, faults.out_of_order), "F1: tactile frame must have the sequence number", True),
    "duplicates": (of_frames(9, faults.duplicates), "F1: tactile frame must have the sequence number", True),
}
SPARED = {"own frames come back": faults.own_frame_echo, "error frames": faults.error_frames}


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_of_the_hand_holds_the_estimate_until_it_clears(can: ObjectModel, name: str) -> None:
    fault, status, joints_are_known = FAULTS[name]
    with pads_running(can) as running:
        running.run(0.4)
        assert_all_is_well(running)
        pose = running.value("object_pose").GetAsMatrix34()
        running.rig["hand"].faults = [fault]
        running.run(0.6)
        assert running.value("sense_status").startswith("hand: ")
        assert status in running.value("status_hand")
        for pad in PADS:
            assert np.isnan(running.value(f"pressures_{pad}")).all()
        if joints_are_known is not None:
            assert np.isfinite(running.value("joint_positions")).all() == joints_are_known
        assert running.value("status").startswith("held: 0 touches; 2 are needed")
        np.testing.assert_array_equal(running.value("object_pose").GetAsMatrix34(), pose)
        running.rig["hand"].faults = []
        running.run(2.2)
        assert_all_is_well(running)


@pytest.mark.parametrize("name", SPARED)
def test_a_fault_that_spoils_nothing_changes_nothing(can: ObjectModel, name: str) -> None:
    with pads_running(can) as running:
        running.rig["hand"].faults = [SPARED[name]]
        running.run(0.8)
        assert_all_is_well(running)
        assert (running.bus.error_frames > 0) == (name == "error frames")


def test_a_silent_finger_leaves_the_other_pads(can: ObjectModel) -> None:
    with pads_running(can) as running:
        running.run(0.4)
        running.rig["hand"].absent = {Puck.F2}
        running.run(1.0)
        assert running.value("sense_status").startswith("hand: F2: no position")
        assert np.isnan(running.value("pressures_finger_2")).all()
        assert len(running.value("patches")) == 3
        assert running.value("patch_status") == "finger_2: a joint position is not known"
        before = running.value("hypotheses").duration
        running.run(0.4)
        assert running.value("hypotheses").duration != before, "the estimate goes on"
        assert running.value("status").split(":")[0] in ("ok", "ambiguous")
        assert is_near(running)
        running.rig["hand"].absent = set()
        running.run(3.0)
        assert_all_is_well(running)


def test_frames_that_grow_old_before_the_hand_is_given_up_count_for_nothing(can: ObjectModel) -> None:
    """In the estimate and in the belief, whose pads say from which age on."""
    scenario = held_can.scenario()
    scenario.senses.barrett_hand.max_age = 60.0
    scenario.tracking = PoseTrackingParams(use_hand_volume=False)
    scenario.estimation.patches.max_age = scenario.tracking.patches.max_age = 0.1
    with pads_running(can, scenario) as running:
        running.run(0.4)
        assert_all_is_well(running)
        assert running.value("tracked_status").split(":")[0] in ("ok", "ambiguous")
        running.unplug(True)
        running.run(0.6)
        assert all(np.isfinite(running.value(f"pressures_{pad}")).all() for pad in PADS), "the frame is still there"
        assert running.value("patches") == ()
        stale = r"finger_1: stale: 0.\d\d s old; .*; palm: stale: 0.\d\d s old$"
        assert re.match(rf"held: 0 touches; 2 are needed; {stale}", running.value("status"))
        assert re.match(rf"no_contact: .*{stale}", running.value("tracked_status"))
        assert running.value("tracked_hypotheses").status == "no_solution"
        assert running.value("tracked_belief").touch_time < 0.6
        running.unplug(False)
        running.run(3.5)
        assert_all_is_well(running)
        assert running.value("tracked_status").split(":")[0] in ("ok", "ambiguous", "slipping")


def test_a_reboot_in_mid_stream_is_noticed_and_the_hand_woken_again(can: ObjectModel) -> None:
    with pads_running(can) as running:
        running.run(0.4)
        running.rig["hand"].reboot(0.3)
        running.run(0.7)
        assert running.value("status_hand").startswith("stale: ")
        assert running.value("status").startswith("held: 0 touches")
        running.run(4.0)
        assert "F1: position counts from where the puck restarted" in running.value("sense_status")
        assert np.isnan(running.value("joint_positions")).all()
        assert running.value("status").startswith("held: 1 touch; 2 are needed")  # the palm's needs no joint
        assert running.rig["hand"].moves == []
        for puck in Puck:
            running.devices.hand.initialize(puck)
        running.run(0.6)
        assert_all_is_well(running)


def test_a_finger_that_is_not_tared_is_an_error_before_the_start(can: ObjectModel) -> None:
    with pads_running(can) as running:
        running.devices.tare(1)
        running.rig["hand"].absent = {Puck.F1}
        with pytest.raises(DeviceError, match="Barrett hand cannot be tared; silent, or failed, are the arrays of F1"):
            running.devices.tare(1)


@pytest.mark.parametrize("name", ["bus-off", "adapter is gone"])
def test_a_bus_that_fails_holds_the_estimate_until_it_is_back(can: ObjectModel, name: str) -> None:
    with pads_running(can) as running:
        running.run(0.4)
        running.rig["hand"].faults = [faults.bus_off] if name == "bus-off" else []
        running.unplug(name == "adapter is gone")
        running.run(1.0)
        assert running.value("status_hand").startswith("stale: ")
        assert re.search("bus (failed|cannot be opened|is off) ", running.value("status_hand"))
        assert running.value("status").startswith("held: 0 touches")
        running.rig["hand"].faults = []
        running.unplug(False)
        running.run(3.5)
        assert_all_is_well(running)
