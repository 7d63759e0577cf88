"""Recording of a run: its folder and files."""

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
    """The recording of a run; a context manager. `CanDevices` writes the files in `logs` itself.

    A full disk ends the recording, but not the run. A run that fails before it has recorded anything leaves no files.

    Attributes:
        logs: paths of the CAN logs by the buses' names.
    """

    def __init__(self, folder: Path, scenario: Scenario) -> None:
        """Creates the folder.

        Args:
            folder: a new or empty folder.
            scenario: the run's scenario.

        Raises:
            InvalidInputError: if the folder is not empty.
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
        """Sentences on what could not be recorded, and why."""
        files = (self._signals.file, self._estimates.file, *self._recorders)
        return tuple(file.problem for file in files if file is not None and file.problem)

    def watch(self, recorders: Sequence[CanRecorder]) -> None:
        """Includes the problems of these recorders in `lost`."""
        self._recorders = list(recorders)

    @property
    def _count(self) -> int:
        """The number of recorded lines."""
        assert self._signals.file is not None
        return self._signals.file.count + self._estimates.file.count

    def _remove(self) -> None:
        """Removes the files of a run that failed before it started; they would be in the way of the next run."""
        with contextlib.suppress(OSError):
            for path in (*self.logs.values(), *(self._folder / name for name in (SIGNALS, ESTIMATES, MANIFEST))):
                path.unlink(missing_ok=True)
            if self._is_new:
                self._folder.rmdir()

    def begin(self, start: float, biases: Mapping[str, FloatArray]) -> None:
        """Writes the manifest; from then on the recording can be replayed even if it does not end properly.

        Args:
            start: the diagram's time 0, s since the epoch.
            biases: tared gauge readings of the force-torque boards, by finger.
        """
        save_manifest(self._folder, self._scenario, start, self.logs, biases)

    def write(self, name: str, time: float, value: Value) -> None:
        """Adds a value of a signal."""
        self._signals.write(name, time, value)

    def write_estimate(self, diagram: Diagram, context: Context) -> None:
        """Adds the current estimate."""
        self._estimates.write(diagram, context)
