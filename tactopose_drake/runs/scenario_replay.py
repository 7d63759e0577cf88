"""Replays a recording through decoders, drivers and estimation, as if the devices sent it again."""

import contextlib
import dataclasses
import functools
import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from pydrake.math import RigidTransform
from pydrake.systems.analysis import Simulator

from tactopose_drake.core.validation import told_of
from tactopose_drake.drivers.device_bus import DeviceBus
from tactopose_drake.errors import EndOfLogError, InvalidFileError
from tactopose_drake.estimation.prior import PosePrior
from tactopose_drake.hand.hand_config import load_hand_config
from tactopose_drake.resources import fixed_pose
from tactopose_drake.runs.manifest import ESTIMATES, MANIFEST, SIGNALS, Manifest, load_manifest
from tactopose_drake.runs.replay_comparison import ReplayComparison
from tactopose_drake.runs.simulation import TRUE_POSE
from tactopose_drake.runs.stepping import Observer, Progress, RunView, advance
from tactopose_drake.station.can_devices import CanDevices, logged_buses
from tactopose_drake.station.can_senses import CanSenses, JointPort, SimulatedDevices
from tactopose_drake.station.hardware import HardwareStation, make_hardware_station
from tactopose_drake.station.scenario import Scenario
from tactopose_drake.systems.signals import Signal, read_signals

_LONGEST_SILENCE = 60.0  # s from the start of a run to the first frame


@dataclasses.dataclass(frozen=True, eq=False)
class Replay:
    """The result of a replay.

    Attributes:
        view: the run at its end.
        ends: a sentence on each file's end: after how many frames, and whether it was cut off; or that the replay was
            interrupted.
        whole: whether no file was cut off, and the replay was not interrupted.
        difference: from when on, how much and possibly why the estimates differ from the run's, and which versions
            differ; empty if the estimates agree, or the scenario's estimation differs from the run's.
    """

    view: RunView
    ends: tuple[str, ...]
    whole: bool
    difference: str


def replay(
    folder: Path,
    scenario: Scenario,
    *,
    paced: bool = False,
    duration: float | None = None,
    observer: Observer = lambda view: None,
    tell: Progress = lambda message: None,
) -> Replay:
    """Replays a recording.

    The CAN logs go through the drivers in virtual time, so the results depend only on the recording and the scenario,
    to the last bit, at any speed. For the same reason time limits of the search are removed, and a belief that a
    thread computed (`live`) is computed in sequence.

    Args:
        folder: folder of the recording.
        scenario: a scenario with the same hand, object and devices; its estimation may differ.
        paced: whether to replay at the recorded speed; otherwise as fast as possible.
        duration: duration of the part that is replayed, from the start, s; None: all.
        observer: called with the run at the period of the estimates.
        tell: called with the name of each step that starts.

    Raises:
        InvalidFileError: if the folder is not a recording.
        InvalidInputError: if the recording does not fit the scenario.
    """
    manifest = load_manifest(folder)
    manifest.check_scenario(scenario, folder)
    comparison = ReplayComparison(folder / ESTIMATES, is_live=isinstance(manifest.scenario.senses, CanSenses))
    is_compared = _estimates_alike(scenario, manifest.scenario)
    scenario = as_recorded(scenario, manifest)
    signals, cut = read_signals(folder / SIGNALS)
    last = max((signal.times[-1] for signal in signals.values()), default=0.0)  # Nothing is known after that.
    signals.pop(TRUE_POSE, None)
    run = dataclasses.replace(manifest.scenario, hand=scenario.hand)  # The hand's file may have moved.
    _check_signals(signals, run, cut or f"{folder / SIGNALS} is whole.")
    devices = logged_devices(folder, manifest)
    tell("reading the object")
    with contextlib.ExitStack() as parts:
        if devices is not None and devices.hand is not None:  # Joint positions are in the log.
            signals.pop("joint_positions", None)
        simulator = Simulator(_make_station(folder, scenario, devices, signals).diagram)
        if devices is not None:
            parts.enter_context(devices).start(manifest.start)
        if paced:
            simulator.set_target_realtime_rate(1.0)
        simulator.Initialize()
        tell("playing")
        until = min(math.inf if duration is None else duration, last if cut or devices is None else math.inf)
        is_part = bool(cut) or (duration is not None and duration < last)
        buses = [] if devices is None else list(devices.buses.values())
        at_end = functools.partial(have_ended, buses)

        def compare_and_show(view: RunView) -> None:
            # At the end of a part, the run may have no estimate.
            is_between = is_part and view.context.get_time() >= until
            if is_compared and not is_between and not at_end():  # Nothing is compared after the end of a log.
                comparison.compare(view)
            observer(view)

        early = [cut] if cut else []
        try:
            advance(simulator, devices, scenario.estimation.estimator.period, until, compare_and_show, at_end)
        except KeyboardInterrupt:
            early.append(f"The replay was interrupted at {simulator.get_context().get_time():.2f} s.")
        view = RunView(simulator.get_system(), simulator.get_context())
        difference = comparison.difference
        if difference:
            difference = f"{difference} {manifest.version_change()}".rstrip()
        return _replay(view, [bus.log_end for bus in buses if bus.log_end is not None], early, difference)


def _estimates_alike(one: Scenario, other: Scenario) -> bool:
    """Whether two scenarios with the same hand, object and senses give the same estimates."""
    bases = [fixed_pose("Scenario.X_WBase", scenario.X_WBase) for scenario in (one, other)]
    same_shape = (one.surface_sigma, one.scale_sigma) == (other.surface_sigma, other.scale_sigma)
    return one.estimation == other.estimation and same_shape and bases[0].IsExactlyEqualTo(bases[1])


def _replay(view: RunView, ends: list[EndOfLogError], early: list[str], difference: str) -> Replay:
    """The result of a replay, given the ends of its logs, and why it ended before them."""
    return Replay(view, (*map(str, ends), *early), not early and all(end.whole for end in ends), difference)


def have_ended(buses: list[DeviceBus]) -> bool:
    """Whether all logs are at their end; False without logs."""
    return bool(buses) and all(bus.log_end is not None for bus in buses)


def _make_station(
    folder: Path, scenario: Scenario, devices: CanDevices | None, signals: Mapping[str, Signal]
) -> HardwareStation:
    """Builds the station for a replay.

    Raises:
        InvalidFileError: if the recording's signals do not fit the scenario.
    """
    model = scenario.object_model()
    with told_of(f"{folder}: ", InvalidFileError):
        return make_hardware_station(scenario, devices, signals, model=model)


def as_recorded(scenario: Scenario, manifest: Manifest) -> Scenario:
    """The scenario with the recording's senses, without a time limit, and with a belief that is not `live`."""
    estimator = dataclasses.replace(scenario.estimation.estimator, max_duration=None)
    estimation = dataclasses.replace(scenario.estimation, estimator=estimator)
    senses = manifest.scenario.senses
    if isinstance(senses, CanSenses):  # Data from files is now in the signals and the logs.
        simulated = SimulatedDevices() if senses.simulated == SimulatedDevices() else None
        senses = dataclasses.replace(senses, joints=JointPort(), prior="", palm="", simulated=simulated)
    tracking = None if scenario.tracking is None else dataclasses.replace(scenario.tracking, live=False)
    played = dataclasses.replace(scenario, senses=senses, estimation=estimation, tracking=tracking)
    played.validate()
    return played


def logged_devices(folder: Path, manifest: Manifest) -> CanDevices | None:
    """The devices of a recording on buses that replay their logs; None if it has none.

    Raises:
        InvalidFileError: if a log cannot be read, or the run started long before the first frame, so that the replay
            would wait for it.
    """
    senses = manifest.scenario.senses
    if not isinstance(senses, CanSenses):
        return None
    devices = CanDevices(senses, logged_buses({name: folder / file for name, file in manifest.buses.items()}))
    devices.set_biases(manifest.biases)
    first = min(bus.clock.time() for bus in devices.buses.values())
    if manifest.start < first - _LONGEST_SILENCE:
        raise InvalidFileError(
            f"{folder / MANIFEST}: start must be at most {_LONGEST_SILENCE:g} s before the logs' first frame, not "
            f"{first - manifest.start:.0f} s."
        )
    return devices


def _check_signals(signals: Mapping[str, Signal], scenario: Scenario, state: str) -> None:
    """Raises InvalidFileError if a signal of the run is missing or has another type, which would change estimates."""
    for name in missing_signals(signals, scenario):
        raise InvalidFileError(f"{state} It must have the {name}, which the run has recorded, but lacks it.")
    check_kinds(signals, state)


def check_kinds(signals: Mapping[str, Signal], state: str) -> None:
    """Raises InvalidFileError if a recorded signal has another type than its name says; `state` is of its file."""
    for name, signal in signals.items():
        kind = _KINDS.get(name, np.ndarray)
        if not all(isinstance(value, kind) or (value is None and name == "prior") for value in signal.values):
            raise InvalidFileError(f"{state} Its {name} must be a {_KIND_NAMES[kind]}, not another kind of value.")


def missing_signals(signals: Mapping[str, Signal], scenario: Scenario) -> list[str]:
    """The names of missing signals, among those that a run of the scenario records."""
    senses, hand = scenario.senses, load_hand_config(scenario.hand)
    needed = []
    if not isinstance(senses, CanSenses):
        needed = [f"wrench_{finger}" for finger in hand.sensing]
        needed += [f"pressures_{pad.name}" for pad in hand.pads] + ["prior"]
    if not isinstance(senses, CanSenses) or senses.barrett_hand is None:
        needed.append("joint_positions")
    if isinstance(senses, CanSenses) and senses.palm:
        needed.append("palm_pose")
    if isinstance(senses, CanSenses) and (senses.prior or senses.simulated == SimulatedDevices()):
        needed.append("prior")
    return [name for name in needed if name not in signals]


_KINDS = {"prior": PosePrior, "palm_pose": RigidTransform, TRUE_POSE: RigidTransform}
_KIND_NAMES: dict[type, str] = {PosePrior: "prior", RigidTransform: "pose", np.ndarray: "vector"}
