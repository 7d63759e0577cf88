"""A recording in the making: the folder of a run, with the files that it is filled with."""

import contextlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Self

from pydrake.systems.framework import Context, Diagram

from tactopose_drake.core.validation import FloatArray
from tactopose_drake.drivers.can_recorder import CanRecorder
from tactopose_drake.errors import InvalidFileError
from tactopose_drake.runs.estimate_writer import EstimateWriter
from tactopose_drake.runs.manifest import ESTIMATES, MANIFEST, SIGNALS, prepare_folder, save_manifest
from tactopose_drake.station.can_senses import CanSenses
from tactopose_drake.station.scenario import Scenario
from tactopose_drake.systems.signals import SignalRecorder, Value


class Recording:
    """The folder of a run; a context manager. `CanDevices` write the logs in `logs` themselves.

    A disk that fills up ends the recording, and not the run. A run that fails before it has recorded anything leaves
    nothing behind.

    Attributes:
        logs: where each bus of the scenario is recorded, by its name.
    """

    def __init__(self, folder: Path, scenario: Scenario) -> None:
        """Makes the folder.

        Args:
            folder: new, or empty.
            scenario: that is run.

        Raises:
            InvalidInputError: if there is something in the folder.
            InvalidFileError: if a file cannot be written.
        """
        self._is_new = prepare_folder(folder)
        self._folder, self._scenario = folder, scenario
        self._recorders: list[CanRecorder] = []
        senses = scenario.senses
        self.logs = {name: folder / f"{name}.blf" for name in senses.buses} if isinstance(senses, CanSenses) else {}
        with contextlib.ExitStack() as files:
            try:
                self._signals = files.enter_context(SignalRecorder(folder / SIGNALS))
                self._estimates = files.enter_context(EstimateWriter(folder / ESTIMATES))
            except InvalidFileError:
                self._remove()
                raise
            self._files = files.pop_all()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self._files.close()
        if kind is not None and not self._count:
            self._remove()

    @property
    def lost(self) -> tuple[str, ...]:
        """What could not be recorded, and why, in sentences."""
        files = (self._signals.file, self._estimates.file, *self._recorders)
        return tuple(file.problem for file in files if file is not None and file.problem)

    def watch(self, recorders: Sequence[CanRecorder]) -> None:
        """Makes these logs part of what may be `lost`."""
        self._recorders = list(recorders)

    @property
    def _count(self) -> int:
        """Of lines that are worth keeping."""
        assert self._signals.file is not None
        return self._signals.file.count + self._estimates.file.count

    def _remove(self) -> None:
        """Takes away what a run that failed before it began has left, which would be in the way of the next."""
        with contextlib.suppress(OSError):
            for path in (*self.logs.values(), *(self._folder / name for name in (SIGNALS, ESTIMATES, MANIFEST))):
                path.unlink(missing_ok=True)
            if self._is_new:
                self._folder.rmdir()

    def begin(self, start: float, biases: Mapping[str, FloatArray]) -> None:
        """Writes the manifest; a recording that was not ended can be replayed from then on.

        Args:
            start: the diagram's time 0, s since the epoch.
            biases: of the force-torque boards, by finger.
        """
        save_manifest(self._folder, self._scenario, start, self.logs, biases)

    def write(self, name: str, time: float, value: Value) -> None:
        """Adds a value of a signal."""
        self._signals.write(name, time, value)

    def write_estimate(self, diagram: Diagram, context: Context) -> None:
        """Adds the present estimate."""
        self._estimates.write(diagram, context)
