"""Reads the signals of a recording, including those in CAN logs, one change after the other, without keeping them."""

import bisect
import contextlib
import dataclasses
import functools
import math
from collections import deque
from collections.abc import Collection, Iterator
from pathlib import Path

from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, EventStatus

from tactopose_drake.core.validation import told_of
from tactopose_drake.errors import InvalidFileError
from tactopose_drake.hand.encoder_offsets import radian_units
from tactopose_drake.hand.hand_config import load_hand_config
from tactopose_drake.hand.hand_in_plant import make_hand_plant
from tactopose_drake.hand.named_joints import NamedJoints
from tactopose_drake.runs.manifest import MANIFEST, SIGNALS, load_manifest
from tactopose_drake.runs.scenario_replay import as_recorded, check_kinds, have_ended, logged_devices, missing_signals
from tactopose_drake.runs.simulation import BESIDE_DEVICES, TRUE_POSE, sense_ports
from tactopose_drake.runs.stepping import RunView, advance
from tactopose_drake.station.can_devices import CanDevices
from tactopose_drake.station.can_senses import CanSenses
from tactopose_drake.station.hardware import check_signals, make_hardware_station
from tactopose_drake.systems.signals import Change, Signal, SignalFile, SignalRecorder, Write, append_change

_STEP = 0.1  # s between checks of whether the logs have ended
_NEVER = 1e9  # s


class SenseReader:
    """Reads a recording's signals, in order of time, without keeping them.

    Attributes:
        manifest: the recording's manifest.
        joints: names of the joints in `joint_positions`.
        units: the amount of each joint position that counts as a radian, see `radian_units`, shape (nq,).
    """

    def __init__(self, folder: Path) -> None:
        """Reads the manifest and the hand.

        Raises:
            InvalidFileError: if the folder is not a recording.
            InvalidInputError: if the hand's files are no longer where they were at the run.
        """
        self._folder = folder
        self.manifest = load_manifest(folder)
        with told_of(f"{folder / MANIFEST}: scenario.hand: "):
            self._config = load_hand_config(self.manifest.scenario.hand)
            self._plant, hand = make_hand_plant(self._config)
        self.joints = NamedJoints(self._plant, hand).names
        self.units = radian_units(self._plant)

    def read(self, write: Write) -> list[str]:
        """Reads all signals; CAN logs are decoded by the drivers, without estimates.

        Args:
            write: called with name, time and value of each change.

        Returns:
            Sentences on files that could not be read to their end.

        Raises:
            InvalidFileError: if a file cannot be read, or a signal does not fit the hand.
            InvalidInputError: if the object's files are no longer where they were at the run.
        """
        file, seen = SignalFile(self._folder / SIGNALS), dict[str, Signal]()
        changes, ends = self._checked(file, seen), list[str]()
        if isinstance(self.manifest.scenario.senses, CanSenses):
            ends = self._play(changes, write)
        else:
            for change in changes:
                write(*change)
        problems = [file.cut] if file.cut else []
        if missing := missing_signals(seen, self.manifest.scenario):
            problems.append(f"{self._folder / SIGNALS} has no {', '.join(missing)}, which the run has recorded.")
        return problems + ends

    def _checked(self, file: SignalFile, seen: dict[str, Signal]) -> Iterator[Change]:
        """The changes of a file; of each signal, the first value of each kind is checked and kept in `seen`."""
        for name, time, value in file.changes():
            if name not in seen or (value is None) not in [known is None for known in seen[name].values]:
                signal = {name: Signal([time], [value])}
                check_kinds(signal, f"{self._folder / SIGNALS} is damaged.")
                with told_of(f"{self._folder}: ", InvalidFileError):
                    check_signals(self._config, self._plant, {} if name == TRUE_POSE else signal)
                append_change(seen, name, time, value)
            yield name, time, value

    def _play(self, changes: Iterator[Change], write: Write) -> list[str]:
        """Reads the measurements of a run's devices from their logs; returns messages on logs that were cut off."""
        manifest = self.manifest
        with contextlib.ExitStack() as parts:
            recorder = parts.enter_context(SignalRecorder(pass_on=write))
            devices = logged_devices(self._folder, manifest)
            assert devices is not None
            needed = [name for name in missing_signals({}, manifest.scenario) if name in BESIDE_DEVICES]
            beside = _BesideDevices(changes, needed)
            simulator = self._simulator(devices, beside.known)
            parts.enter_context(devices).start(manifest.start)
            ports = [port for port in sense_ports(simulator.get_system()) if port.get_name() not in beside.known]
            beside.dropped = [port.get_name() for port in ports]
            buses = list(devices.buses.values())
            at_end = functools.partial(have_ended, buses)

            def monitor(context: Context) -> EventStatus:
                for change in beside.taken(context.get_time()):
                    write(*change)
                for port in ports:
                    if port.get_name() != "prior" and not at_end():
                        recorder.write(port.get_name(), context.get_time(), port.Eval(context))
                return EventStatus.Succeeded()

            def read_on(view: RunView) -> None:
                beside.keep(view.context.get_time() - _STEP, view.context.get_time() + 2.0 * _STEP)

            simulator.set_monitor(monitor)
            simulator.Initialize()
            advance(simulator, devices, _STEP, _NEVER, read_on, at_end)
            for change in beside.rest():
                write(*change)
            return [str(bus.log_end) for bus in buses if bus.log_end is not None and not bus.log_end.whole]

    def _simulator(self, devices: CanDevices, known: dict[str, Signal]) -> Simulator:
        """A simulator of the station on the logs, which estimates nothing."""
        of_run = self.manifest.scenario
        estimator = dataclasses.replace(of_run.estimation.estimator, period=_NEVER)
        estimation = dataclasses.replace(
            of_run.estimation, estimator=estimator, check_collisions=False, use_hand_volume=False
        )
        with told_of(f"{self._folder / MANIFEST}: "):
            scenario = as_recorded(dataclasses.replace(of_run, estimation=estimation, tracking=None), self.manifest)
        return Simulator(make_hardware_station(scenario, devices, known, model=of_run.object_model()).diagram)


class _BesideDevices:
    """Signals that are recorded beside devices, of which only the near past and future is kept.

    Attributes:
        known: the needed signals, at the times that are kept.
        dropped: names of the signals that the devices give.
    """

    def __init__(self, changes: Iterator[Change], needed: Collection[str]) -> None:
        """Reads up to the first values.

        Args:
            changes: all that are recorded.
            needed: names of the signals that the station needs.
        """
        self.known: dict[str, Signal] = {}
        self.dropped: Collection[str] = ()
        self._changes, self._needed = changes, needed
        self._read: deque[Change] = deque()
        while not all(name in self.known for name in needed) and self._read_one():
            pass
        self.keep(0.0, 2.0 * _STEP)

    def keep(self, since: float, until: float) -> None:
        """Reads on to the second time, s, and drops of the known signals what was over at the first."""
        while (not self._read or self._read[-1][1] <= until) and self._read_one():
            pass
        for signal in self.known.values():
            over = bisect.bisect_right(signal.times, since) - 1
            if over > 0:
                del signal.times[:over], signal.values[:over]

    def taken(self, until: float) -> Iterator[Change]:
        """The changes up to a time, s, of those that have been read; each only once."""
        while self._read and self._read[0][1] <= until:
            change = self._read.popleft()
            if change[0] not in self.dropped:
                yield change

    def rest(self) -> Iterator[Change]:
        """All changes that have not been taken."""
        yield from self.taken(math.inf)
        yield from (change for change in self._changes if change[0] not in self.dropped)

    def _read_one(self) -> bool:
        """Reads the next change; returns whether there was one."""
        change = next(self._changes, None)
        if change is None:
            return False
        self._read.append(change)
        if change[0] in self._needed:
            append_change(self.known, *change)
        return True
