"""Recorded signals: data of a run that is not on a CAN bus, such as joint positions and a camera's poses.

They are stored as JSON lines, one per change: `{"time": 0.25, "name": "joint_positions", "vector": [0.1, ...]}`. Each
line is self-contained, so a truncated file is usable up to its last whole line; numbers are restored to the last bit;
and any language can read the file. NaN is written as `null`, and so is an unknown pose.
"""

import bisect
import dataclasses
import functools
import json
import math
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, Self, TypeAlias

import numpy as np
from pydrake.math import RigidTransform

from tactopose_drake.core.geometry_checks import pose_matrix
from tactopose_drake.core.validation import FloatArray, check_count, finite_array, instance_of, kind_name, number_array
from tactopose_drake.errors import InvalidFileError, InvalidInputError
from tactopose_drake.estimation.prior import PosePrior
from tactopose_drake.resources.yaml_files import shown
from tactopose_drake.systems.line_file import LineFile, lines_of, read_line

_LARGEST = 1e12  # largest time, and largest number of a pose, in SI units; a sensor's readings have no limit

UNKNOWN_POSE = RigidTransform(np.full((3, 4), np.nan))
"""A pose that is unknown, such as the palm's for a while."""

# A vector (FloatArray), a pose (RigidTransform), a prior of a pose (PosePrior), or None: unknown as yet.
Value: TypeAlias = Any
Change: TypeAlias = tuple[str, float, Value]  # name of a signal, time, s, and the value from then on
Write: TypeAlias = Callable[[str, float, Value], None]  # takes a change


@dataclasses.dataclass(frozen=True, eq=False)
class Signal:
    """A value over time, constant between two changes.

    Attributes:
        times: times of the changes in ascending order, at least one, s. Of equal times the last one counts.
        values: the value from each of these times on.

    Raises:
        InvalidInputError: if there is no time, if a time is NaN or less than the one before it, or if the number of
            values differs.
    """

    times: list[float]
    values: list[Value]

    def __post_init__(self) -> None:
        times = number_array("times", self.times, (None,))
        if len(times) != len(self.values):
            raise InvalidInputError(f"times must be as many as the values, {len(self.values)}, not {len(times)}.")
        check_count("times", len(times), "entries")
        wrong = np.isnan(times)
        wrong[1:] |= times[1:] < times[:-1]
        if wrong.any():
            row = int(wrong.argmax())
            raise InvalidInputError(f"times must be in ascending order, but times[{row}] is {times[row]:.15g} s.")

    @classmethod
    def constant(cls, value: Value) -> Self:
        """A signal that has the same value at all times."""
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
    """Records signals in memory or, given a path or a function, there; a context manager.

    Attributes:
        signals: the recorded signals by name; empty if they are not in memory.
        file: the file on disk; None if there is none.
    """

    def __init__(self, path: Path | None = None, pass_on: Write | None = None) -> None:
        """Creates the file.

        Args:
            path: the file to write; an existing one is replaced. None: there is none.
            pass_on: called with each change in place of keeping it in memory.

        Raises:
            InvalidFileError: if the file cannot be written.
        """
        self.signals: dict[str, Signal] = {}
        self._last: dict[str, str] = {}
        self._kinds: dict[str, list[Value]] = {}  # a known value of each signal
        self._time = -math.inf
        self._pass_on: Write = functools.partial(append_change, self.signals) if pass_on is None else pass_on
        self.file = None if path is None else LineFile(path)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self.file is not None:
            self.file.close()

    def write(self, name: str, time: float, value: Value) -> None:
        """Adds a value, unless it equals the signal's last one.

        Args:
            name: name of the signal.
            time: time from which it holds, s; not before that of the last added value of any signal.
            value: a vector, a `RigidTransform`, a `PosePrior`, or None while it is unknown.

        Raises:
            InvalidInputError: if the value could not be read again, because the time is not a number or decreases, or
                the type of the value is not allowed, or its type or length differs from the signal's others. Nothing
                is added.
        """
        instance_of("name", name, str)
        time = float(finite_array("time", time, ()))
        value = _as_value(f"value of {name!r}", value)
        known = self._kinds.setdefault(name, [])
        try:
            _check_like(value, known)
        except ValueError as error:
            raise InvalidInputError(f"value of {name!r} must be like the others, or None, but {error}.") from None
        text = json.dumps(_encode(value), allow_nan=False)
        if self._last.get(name) == text:
            return
        if time < self._time:
            raise InvalidInputError(f"time must be at least the last one, {self._time:.15g} s, not {time:.15g} s.")
        self._last[name], self._time = text, time
        if value is not None and not known:
            known.append(value)
        if self.file is not None:
            self.file.write(f'{{"time": {time!r}, "name": {json.dumps(name)}, {text[1:]}')
            return
        self._pass_on(name, time, value)


class SignalFile:
    """A file of signals, which is read one change after the other.

    Attributes:
        cut: a message that the file was cut off, once its end has been read; empty if not.
    """

    def __init__(self, path: Path) -> None:
        """Keeps the path."""
        self._path, self.cut = path, ""

    def changes(self) -> Iterator[Change]:
        """Name, time, s, and value of each change, up to the last whole line.

        Raises:
            InvalidFileError: if the file cannot be read, or one of its lines is not a signal.
        """
        known: dict[str, list[Value]] = {}  # a known value of each signal
        last = -math.inf
        for number, line in enumerate(lines_of(self._path), 1):
            if not line.endswith("\n"):
                self.cut = f"{self._path} is cut off after {number - 1} whole lines."
                return
            try:
                time, name, value = _read_line(line)
                if time < last:
                    raise ValueError(f"its time is {time:.15g}, after {last:.15g}")
                last = time
                _check_like(value, known.setdefault(name, []))
            except (ArithmeticError, LookupError, RecursionError, RuntimeError, TypeError, ValueError) as error:
                reason = shown(" ".join(str(error).split()))[1:-1]
                raise InvalidFileError(f"{self._path}: line {number} must be a signal ({reason}).") from None
            if value is not None:
                known[name] = [value]
            yield name, time, value


def read_signals(path: Path) -> tuple[dict[str, Signal], str]:
    """Reads a file of signals up to its last whole line.

    Returns:
        The signals by name, and a message if the file was cut off; empty if not.

    Raises:
        InvalidFileError: if the file cannot be read, or one of its lines is not a signal.
    """
    signals: dict[str, Signal] = {}
    file = SignalFile(path)
    for change in file.changes():
        append_change(signals, *change)
    return signals, file.cut


def append_change(signals: dict[str, Signal], name: str, time: float, value: Value) -> None:
    """Adds a value from a time on, s, to the signal of that name, which may be new."""
    if name not in signals:
        signals[name] = Signal([time], [value])
        return
    signals[name].times.append(time)
    signals[name].values.append(value)


def _as_value(name: str, value: Value) -> Value:
    """Checks a value; returns it, or a copy of what the caller, or Drake in a port's cache, may change."""
    if isinstance(value, RigidTransform):
        return RigidTransform(value)
    if value is None or isinstance(value, PosePrior):
        return value
    if not isinstance(value, np.ndarray | list | tuple):
        raise InvalidInputError(
            f"{name} must be a vector, a RigidTransform, a PosePrior or None, not {kind_name(type(value))}."
        )
    return number_array(name, value, (None,))


def _read_line(line: str) -> tuple[float, str, Value]:
    """Time, name and value of a line; raises one of several built-in errors if it is not a signal."""
    entry = read_line(line)
    time, name = entry.pop("time", None), entry.pop("name", None)
    if not isinstance(name, str):
        raise TypeError("its name must be text")
    return _number(time), name, _decode(entry)


def _check_like(value: Value, others: list[Value]) -> None:
    """Raises ValueError if a value's type or shape differs from the signal's earlier values; None fits any signal."""
    other = next((known for known in reversed(others) if known is not None), None)
    if value is not None and other is not None and (type(value), np.shape(value)) != (type(other), np.shape(other)):
        raise ValueError("it differs in kind or length from the signal's others")


def _finite(value: Any) -> float:
    """Checks that a value is a finite number; NumPy would also accept strings and booleans."""
    if not isinstance(value, float | int) or isinstance(value, bool) or not math.isfinite(value):
        raise ValueError(f"{shown(value)} is not a finite number")
    return float(value)


def _number(value: Any) -> float:
    """Checks a time, or a number of a pose."""
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
    raise ValueError(f"{shown(kind)} must be vector, pose, prior or unknown")
