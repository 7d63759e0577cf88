"""Reads all signals of a recording, including those in CAN logs, and its estimates."""

import contextlib
import dataclasses
import functools
from pathlib import Path
from typing import Any

from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, EventStatus

from tactopose_drake.core.validation import FloatArray, told_of
from tactopose_drake.errors import InvalidFileError
from tactopose_drake.hand.encoder_offsets import radian_units
from tactopose_drake.hand.hand_config import load_hand_config
from tactopose_drake.hand.hand_in_plant import make_hand_plant
from tactopose_drake.hand.named_joints import NamedJoints
from tactopose_drake.runs.manifest import ESTIMATES, MANIFEST, SIGNALS, Manifest, load_manifest
from tactopose_drake.runs.recorded_estimates import read_estimates
from tactopose_drake.runs.scenario_replay import as_recorded, check_kinds, have_ended, logged_devices, missing_signals
from tactopose_drake.runs.simulation import BESIDE_DEVICES, TRUE_POSE, sense_ports
from tactopose_drake.runs.stepping import advance
from tactopose_drake.station.can_senses import CanSenses
from tactopose_drake.station.hardware import check_signals, make_hardware_station
from tactopose_drake.systems.signals import Signal, SignalRecorder, read_signals

_STEP = 0.1  # s between checks of whether the logs have ended
_NEVER = 1e9  # s


@dataclasses.dataclass(frozen=True, eq=False)
class RecordedRun:
    """A recording.

    Attributes:
        manifest: the recording's manifest.
        signals: those of `joint_positions`, `palm_pose`, `prior`, `wrench_<finger>`, `pressures_<pad>`, and for a
            simulation `true_pose`, that the recording has.
        joints: names of the joints in `joint_positions`.
        estimates: lines of `estimates.jsonl`, in order of time.
        problems: sentences on files that could not be read to their end.
        units: the amount of each joint position that counts as a radian, see `radian_units`, shape (nq,).
    """

    manifest: Manifest
    signals: dict[str, Signal]
    joints: tuple[str, ...]
    estimates: tuple[dict[str, Any], ...]
    problems: tuple[str, ...]
    units: FloatArray

    @property
    def end(self) -> float:
        """Time of the last change, s; 0 if there is none."""
        times = [signal.times[-1] for signal in self.signals.values()]
        return max([0.0, *times, *(float(line["time"]) for line in self.estimates[-1:])])


def read_recording(folder: Path) -> RecordedRun:
    """Reads a folder by `run --record`; CAN logs are decoded by the drivers, without estimates.

    Raises:
        InvalidFileError: if the folder is not a recording, or one of its files cannot be read.
        InvalidInputError: if the hand's or the object's files are no longer where they were at the run.
    """
    manifest = load_manifest(folder)
    with told_of(f"{folder / MANIFEST}: scenario.hand: "):
        config = load_hand_config(manifest.scenario.hand)
        plant, hand = make_hand_plant(config)
    signals, cut = read_signals(folder / SIGNALS)
    check_kinds(signals, cut or f"{folder / SIGNALS} is whole.")
    with told_of(f"{folder}: ", InvalidFileError):
        check_signals(config, plant, {name: signal for name, signal in signals.items() if name != TRUE_POSE})
    problems = [cut] if cut else []
    if missing := missing_signals(signals, manifest.scenario):
        problems.append(f"{folder / SIGNALS} has no {', '.join(missing)}, which the run has recorded.")
    if isinstance(manifest.scenario.senses, CanSenses):
        played, ends = _play(folder, manifest, signals)
        signals, problems = signals | played, problems + ends
    estimates, damage = read_estimates(folder / ESTIMATES)
    joints = NamedJoints(plant, hand).names
    return RecordedRun(manifest, signals, joints, estimates, (*problems, *damage), radian_units(plant))


def _play(folder: Path, manifest: Manifest, signals: dict[str, Signal]) -> tuple[dict[str, Signal], list[str]]:
    """The measurements of a run's devices from their logs, and messages on logs that were cut off."""
    estimator = dataclasses.replace(manifest.scenario.estimation.estimator, period=_NEVER)
    estimation = dataclasses.replace(
        manifest.scenario.estimation, estimator=estimator, check_collisions=False, use_hand_volume=False
    )
    with told_of(f"{folder / MANIFEST}: "):
        scenario = as_recorded(dataclasses.replace(manifest.scenario, estimation=estimation, tracking=None), manifest)
    with contextlib.ExitStack() as parts:
        recorder = parts.enter_context(SignalRecorder())
        devices = logged_devices(folder, manifest)
        assert devices is not None
        known = {name: signal for name, signal in signals.items() if name in BESIDE_DEVICES}
        if devices.hand is not None:  # Joint positions are in the log.
            known.pop("joint_positions", None)
        station = make_hardware_station(scenario, devices, known, model=manifest.scenario.object_model())
        simulator = Simulator(station.diagram)
        parts.enter_context(devices).start(manifest.start)
        ports = [port for port in sense_ports(station.diagram) if port.get_name() not in known]
        buses = list(devices.buses.values())
        at_end = functools.partial(have_ended, buses)

        def monitor(context: Context) -> EventStatus:
            for port in ports:
                if port.get_name() != "prior" and not at_end():
                    recorder.write(port.get_name(), context.get_time(), port.Eval(context))
            return EventStatus.Succeeded()

        simulator.set_monitor(monitor)
        simulator.Initialize()
        advance(simulator, devices, _STEP, _NEVER, lambda view: None, at_end)
        ends = [str(bus.log_end) for bus in buses if bus.log_end is not None and not bus.log_end.whole]
        return recorder.signals, ends
