"""Runs a scenario on CAN devices, real or simulated, in real time."""

import contextlib
import math
from pathlib import Path

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, EventStatus, PortDataType

from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.estimation.prior import PosePrior
from tactopose_drake.hand.hand_config import load_hand_config
from tactopose_drake.hand.hand_in_plant import make_hand_plant
from tactopose_drake.hand.joint_matrices import joint_matrix
from tactopose_drake.runs.known_signals import check_spans, known_signals
from tactopose_drake.runs.recording import Recording
from tactopose_drake.runs.simulated_devices import SimulatedRig, loads_of_files, simulated_loads
from tactopose_drake.runs.simulation import BESIDE_DEVICES, TRUE_POSE, rehearse, sense_ports
from tactopose_drake.runs.stepping import Observer, Progress, RunView, advance
from tactopose_drake.station.can_devices import CanDevices, check_drivers, live_buses
from tactopose_drake.station.can_senses import CanSenses, SimulatedDevices
from tactopose_drake.station.hardware import HardwareStation, check_barrett_pads, make_hardware_station
from tactopose_drake.station.scenario import Scenario
from tactopose_drake.systems.signals import Signal

_MOST_LATE = 0.25  # s by which a run may fall behind the devices without a warning


def run_devices(
    scenario: Scenario,
    model: ObjectModel,
    duration: float | None,
    recording: Recording | None,
    observer: Observer,
    tell: Progress,
) -> RunView:
    """Opens the devices, tares them, and runs; see `run_scenario`.

    All slow preparations are done before the tare, so that the run starts right after it.
    """
    senses = scenario.senses
    assert isinstance(senses, CanSenses)
    with contextlib.ExitStack() as parts:
        signals, rig = _prepare(scenario, senses, model, tell)
        tell("preparing the estimate")
        devices = CanDevices(senses, live_buses(senses), None if recording is None else recording.logs)
        known = {name: signal for name, signal in signals.items() if name != TRUE_POSE}
        station = make_hardware_station(scenario, devices, known, model=model)
        warm_up(station)
        if rig is not None:
            parts.enter_context(rig)
        parts.enter_context(devices)
        if recording is not None:
            recording.watch(devices.recorders)
        if senses.tare_samples:
            tell("taring: nothing may touch the hand")
            devices.tare(senses.tare_samples)
        origin = devices.start()
        if rig is not None:
            rig.origin = origin
        if recording is not None:
            recording.begin(origin, devices.biases)
        simulator = _start(station, signals.get(TRUE_POSE), recording)
        late = [(0.0, 0.0)]  # by how much, and when, s; the largest so far

        def watch_and_show(view: RunView) -> None:
            observer(view)
            late[0] = max(late[0], _lateness(simulator))

        tell("running")
        with contextlib.suppress(KeyboardInterrupt):
            advance(simulator, devices, scenario.estimation.estimator.period, _end(scenario, duration), watch_and_show)
        slowness = slowness_of(*max(late[0], _lateness(simulator)))
        return RunView(station.diagram, simulator.get_context(), slowness=slowness)


def _lateness(simulator: Simulator) -> tuple[float, float]:
    """By how much a run is behind the devices now, s, and its time, s."""
    time = simulator.get_context().get_time()
    return time / max(simulator.get_actual_realtime_rate(), 1e-9) - time, time


def slowness_of(late: float, time: float) -> str:
    """A warning if a run was at most `late` s behind its devices, at `time` s, and that is much; otherwise empty."""
    if late <= _MOST_LATE:
        return ""
    return (
        f"at {time:.2f} s the run was {late:.2f} s behind its devices, its most: estimates take longer than their "
        "period, or the machine is busy. The devices' readings are then newer than joints, palm and prior; a longer "
        "period helps."
    )


def check_devices(scenario: Scenario, duration: float | None) -> None:
    """Creates the drivers and reads the scenario's files, without opening a bus, to find errors early.

    Args:
        scenario: a scenario with CAN devices.
        duration: duration of the run, s; None: the scenario's with simulated devices, and unlimited with real ones.

    Raises:
        InvalidInputError: if a value of a device is out of its range, a name is unknown, or a file does not cover the
            run.
    """
    senses = scenario.senses
    assert isinstance(senses, CanSenses)
    check_drivers(senses)
    if senses.barrett_hand is not None:
        plant, hand = make_hand_plant(load_hand_config(scenario.hand))
        joint_matrix(plant, hand, senses.barrett_hand.joints)
        check_barrett_pads(scenario, hand)
    if senses.simulated != SimulatedDevices():
        check_spans(scenario, known_signals(scenario), _end(scenario, duration))
    if senses.simulated is not None and senses.simulated.folder:
        loads_of_files(senses, Path(senses.simulated.folder))


def _end(scenario: Scenario, duration: float | None) -> float:
    """The end time of a run, s; infinite if an interrupt ends it."""
    assert isinstance(scenario.senses, CanSenses)
    if duration is not None:
        return duration
    return math.inf if scenario.senses.simulated is None else scenario.duration


def _prepare(
    scenario: Scenario, senses: CanSenses, model: ObjectModel, tell: Progress
) -> tuple[dict[str, Signal], SimulatedRig | None]:
    """What is known without the devices, and the simulated devices if there are any."""
    if senses.simulated is None:
        return known_signals(scenario), None
    if senses.simulated.folder:
        return known_signals(scenario), SimulatedRig(scenario, loads_of_files(senses, Path(senses.simulated.folder)))
    tell("computing what the simulated devices feel")
    felt = rehearse(scenario, model)
    names = ["prior", TRUE_POSE, *(["joint_positions"] if senses.barrett_hand is None else [])]
    return {name: felt[name] for name in names}, SimulatedRig(scenario, simulated_loads(scenario, felt))


def _start(station: HardwareStation, true_pose: Signal | None, recording: Recording | None) -> Simulator:
    """Starts a simulator in real time, which records the signals that are not on a bus."""
    simulator = Simulator(station.diagram)
    simulator.set_target_realtime_rate(1.0)
    ports = [port for port in sense_ports(station.diagram) if port.get_name() in BESIDE_DEVICES]

    def monitor(context: Context) -> EventStatus:
        if recording is not None:
            for port in ports:
                recording.write(port.get_name(), context.get_time(), port.Eval(context))
            if true_pose is not None:
                recording.write(TRUE_POSE, context.get_time(), true_pose.at(context.get_time()))
        return EventStatus.Succeeded()

    simulator.set_monitor(monitor)
    simulator.Initialize()
    return simulator


def warm_up(station: HardwareStation) -> None:
    """Makes one estimate of a synthetic touch, as first calls are slow.

    A robot would otherwise have to wait in the middle of its first grasp.
    """
    estimation = station.diagram.GetSubsystemByName("pose_estimation")
    simulator = Simulator(estimation)
    context = simulator.get_mutable_context()
    for index in range(estimation.num_input_ports()):
        port = estimation.get_input_port(index)
        if port.get_name() == "prior":
            port.FixValue(context, AbstractValue.Make(PosePrior(np.eye(3, 4))))
        elif port.get_name().startswith("wrench_"):
            port.FixValue(context, np.array([0.0, 0.0, 0.0, 0.0, 2.0, -2.0]))
        elif port.get_data_type() == PortDataType.kVectorValued:
            port.FixValue(context, np.zeros(port.size()))
    simulator.AdvanceTo(1e-3)
