"""The systems that give what CAN devices say: in virtual time, from a log, and in real time."""

from pathlib import Path

import can
import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder, LeafSystem
from pydrake.systems.primitives import LogVectorOutput

from tactopose_drake.drivers.barrett_hand import BarrettHand
from tactopose_drake.drivers.barrett_protocol import Puck
from tactopose_drake.drivers.can_recorder import CanRecorder
from tactopose_drake.drivers.device_bus import DeviceBus
from tactopose_drake.drivers.netcanoem import NetCanOemForceTorque
from tactopose_drake.drivers.replay_bus import open_log
from tactopose_drake.drivers.simulation import faults
from tactopose_drake.drivers.simulation.device_server import DeviceServer
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.systems.can_barrett_hand import CanBarrettHand
from tactopose_drake.systems.can_force_torque import CanForceTorque
from tests.drivers.rigs import (
    HAND_STATE,
    SLOT,
    WRENCH,
    WRENCH_TOLERANCE,
    make_board,
    make_hand,
    run,
    unread,
    virtual_bus,
)


def read(simulator: Simulator, port: str) -> np.ndarray | str:
    system = simulator.get_system()
    return system.GetOutputPort(port).Eval(simulator.get_context())


def start(system: LeafSystem) -> Simulator:
    simulator = Simulator(system)
    simulator.Initialize()
    return simulator


def test_gives_the_wrench_with_its_age() -> None:
    with virtual_bus(make_board()) as bus, NetCanOemForceTorque(bus, calibration_slot=SLOT) as sensor:
        simulator = start(CanForceTorque(sensor))
        assert np.isnan(read(simulator, "wrench")).all()
        assert read(simulator, "status") == "no sample yet"
        assert read(simulator, "age") == [np.inf]
        simulator.AdvanceTo(0.5)
        assert np.all(np.abs(read(simulator, "wrench") - WRENCH) < WRENCH_TOLERANCE)
        assert read(simulator, "status") == "ok"
        assert 0.0 <= read(simulator, "age")[0] < 0.006


def test_a_board_that_falls_silent_becomes_stale_and_comes_back() -> None:
    board = make_board()
    with virtual_bus(board) as bus, NetCanOemForceTorque(bus, calibration_slot=SLOT) as sensor:
        simulator = start(CanForceTorque(sensor, max_age=0.05))
        simulator.AdvanceTo(0.5)
        board.faults = [faults.silence]
        simulator.AdvanceTo(0.54)
        assert read(simulator, "status") == "ok"
        simulator.AdvanceTo(0.58)
        assert np.isnan(read(simulator, "wrench")).all()
        assert read(simulator, "status").startswith("stale: 0.0")
        simulator.AdvanceTo(1.0)
        assert read(simulator, "status").startswith("stale: 0.5")
        assert "no reply" in read(simulator, "status")
        board.faults = []
        simulator.AdvanceTo(2.5)
        assert read(simulator, "status") == "ok"
        assert np.all(np.abs(read(simulator, "wrench") - WRENCH) < WRENCH_TOLERANCE)


def test_an_invalid_sample_has_no_numbers() -> None:
    board = make_board()
    with virtual_bus(board) as bus, NetCanOemForceTorque(bus, calibration_slot=SLOT) as sensor:
        simulator = start(CanForceTorque(sensor))
        board.broken_gauges = {3: 32767}
        simulator.AdvanceTo(0.5)
        assert np.isnan(read(simulator, "wrench")).all()
        assert read(simulator, "status") == "saturated: gauge 3"
        assert read(simulator, "age")[0] < 0.006


def test_a_stamp_from_the_future_is_not_fresh() -> None:
    with virtual_bus(make_board()) as bus, NetCanOemForceTorque(bus, calibration_slot=SLOT) as sensor:
        sensor.read()
        bus.clock._now -= 10.0
        sample, age, status = sensor.observe(0.05)
    assert sample is None
    assert age == pytest.approx(-10)
    assert status.startswith("stale: 10.00 s in the future, and may be at most 0.05 s")


def test_what_was_sampled_before_the_clock_went_back_is_not_fresh() -> None:
    with virtual_bus(make_board()) as bus, NetCanOemForceTorque(bus, calibration_slot=SLOT) as sensor:
        simulator = start(CanForceTorque(sensor))
        simulator.AdvanceTo(1.0)
        simulator.get_mutable_context().SetTime(0.2)
        simulator.Initialize()
        simulator.AdvanceTo(0.5)
        assert read(simulator, "status").startswith("stale: 0.5")
        assert np.isnan(read(simulator, "wrench")).all()
        simulator.AdvanceTo(1.1)
        assert read(simulator, "status") == "ok"


def test_gives_all_of_the_hand() -> None:
    simulated = make_hand(awake=False)
    with virtual_bus(simulated) as bus, BarrettHand(bus) as hand:
        simulator = start(CanBarrettHand(hand))
        simulator.AdvanceTo(0.5)
        assert "waking up" in read(simulator, "status")
        simulator.AdvanceTo(2.0)
        assert read(simulator, "status") == "ok"
        np.testing.assert_allclose(read(simulator, "joint_positions"), HAND_STATE.joint_positions, atol=1e-4)
        np.testing.assert_allclose(read(simulator, "fingertip_torques"), HAND_STATE.fingertip_torques, atol=2e-3)
        for row, pad in enumerate(("finger_1", "finger_2", "finger_3", "palm")):
            np.testing.assert_allclose(read(simulator, f"pressures_{pad}"), HAND_STATE.pressures[row], atol=20)
        simulated.absent = {Puck.F2}
        simulator.AdvanceTo(3.0)
        assert "F2: no position" in read(simulator, "status")
        assert np.isnan(read(simulator, "pressures_finger_2")).all()
        assert np.isfinite(read(simulator, "pressures_palm")).all()
        simulated.faults = [faults.silence]
        simulator.AdvanceTo(4.0)
        assert read(simulator, "status").startswith("stale")
        assert np.isnan(read(simulator, "pressures_palm")).all()
        assert np.isnan(read(simulator, "joint_positions")).all()
        assert simulated.moves == []


def replay(log: Path, duration: float) -> tuple[np.ndarray, str]:
    """The wrench of a diagram that plays a log, at every step, and the last status."""
    with open_log(log) as bus, NetCanOemForceTorque(bus, calibration_slot=SLOT) as sensor:
        builder = DiagramBuilder()
        system = builder.AddNamedSystem("sensor", CanForceTorque(sensor))
        logger = LogVectorOutput(system.GetOutputPort("wrench"), builder, 0.005)
        simulator = start(builder.Build())
        simulator.AdvanceTo(duration)
        status = system.GetOutputPort("status").Eval(system.GetMyContextFromRoot(simulator.get_context()))
        return logger.FindLog(simulator.get_context()).data(), status


def test_a_log_replays_bit_by_bit_and_ends_without_stopping_the_diagram(tmp_path: Path) -> None:
    log = tmp_path / "log.blf"
    with virtual_bus(make_board()) as bus, CanRecorder(log) as recorder:
        recorder.record(bus)
        with NetCanOemForceTorque(bus, calibration_slot=SLOT) as sensor:
            run(bus, 1.0)
            assert len(unread(sensor)) > 190
    first, status = replay(log, 1.5)
    again, _ = replay(log, 1.5)
    assert first.tobytes() == again.tobytes()
    valid = np.isfinite(first).all(axis=0)
    assert valid[10:200].all()
    assert not valid[212:].any()
    assert status.startswith("stale")
    assert "ended after" in status


def test_runs_in_real_time_beside_a_real_bus() -> None:
    with (
        DeviceServer(can.Bus(interface="virtual", channel="real time"), [make_board()]),
        DeviceBus.open("virtual", "real time") as bus,
        NetCanOemForceTorque(bus, calibration_slot=SLOT) as sensor,
    ):
        sensor.read(5.0)
        simulator = start(CanForceTorque(sensor, max_age=60.0))
        simulator.AdvanceTo(0.001)
        assert read(simulator, "status") == "ok"
        assert np.all(np.abs(read(simulator, "wrench") - WRENCH) < WRENCH_TOLERANCE)


@pytest.mark.parametrize("arguments", [{"period": 0.0}, {"max_age": 0.0}])
def test_arguments_out_of_range_are_refused(arguments: dict) -> None:
    with virtual_bus() as bus:
        with pytest.raises(InvalidInputError, match=next(iter(arguments))):
            CanForceTorque(NetCanOemForceTorque(bus), **arguments)
        with pytest.raises(InvalidInputError, match=next(iter(arguments))):
            CanBarrettHand(BarrettHand(bus), **arguments)
