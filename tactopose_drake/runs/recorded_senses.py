"""Reads all signals of a recording, including those in CAN logs, and its estimates."""

import dataclasses
import functools
from pathlib import Path
from typing import Any

from tactopose_drake.core.validation import FloatArray
from tactopose_drake.runs.estimate_writer import read_estimates
from tactopose_drake.runs.manifest import ESTIMATES, Manifest
from tactopose_drake.runs.sense_reader import SenseReader
from tactopose_drake.systems.signals import Signal, append_change


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
    reader, signals = SenseReader(folder), dict[str, Signal]()
    problems = reader.read(functools.partial(append_change, signals))
    estimates, damage = read_estimates(folder / ESTIMATES)
    return RecordedRun(reader.manifest, signals, reader.joints, estimates, (*problems, *damage), reader.units)
