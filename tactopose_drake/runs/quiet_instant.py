"""Extracts a grasp for calibration from a recording: the readings while the hand held the object most quietly."""

import dataclasses
import heapq
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import FloatArray
from tactopose_drake.errors import InvalidFileError
from tactopose_drake.hand.recorded_grasps import RecordedGrasp
from tactopose_drake.runs.recorded_senses import RecordedRun
from tactopose_drake.runs.sense_reader import SenseReader
from tactopose_drake.systems.signals import Value

_JOINTS, _WRENCH = "joint_positions", "wrench_"
_STEP = 0.02  # s between samples of the recording
_A_GAP = 1e6  # penalty of an unknown joint, in degrees of motion: more than any motion
_WINDOW = 15  # number of samples over which readings are averaged
_BLOCK = 1000  # samples that are kept until they are looked at
_TOUCHES = 0.3  # least force of a touch, N; less may be a bias
# Changes of a wrench, N m and N, that count as much as a joint's motion by 1 degree, or by 1 mm if prismatic.
_STILL = np.repeat([0.001, 0.05], 3)


def quiet_grasp(run: RecordedRun, model: ObjectModel, name: str) -> RecordedGrasp:
    """The mean readings of the quietest 0.3 s in which the largest number of fingers touch.

    Args:
        run: the recording.
        model: the object in it.
        name: name of the recording, for messages.

    Raises:
        InvalidFileError: if it has no joint positions, is shorter than 0.3 s, or nothing touches the object in it.
    """
    instant = QuietInstant(run.units)
    parts = [
        [(name, time, value) for time, value in zip(signal.times, signal.values, strict=True)]
        for name, signal in run.signals.items()
    ]
    for change in heapq.merge(*parts, key=lambda change: change[1]):
        instant.write(*change)
    return instant.grasp(model, name, run.joints, run.manifest.start)


def read_quiet_grasp(folder: Path, model: ObjectModel) -> tuple[RecordedGrasp, list[str]]:
    """The `quiet_grasp` of a recording in a folder, which is read without keeping more than a part of it.

    Args:
        folder: folder of the recording.
        model: the object in it.

    Returns:
        The grasp, and sentences on files that could not be read to their end.

    Raises:
        InvalidFileError: as `read_recording` and `quiet_grasp`.
        InvalidInputError: as `read_recording`.
    """
    reader = SenseReader(folder)
    instant = QuietInstant(reader.units)
    problems = reader.read(instant.write)
    return instant.grasp(model, str(folder), reader.joints, reader.manifest.start), problems


@dataclasses.dataclass(frozen=True, eq=False)
class _Window:
    """The samples of 0.3 s: how many fingers touch, which, the unrest, and the mean time and readings."""

    count: int
    touching: NDArray[np.bool_]
    unrest: float
    time: float
    q: FloatArray
    felt: FloatArray


class QuietInstant:
    """Finds the quietest 0.3 s in which the largest number of fingers touch, among changes in order of time.

    It keeps only the last samples and the best ones, however long the recording is.
    """

    def __init__(self, units: FloatArray) -> None:
        """Begins without any change.

        Args:
            units: the amount of each joint position that counts as a radian, see `radian_units`, shape (nq,).
        """
        self._units = units
        self._now: dict[str, FloatArray] = {}  # by signal
        self._last = 0.0
        self._begin(0.0)

    def _begin(self, first: float) -> None:
        """Starts anew at a time, since all readings count from the first time on at which there are all of them."""
        self._first, self._sampled = first, 0
        self._best: _Window | None = None
        self._times: list[float] = []
        self._q: list[FloatArray] = []
        self._F: list[list[FloatArray]] = []

    def write(self, name: str, time: float, value: Value) -> None:
        """Takes a change, whose time, s, is not before that of the last one; ignores all but joints and wrenches."""
        if name != _JOINTS and not name.startswith(_WRENCH):
            return
        if name not in self._now:
            self._begin(time)
        self._sample(time)
        self._now[name], self._last = value, time

    def grasp(self, model: ObjectModel, name: str, joints: Sequence[str], start: float) -> RecordedGrasp:
        """The grasp, after all changes.

        Args:
            model: the object.
            name: name of the recording, for messages.
            joints: names of the joints.
            start: the recording's time 0, s since the epoch; 0 for a simulation.

        Raises:
            InvalidFileError: as `quiet_grasp`.
        """
        if _JOINTS not in self._now or len(self._now) < 2:
            raise InvalidFileError(f"{name} must hold joint positions and wrenches, but lacks one of them.")
        self._sample(self._last + 1e-9)
        if self._sampled < _WINDOW:
            lasting = self._last - self._first
            raise InvalidFileError(f"{name} must have all readings for at least 0.3 s, not for {lasting:.2f} s.")
        self._look()
        best = self._best
        if best is None:
            raise InvalidFileError(f"{name}: a finger must press with more than {_TOUCHES} N for 0.3 s, but none does.")
        positions = {joint: float(q) for joint, q in zip(joints, best.q, strict=True) if np.isfinite(q)}
        fingers = {finger: best.felt[k] for k, finger in enumerate(self._fingers) if best.touching[k]}
        # Times of simulations start at 0 in each run, and are not comparable.
        return RecordedGrasp(model, positions, fingers, time=start + best.time if start > 0.0 else None, name=name)

    @property
    def _fingers(self) -> list[str]:
        return [key.removeprefix(_WRENCH) for key in self._now if key != _JOINTS]

    def _sample(self, end: float) -> None:
        """Adds the samples before a time, up to which nothing changes any more."""
        if _JOINTS not in self._now:
            return
        added = 0
        while (at := self._first + self._sampled * _STEP) < end:
            self._times.append(at)
            self._q.append(self._now[_JOINTS])
            self._F.append([value for key, value in self._now.items() if key != _JOINTS])
            if len(self._times) == _BLOCK:
                self._look()
            added += 1
            # In a long time without changes, all windows are alike; only those at its ends are looked at.
            self._sampled += 1 if added != _WINDOW else max(1, int((end - at) / _STEP) - _WINDOW)

    def _look(self) -> None:
        """Looks for a better window in the samples, and drops those that belong to no further one."""
        q, F = np.array(self._q, dtype=np.float64), np.array(self._F, dtype=np.float64).reshape(len(self._q), -1, 6)
        windows = np.arange(len(q) - _WINDOW + 1)[:, None] + np.arange(_WINDOW)
        touching = np.all(np.linalg.norm(F[windows, :, 3:], axis=3) > _TOUCHES, axis=1)
        count = touching.sum(axis=1)
        # Avoid windows in which a joint is unknown that is known at other times. One that never is counts in all.
        gaps = np.isnan(q[windows]).any(axis=1).sum(axis=1)
        unrest = np.nansum(np.ptp(q[windows], axis=1) / self._units, axis=1) / math.radians(1.0) + _A_GAP * gaps
        unrest = unrest + np.nansum(np.ptp(F[windows], axis=1) / _STILL, axis=(1, 2))
        k = int(np.argmin(np.where(count == count.max(), unrest, np.inf)))
        before = (0, -np.inf) if self._best is None else (self._best.count, -self._best.unrest)
        if (count[k], -unrest[k]) > before and count[k]:
            rows = windows[k]
            self._best = _Window(
                int(count[k]),
                touching[k],
                float(unrest[k]),
                float(np.mean([self._times[row] for row in rows])),
                q[rows].mean(axis=0),
                F[rows].mean(axis=0),
            )
        for samples in (self._times, self._q, self._F):
            del samples[: 1 - _WINDOW]
