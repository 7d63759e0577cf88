"""Signals: what changes over a run and is not on a CAN bus, such as joint positions and what a camera says.

They are kept as JSON lines, one a change: `{"time": 0.25, "name": "joint_positions", "vector": [0.1, ...]}`. A line is
whole by itself, so a file that is cut off is good to its last whole line; a number is written so that it comes back to
the last bit; and any language reads it. NaN is `null`, and so is a pose that is not known.
"""

import bisect
import dataclasses
import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Self, TypeAlias

import numpy as np
from pydrake.math import RigidTransform

from tactopose_drake.core.geometry_checks import pose_matrix
from tactopose_drake.core.validation import FloatArray, finite_array, instance_of, number_array
from tactopose_drake.errors import InvalidFileError, InvalidInputError
from tactopose_drake.estimation.prior import PosePrior
from tactopose_drake.resources.yaml_files import shown
from tactopose_drake.systems.line_file import LineFile

_LARGEST = 1e12  # of a time, and of a pose's numbers, in SI units; a sensor's readings may be anything

UNKNOWN_POSE = RigidTransform(np.full((3, 4), np.nan))
"""Of a palm, say, of which nothing is known for a while."""

# A vector (FloatArray), a pose (RigidTransform), what is known of a pose (PosePrior), or None: not known yet.
Value: TypeAlias = Any


@dataclasses.dataclass(frozen=True, eq=False)
class Signal:
    """A value over time, which stays as it is between two changes.

    Attributes:
        times: of the changes, at least one, s; none before the one before it. Of equal ones the last one counts.
        values: as many, from each time on.

    Raises:
        InvalidInputError: no time, one that falls or is NaN, or another number of values.
    """

    times: list[float]
    values: list[Value]

    def __post_init__(self) -> None:
        times = number_array("times", self.times, (None,))
        if len(times) != len(self.values):
            raise InvalidInputError(f"times: are {len(times)}, and values {len(self.values)}; allowed are as many.")
        if not len(times):
            raise InvalidInputError("times: are none; allowed is one or more.")
        wrong = np.isnan(times)
        wrong[1:] |= times[1:] < times[:-1]
        if wrong.any():
            row = int(wrong.argmax())
            raise InvalidInputError(f"times[{row}]: is {times[row]:g} s; allowed are numbers that do not fall.")

    @classmethod
    def constant(cls, value: Value) -> Self:
        """One value for ever."""
        return cls([-np.inf], [value])

    def at(self, time: float) -> Value:
        """The value at a time in s; None before the first."""
        row = bisect.bisect_right(self.times, time) - 1
        return self.values[row] if row >= 0 else None

    @property
    def size(self) -> int:
        """Length of the vectors.

        Raises:
            InvalidInputError: if the values are not vectors of one length.
        """
        size = len(number_array("values[0]", self.values[0], (None,)))
        for row, value in enumerate(self.values):
            number_array(f"values[{row}]", value, (size,))
        return size


class SignalRecorder:
    """Keeps signals in memory, or on disk where it is told to; a context manager.

    Attributes:
        signals: by name; empty where they are on disk.
        file: on disk; None where they are in memory.
    """

    def __init__(self, path: Path | None = None) -> None:
        """Creates the file.

        Args:
            path: an existing file is replaced; only memory is used without.

        Raises:
            InvalidFileError: if the file cannot be written.
        """
        self.signals: dict[str, Signal] = {}
        self._last: dict[str, str] = {}
        self._kinds: dict[str, list[Value]] = {}  # of each signal a value that is known
        self._time = -math.inf
        self.file = None if path is None else LineFile(path)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self.file is not None:
            self.file.close()

    def write(self, name: str, time: float, value: Value) -> None:
        """Adds a value, unless it is the signal's last one.

        Args:
            name: of the signal.
            time: from when on it holds, s; not before that of the last value that was added, of whichever signal.
            value: a vector, a `RigidTransform`, a `PosePrior`, or None while it is not known.

        Raises:
            InvalidInputError: what could not be read again: a time that is none or falls, or a value of another type,
                or of another kind or length than the signal's others. Nothing is added.
        """
        instance_of("name", name, str)
        time = float(finite_array("time", time, ()))
        value = _as_value(f"value of {name!r}", value)
        known = self._kinds.setdefault(name, [])
        try:
            _check_like(value, known)
        except ValueError as error:
            raise InvalidInputError(f"value of {name!r}: {error}; allowed are such as before, and None.") from None
        text = json.dumps(_encode(value), allow_nan=False)
        if self._last.get(name) == text:
            return
        if time < self._time:
            raise InvalidInputError(f"time: is {time:g} s, after {self._time:g} s; allowed are times that do not fall.")
        self._last[name], self._time = text, time
        if value is not None and not known:
            known.append(value)
        if self.file is not None:
            self.file.write(f'{{"time": {time!r}, "name": {json.dumps(name)}, {text[1:]}')
            return
        _append(self.signals, name, time, value)


def read_signals(path: Path) -> tuple[dict[str, Signal], str]:
    """Reads a file of signals, as far as it is whole.

    Returns:
        The signals by name, and a message if the file was cut off; empty if not.

    Raises:
        InvalidFileError: if the file cannot be read, or a line of it is no signal.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise InvalidFileError(f"{path}: cannot be read ({' '.join(str(error).split())}).") from None
    whole, newline, rest = text.rpartition("\n")
    signals: dict[str, Signal] = {}
    lines = whole.split("\n") if newline else []
    last = -math.inf
    for number, line in enumerate(lines, 1):
        try:
            time, name, value = _read_line(line)
            if time < last:
                raise ValueError(f"its time is {time:g}, after {last:g}")
            last = time
            _check_like(value, signals[name].values if name in signals else [])
        except (ArithmeticError, LookupError, RecursionError, RuntimeError, TypeError, ValueError) as error:
            reason = shown(" ".join(str(error).split()))[1:-1]
            raise InvalidFileError(f"{path}: line {number} is no signal ({reason}).") from None
        _append(signals, name, time, value)
    return signals, f"{path}: is cut off after {len(lines)} whole lines." if rest else ""


def _as_value(name: str, value: Value) -> Value:
    """A value that can be kept, a vector as a copy of its own."""
    if value is None or isinstance(value, PosePrior | RigidTransform):
        return value
    if not isinstance(value, np.ndarray | list | tuple):
        raise InvalidInputError(
            f"{name}: is a {type(value).__name__}; allowed are a vector, a RigidTransform, a PosePrior and None."
        )
    return number_array(name, value, (None,))


def _append(signals: dict[str, Signal], name: str, time: float, value: Value) -> None:
    """Adds a value to one of the signals, which may be new."""
    if name not in signals:
        signals[name] = Signal([time], [value])
        return
    signals[name].times.append(time)
    signals[name].values.append(value)


def _read_line(line: str) -> tuple[float, str, Value]:
    """Time, name and value; any of several errors for a line that is no signal."""
    entry = json.loads(line, object_pairs_hook=_unique, parse_constant=_refuse)
    if not isinstance(entry, dict):
        raise TypeError("it is no mapping")
    time, name = entry.pop("time", None), entry.pop("name", None)
    if not isinstance(name, str):
        raise TypeError("its name is no text")
    return _number(time), name, _decode(entry)


def _check_like(value: Value, others: list[Value]) -> None:
    """Raises ValueError if a value is not of the kind and length of its signal's others; None is of any kind."""
    other = next((known for known in reversed(others) if known is not None), None)
    if value is not None and other is not None and (type(value), np.shape(value)) != (type(other), np.shape(other)):
        raise ValueError("it is of another kind or length than the signal's others")


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    entry = dict(pairs)
    if len(entry) < len(pairs):
        raise ValueError("a key is given twice")
    return entry


def _refuse(text: str) -> float:
    raise ValueError(f"{text} is no number")


def _finite(value: Any) -> float:
    """A finite number. NumPy would take text and booleans for some."""
    if not isinstance(value, float | int) or isinstance(value, bool) or not math.isfinite(value):
        raise ValueError(f"{shown(value)} is no finite number")
    return float(value)


def _number(value: Any) -> float:
    """A time, or a number of a pose."""
    if abs(number := _finite(value)) > _LARGEST:
        raise ValueError(f"{shown(value)} is beyond {_LARGEST:g}")
    return number


def _matrix(rows: Any) -> FloatArray:
    return np.array([[_number(value) for value in row] for row in rows], dtype=np.float64)


def _encode(value: Value) -> Mapping[str, Any]:
    if isinstance(value, PosePrior):
        prior = {"X_PO": value.mean.tolist(), "translation": value.sigma_translation, "rotation": value.sigma_rotation}
        return {"prior": prior}
    if isinstance(value, RigidTransform):
        pose: FloatArray = value.GetAsMatrix34()
        return {"pose": pose.tolist() if np.isfinite(pose).all() else None}
    if value is None:
        return {"unknown": True}
    return {"vector": [number if np.isfinite(number) else None for number in value.tolist()]}


def _decode(entry: dict[str, Any]) -> Value:
    ((kind, data),) = entry.items()
    if kind == "vector":
        return np.array([np.nan if number is None else _finite(number) for number in data], dtype=np.float64)
    if kind == "pose":
        return UNKNOWN_POSE if data is None else RigidTransform(pose_matrix("pose", _matrix(data)))
    if kind == "prior":
        return PosePrior(_matrix(data["X_PO"]), _number(data["translation"]), _number(data["rotation"]))
    if kind == "unknown":
        return None
    raise ValueError(f"{shown(kind)} is none of vector, pose, prior, unknown")
