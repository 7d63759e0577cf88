"""Hardware stations in virtual time, with simulated devices at the other end of their bus."""

import contextlib
import dataclasses
import threading
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from pydrake.systems.analysis import Simulator

from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.drivers.clock import VirtualClock
from tactopose_drake.drivers.device_bus import DeviceBus
from tactopose_drake.drivers.simulation.simulated_device import SimulatedDevice
from tactopose_drake.drivers.simulation.virtual_time_bus import VirtualTimeBus
from tactopose_drake.runs.simulated_devices import SimulatedRig
from tactopose_drake.station.can_devices import CanDevices
from tactopose_drake.station.hardware import HardwareStation, make_hardware_station
from tactopose_drake.station.scenario import Scenario
from tactopose_drake.systems.signals import Signal
from tests import held_can, held_cube
from tests.drivers.rigs import START


@dataclasses.dataclass
class Running:
    """A station that runs, and what can be done to it.

    Attributes:
        rig: the simulated devices, by sense.
        bus: its end of the bus.
        adapters: every adapter that was opened, newest last.
        unplugged: whether adapters fail, those to come too.
    """

    station: HardwareStation
    simulator: Simulator
    devices: CanDevices
    rig: Mapping[str, SimulatedDevice]
    bus: DeviceBus
    adapters: list[VirtualTimeBus]
    unplugged: bool = False

    def run(self, duration: float) -> None:
        self.simulator.AdvanceTo(self.simulator.get_context().get_time() + duration)

    def value(self, port: str) -> Any:
        return self.station.diagram.GetOutputPort(port).Eval(self.simulator.get_context())

    def unplug(self, unplugged: bool) -> None:
        self.unplugged = unplugged
        self.adapters[-1].unplugged = unplugged


@contextlib.contextmanager
def running(
    scenario: Scenario,
    loads: Mapping[str, np.ndarray],
    signals: Mapping[str, Signal],
    model: ObjectModel,
) -> Iterator[Running]:
    """A station of a scenario with one bus, `main`; tared, and then under constant loads, by sense."""
    free = {name: np.append(load[:7], np.zeros(99)) if name == "hand" else np.zeros(6) for name, load in loads.items()}
    rig = SimulatedRig(scenario, {name: Signal([-1.0, 0.0], [free[name], load]) for name, load in loads.items()})
    clock, adapters = VirtualClock(START), []

    def open_bus() -> VirtualTimeBus:
        adapters.append(VirtualTimeBus(rig.on_bus("main"), clock, unplugged=bool(made) and made[0].unplugged))
        return adapters[-1]

    made: list[Running] = []
    bus = DeviceBus(open_bus, clock=clock, threaded=False)
    with CanDevices(scenario.senses, {"main": bus}) as devices:
        station = make_hardware_station(scenario, devices, signals, model=model)
        if scenario.senses.tare_samples:
            devices.tare(scenario.senses.tare_samples)
        rig.origin = devices.start()
        simulator = Simulator(station.diagram)
        simulator.Initialize()
        made.append(Running(station, simulator, devices, rig.devices, bus, adapters))
        yield made[0]


def bus_threads() -> set[threading.Thread]:
    """Threads that work for a bus; the search keeps one of its own, which stays."""
    return {thread for thread in threading.enumerate() if "devices on" in thread.name}


def fingers_scenario(**senses) -> Scenario:
    """Five boards; the estimate five times a second, without the volume of the hand, which takes its time."""
    scenario = held_cube.scenario(**senses)
    scenario.estimation.estimator.period = 0.2
    scenario.estimation.use_hand_volume = scenario.estimation.check_collisions = False
    return scenario


def fingers_running(cube: ObjectModel, scenario: Scenario | None = None) -> contextlib.AbstractContextManager[Running]:
    signals = {"joint_positions": Signal.constant(held_cube.Q), "prior": Signal.constant(held_cube.prior())}
    return running(
        fingers_scenario(tare_samples=5) if scenario is None else scenario, held_cube.WRENCHES, signals, cube
    )


def pads_running(can: ObjectModel, scenario: Scenario | None = None) -> contextlib.AbstractContextManager[Running]:
    """Barrett's hand, likewise."""
    scenario = held_can.scenario() if scenario is None else scenario
    scenario.estimation.use_hand_volume = scenario.estimation.check_collisions = False
    scenario.estimation.estimator.period = 0.3
    return running(scenario, {"hand": held_can.ROW}, {"prior": Signal.constant(held_can.prior())}, can)
