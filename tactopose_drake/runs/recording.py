"""A recording in the making: the folder of a run, with the files that it is filled with."""

import contextlib
from collections.abc import Mapping
from pathlib import Path
from typing import Self

from pydrake.systems.framework import Context, Diagram

from tactopose_drake.core.validation import FloatArray
from tactopose_drake.runs.estimate_writer import EstimateWriter
from tactopose_drake.runs.manifest import ESTIMATES, SIGNALS, prepare_folder, save_manifest
from tactopose_drake.station.scenario import Scenario
from tactopose_drake.station.senses import CanSenses
from tactopose_drake.systems.signals import SignalRecorder, Value


class Recording:
    """The folder of a run; a context manager. `CanDevices` write the logs in `logs` themselves.

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
        prepare_folder(folder)
        self._folder, self._scenario = folder, scenario
        senses = scenario.senses
        self.logs = {name: folder / f"{name}.blf" for name in senses.buses} if isinstance(senses, CanSenses) else {}
        with contextlib.ExitStack() as files:
            self._signals = files.enter_context(SignalRecorder(folder / SIGNALS))
            self._estimates = files.enter_context(EstimateWriter(folder / ESTIMATES))
            self._files = files.pop_all()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._files.close()

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
