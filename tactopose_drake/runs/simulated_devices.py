"""Simulated devices on the buses of a scenario, with loads from a simulated hand or files."""

import contextlib
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Self

import can
import numpy as np

from tactopose_drake.core.validation import FloatArray
from tactopose_drake.drivers.simulation.device_server import DeviceServer
from tactopose_drake.drivers.simulation.simulated_barrett_hand import HandState, SimulatedBarrettHand
from tactopose_drake.drivers.simulation.simulated_device import SimulatedDevice
from tactopose_drake.drivers.simulation.simulated_netcanoem import SimulatedNetCanOem, nano17_like_calibration
from tactopose_drake.drivers.simulation.time_series import load_time_series
from tactopose_drake.errors import BusError
from tactopose_drake.hand.fingertip_weights import FingertipWeights
from tactopose_drake.hand.hand_in_plant import make_hand_plant
from tactopose_drake.resources import fixed_pose
from tactopose_drake.station.can_senses import CanSenses
from tactopose_drake.station.scenario import Scenario
from tactopose_drake.systems.can_barrett_hand import PADS
from tactopose_drake.systems.signals import Signal

_OFFSET = 300.0  # standard deviation of the gauges' readings without a load, which a tare subtracts

Loads = dict[str, Signal]  # the wrench on each fingertip, including its weight, by finger; "hand": rows of `HandState`


def simulated_loads(scenario: Scenario, signals: Mapping[str, Signal]) -> Loads:
    """The loads of a hand's devices from the signals of `rehearse`, preceded by loads without a touch."""
    assert isinstance(scenario.senses, CanSenses)
    plant, hand = make_hand_plant(scenario.hand_config())
    weights = FingertipWeights(plant, hand, fixed_pose("Scenario.X_WBase", scenario.X_WBase).rotation())
    joints, loads = signals["joint_positions"], Loads()
    for finger in scenario.senses.fingers:
        touch = signals[f"wrench_{finger}"]
        # The simulated sensor's weight is already subtracted. It is NaN before its first sample, and when saturated.
        sampled = np.cumsum([np.isfinite(F_S).all() for F_S in touch.values]) > 0
        rows = [
            (F_S if has_sample else np.zeros(6)) + weights.wrenches(joints.at(time))[finger]
            for time, F_S, has_sample in zip(touch.times, touch.values, sampled, strict=True)
        ]
        free = weights.wrenches(joints.values[0])[finger]
        loads[finger] = Signal([touch.times[0] - 1.0, *touch.times], [free, *rows])
    if scenario.senses.barrett_hand is not None:
        order = [plant.GetJointByName(name).position_start() for name in scenario.senses.barrett_hand.joints]
        felt = [joints, *(signals[f"pressures_{pad}"] for pad in PADS)]
        begin = max(signal.times[0] for signal in felt)
        times = [begin, *sorted({time for signal in felt for time in signal.times if time > begin})]
        rows = []
        for time in times:
            q, *pressures = (signal.at(time) for signal in felt)
            rows.append(np.concatenate([q[order], *map(np.nan_to_num, pressures), np.zeros(3)]))
        free = np.concatenate([joints.values[0][order], np.zeros(len(rows[0]) - len(order))])
        loads["hand"] = Signal([begin - 1.0, *times], [free, *rows])
    return loads


def loads_of_files(senses: CanSenses, folder: Path) -> Loads:
    """Reads the devices' loads from a folder of CSV files.

    Raises:
        InvalidFileError: if a file cannot be read.
    """
    columns = dict.fromkeys(senses.fingers, 6) | ({} if senses.barrett_hand is None else {"hand": 106})
    series = {name: load_time_series(folder / f"{name}.csv", count) for name, count in columns.items()}
    return {name: Signal(each.times.tolist(), list(each.rows)) for name, each in series.items()}


class SimulatedRig:
    """The simulated devices of a scenario, with a server for each bus; a context manager.

    Attributes:
        devices: the devices by name (a finger's, or "hand"); their faults may be set at any time.
        origin: the time 0 of the loads, s since the epoch. Until it is set, the first loads apply.
    """

    def __init__(self, scenario: Scenario, loads: Loads) -> None:
        """Creates the devices; their calibrations and offsets are drawn with the scenario's seed."""
        assert isinstance(scenario.senses, CanSenses)
        self.origin = math.inf
        self._senses, self._servers = scenario.senses, contextlib.ExitStack()
        generator = np.random.default_rng(scenario.seed)
        self.devices: dict[str, SimulatedDevice] = {
            finger: SimulatedNetCanOem(
                self._feel(loads[finger]),
                {board.calibration: nano17_like_calibration(generator)},
                board.base,
                offset=generator.normal(scale=_OFFSET, size=6),
            )
            for finger, board in scenario.senses.fingers.items()
        }
        if scenario.senses.barrett_hand is not None:
            feel = self._feel(loads["hand"])
            self.devices["hand"] = SimulatedBarrettHand(lambda time: HandState.from_row(feel(time)))

    def on_bus(self, name: str) -> list[SimulatedDevice]:
        """The devices on one bus."""
        senses = self._senses
        of_finger = {finger: board.bus for finger, board in senses.fingers.items()}
        bus_of = of_finger | ({} if senses.barrett_hand is None else {"hand": senses.barrett_hand.bus})
        return [device for sense, device in self.devices.items() if bus_of[sense] == name]

    def __enter__(self) -> Self:
        """Opens the other end of each bus.

        Raises:
            BusError: if a bus cannot be opened.
        """
        with contextlib.ExitStack() as servers:
            for name, bus in self._senses.buses.items():
                try:
                    options: dict[str, Any] = dict(bus.options)
                    end = can.Bus(interface=bus.interface, channel=bus.channel, ignore_config=True, **options)
                except (can.CanError, OSError, ValueError, TypeError, ImportError) as error:
                    place = f"bus {name!r}, {bus.channel!r} of {bus.interface}"
                    raise BusError(f"{place} cannot be opened for the simulated devices ({error}).") from error
                servers.enter_context(DeviceServer(end, self.on_bus(name)))
            self._servers = servers.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._servers.close()

    def _feel(self, load: Signal) -> Callable[[float], FloatArray]:
        return lambda time: load.at(max(time - self.origin, load.times[0]))
