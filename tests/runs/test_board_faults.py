"""Every fault of a force-torque board, while the estimate runs: what is said, what goes on, and that it recovers."""

import numpy as np
import pytest

from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.drivers.netcanoem_protocol import StatusBit
from tactopose_drake.drivers.simulation import faults
from tests import held_cube
from tests.drivers.rigs import SLOT, WRENCH_TOLERANCE
from tests.runs.stations import Running, fingers_running, fingers_scenario

ALL = ("first", "middle", "ring", "little", "thumb")
OTHERS = ALL[:-1]


def assert_all_is_well(running: Running) -> None:
    assert running.value("sense_status") == "ok"
    assert running.value("contact_status") == "ok"
    assert running.value("fingers_in_contact") == ALL
    assert running.value("status") in ("ok", "ambiguous")
    for finger in ALL:
        assert np.all(np.abs(running.value(f"wrench_{finger}") - held_cube.WRENCHES[finger]) < 2 * WRENCH_TOLERANCE)
        assert running.value(f"age_{finger}")[0] < 0.02
    assert is_near(running)


def is_near(running: Running) -> bool:
    return bool(np.linalg.norm(running.value("object_pose").translation() - held_cube.X_PO[:, 3]) < 0.006)


def seed_of(running: Running) -> float:
    """What changes with every estimate that is made."""
    return running.value("hypotheses").duration


# The fault of the thumb's board, and what its status says. A wrench that is out of date or wrong is never given.
LOST = {
    "silence": (faults.silence, "stale: "),
    "late replies": (faults.late(0.3), "stale: "),
    "short answers": (faults.missing_frame, "stale: "),
    "wrong length": (faults.wrong_length(5), "bad reply: "),
    "extra frames": (faults.extra_frames, "bad reply: "),
    "out of order": (faults.out_of_order, "stale: "),
}
SPARED = {
    "duplicates": faults.duplicates,
    "own frames come back": faults.own_frame_echo,
    "error frames": faults.error_frames,
}


@pytest.mark.parametrize("name", LOST)
def test_a_fault_of_one_board_leaves_the_other_fingers(cube: ObjectModel, name: str) -> None:
    fault, status = LOST[name]
    with fingers_running(cube) as running:
        running.run(0.3)
        assert_all_is_well(running)
        running.rig["thumb"].faults = [fault]
        running.run(0.5)
        assert_the_thumb_is_lost(running, status)
        running.rig["thumb"].faults = []
        running.run(2.0)
        assert_all_is_well(running)


def assert_the_thumb_is_lost(running: Running, status: str) -> None:
    assert running.value("status_thumb").startswith(status)
    assert running.value("sense_status").startswith(f"thumb: {status}")
    assert np.isnan(running.value("wrench_thumb")).all()
    assert running.value("contact_status") == "thumb: the wrench is not finite"
    assert running.value("fingers_in_contact") == OTHERS
    before = seed_of(running)
    running.run(0.2)
    assert seed_of(running) != before, "the estimate goes on"
    assert running.value("status").split(":")[0] in ("ok", "ambiguous")
    assert is_near(running)


@pytest.mark.parametrize("name", SPARED)
def test_a_fault_that_spoils_nothing_changes_nothing(cube: ObjectModel, name: str) -> None:
    with fingers_running(cube) as running:
        running.run(0.3)
        running.rig["thumb"].faults = [SPARED[name]]
        running.run(1.0)
        assert_all_is_well(running)
        assert (running.bus.error_frames > 0) == (name == "error frames")
        running.rig["thumb"].faults = []
        running.run(0.5)
        assert_all_is_well(running)


def test_critical_status_bits_and_saturated_gauges_reject_the_sample(cube: ObjectModel) -> None:
    with fingers_running(cube) as running:
        thumb = running.rig["thumb"]
        running.run(0.3)
        thumb.status = StatusBit.SUPPLY_LOW
        running.run(0.3)
        assert_the_thumb_is_lost(running, "error: supply low")
        thumb.status = StatusBit.WATCHDOG_RESET
        running.run(0.3)
        assert running.value("sense_status") == "thumb: ok (watchdog reset)"
        assert running.value("fingers_in_contact") == ALL
        thumb.status, thumb.broken_gauges = StatusBit(0), {2: -32768}
        running.run(0.3)
        assert_the_thumb_is_lost(running, "saturated: gauge 2")
        thumb.broken_gauges = {}
        running.run(0.3)
        assert_all_is_well(running)


def test_a_reboot_in_mid_stream_is_noticed_and_the_calibration_set_again(cube: ObjectModel) -> None:
    scenario = fingers_scenario(tare_samples=5)
    for board in scenario.senses.fingers.values():
        board.calibration = SLOT
    with fingers_running(cube, scenario) as running:
        running.run(0.5)
        assert_all_is_well(running)
        running.rig["thumb"].reboot(0.4)
        running.run(0.3)
        assert running.rig["thumb"].active == 0
        assert_the_thumb_is_lost(running, "stale: ")
        running.run(1.5)
        assert running.rig["thumb"].active == SLOT
        assert_all_is_well(running)


@pytest.mark.parametrize("name", ["bus-off", "adapter is gone"])
def test_a_bus_that_fails_holds_the_estimate_until_it_is_back(cube: ObjectModel, name: str) -> None:
    with fingers_running(cube) as running:
        running.run(0.5)
        pose = running.value("object_pose").GetAsMatrix34()

        def fail(fails: bool) -> None:
            for board in running.rig.values():
                board.faults = [faults.bus_off] if fails and name == "bus-off" else []
            running.unplug(fails and name == "adapter is gone")

        fail(True)
        running.run(1.0)
        for finger in ALL:
            status = running.value(f"status_{finger}")
            assert status.startswith("stale: ")
            assert ("bus is off" if name == "bus-off" else "bus ") in status
            assert np.isnan(running.value(f"wrench_{finger}")).all()
        assert running.value("status").startswith("held: 0 touches; 2 are needed")
        np.testing.assert_array_equal(running.value("object_pose").GetAsMatrix34(), pose)
        fail(False)
        running.run(4.0)
        assert_all_is_well(running)
        assert (len(running.adapters) > 1) == (name == "adapter is gone")
