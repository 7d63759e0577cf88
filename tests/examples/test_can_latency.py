"""The measurement of the latency, for a moment and in one process; what it finds depends on the machine."""

import multiprocessing
import runpy
import time
from pathlib import Path

import can
import numpy as np
import pytest

from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.resources import model_path
from tactopose_drake.runs.simulated_devices import SimulatedRig
from tactopose_drake.station.can_devices import CanDevices, live_buses
from tactopose_drake.station.hardware import make_hardware_station
from tactopose_drake.systems.signals import Signal
from tests import held_cube

SCRIPT = Path(__file__).parents[2] / "examples" / "can_latency.py"


def test_a_pipe_is_a_bus() -> None:
    example = runpy.run_path(str(SCRIPT))
    assert len(example["make_scenario"]().senses.buses) == 1
    one, other = map(example["PipeBus"], multiprocessing.Pipe())
    with one, other:
        assert other.recv(0.0) is None
        before = time.time()
        one.send(can.Message(arbitration_id=0x201, is_extended_id=False, data=b"12"))
        frame = other.recv(5.0)
        assert (frame.arbitration_id, bytes(frame.data)) == (0x201, b"12")
        assert before <= frame.timestamp <= time.time()
        one._pipe.close()
        with pytest.raises(can.CanOperationError, match="the other process has ended"):
            other.recv(5.0)


def test_frames_become_contacts() -> None:
    example = runpy.run_path(str(SCRIPT))
    scenario = held_cube.scenario()
    scenario.senses.buses["main"].channel = "latency"
    scenario.estimation.use_hand_volume = scenario.estimation.check_collisions = False
    model = ObjectModel.from_mesh(model_path("objects", "cube.obj"))
    loads = {finger: Signal.constant(F_S) for finger, F_S in held_cube.WRENCHES.items()}
    for load in loads.values():
        load.times[0] = 0.0
    devices = CanDevices(scenario.senses, live_buses(scenario.senses))
    station = make_hardware_station(scenario, devices, {"joint_positions": Signal.constant(held_cube.Q)}, model=model)
    began = time.monotonic()
    with SimulatedRig(scenario, loads), devices:
        for board in devices.boards.values():
            board.read(5.0)
        silent = example["run"](station, devices, 0.1, False)
        report = example["run"](station, devices, 0.4, True)
    assert len(silent.latency) == 0
    assert len(report.latency) >= 5
    assert np.all(report.latency > 0.0)
    assert np.all(report.latency < time.monotonic() - began), "no frame is older than the boards"
    assert report.estimates == 4
    assert report.samples_per_second > 0
    # Drake does not wait for the end of the last step, which is as long as a sensor's period at the most.
    step = max(board.period for board in scenario.senses.fingers.values())
    assert 0 < report.real_time_factor <= 0.4 / (0.4 - step)
