"""Hostile values: what the fuzzer puts in the place of a plausible argument, or does to an array of numbers."""

import copy
import datetime
import decimal
import fractions
import math
from collections.abc import Callable
from typing import Any

import numpy as np

from tests.fuzz.targets import Arguments

Path = tuple[Any, ...]
OWN = ("kind",)
"""Arguments that are no argument of the call, but say which one it is."""
_NUMBERS = [0.0, -0.0, 1.0, -1.0, 1e-300, 1e-160, 1e-20, 1e-9, 1e3, 1e9, 1e20, 1e160, 1e300, 5e-324, -1e300]
_NUMBERS += [math.nan, math.inf, -math.inf]

VALUES: list[Callable[[np.random.Generator], Any]] = [
    *[lambda rng, number=number: number for number in _NUMBERS],
    *[lambda rng, value=value: value for value in (None, True, False, 0, -1, 10**30, 3, 1.5, "a", "3", "", b"3", 1j)],
    lambda rng: decimal.Decimal("0.5"),
    lambda rng: fractions.Fraction(1, 3),
    lambda rng: np.datetime64("2024-01-01"),
    lambda rng: np.timedelta64(5, "s"),
    lambda rng: datetime.timedelta(seconds=1),
    lambda rng: np.float32(0.5),
    lambda rng: np.int8(2),
    lambda rng: np.array(0.5),
    lambda rng: np.array([0.5]),
    lambda rng: np.array(0.5, dtype=object),
    lambda rng: [],
    lambda rng: [[]],
    lambda rng: {},
    lambda rng: (1.0,),
    lambda rng: [[1.0, 2.0], [3.0]],
    lambda rng: object(),
    lambda rng: math.sin,
    lambda rng: np.zeros((0, 3)),
    lambda rng: np.zeros((2, 3, 4)),
    lambda rng: np.eye(4),
    lambda rng: np.eye(3, 4),
    lambda rng: np.ma.masked,
    lambda rng: rng.normal(size=(int(rng.integers(0, 5)), int(rng.integers(0, 5)))),
    lambda rng: np.random.default_rng(0),
    lambda rng: slice(None),
]


def _entries(change: Callable[[np.random.Generator, float], float]) -> Callable[[np.random.Generator, Any], Any]:
    """A change of one entry or of all of them."""

    def corrupt(rng: np.random.Generator, array: Any) -> Any:
        array = np.array(array)
        if not array.size:
            return array
        chosen = array.reshape(-1)[rng.integers(array.size)] if rng.random() < 0.5 else None
        with np.errstate(all="ignore"):
            if chosen is None:
                return np.array([change(rng, float(entry)) for entry in array.ravel()]).reshape(array.shape)
            flat = array.ravel().copy()
            flat[rng.integers(array.size)] = change(rng, float(chosen))
            return flat.reshape(array.shape)

    return corrupt


def _number(rng: np.random.Generator) -> float:
    return _NUMBERS[int(rng.integers(len(_NUMBERS)))]


def _masked(rng: np.random.Generator, array: Any) -> Any:
    return np.ma.masked_array(array, rng.random(np.shape(array)) < 0.3)


def _line(rng: np.random.Generator, array: Any) -> Any:
    """Everything on one line, or in one point."""
    along = np.linspace(0.0, float(rng.choice([0.0, 1e-9, 0.05])), len(array))
    return array[:1] + along.reshape(-1, *[1] * (array.ndim - 1)) * rng.normal(size=array.shape[1:])


ARRAYS: list[Callable[[np.random.Generator, Any], Any]] = [
    _entries(lambda rng, entry: _number(rng)),
    _entries(lambda rng, entry: entry * float(10.0 ** rng.integers(-300, 300))),
    _entries(lambda rng, entry: entry * 1000.0),
    _entries(lambda rng, entry: entry * float(rng.choice([0.0, 1e-3, 1e-8, 1e-16, -1.0, 10.0]))),
    lambda rng, array: np.zeros_like(array),
    lambda rng, array: array[:0] if array.ndim else array,
    lambda rng, array: array[:1] if array.ndim else array,
    lambda rng, array: array[..., None],
    lambda rng, array: array.T,
    lambda rng, array: np.repeat(array, 2, axis=0) if array.ndim else array,
    lambda rng, array: np.broadcast_to(array[:1], array.shape) if array.ndim else array,
    lambda rng, array: _line(rng, array) if array.ndim and len(array) else array,
    lambda rng, array: array.astype(np.float32),
    lambda rng, array: array.astype(">f8"),
    lambda rng, array: array.astype(np.float16),
    lambda rng, array: array.astype(np.int64),
    lambda rng, array: array > 0,
    lambda rng, array: array.astype(str),
    lambda rng, array: array.astype(bytes),
    lambda rng, array: array.astype(object),
    lambda rng, array: array.astype(complex),
    lambda rng, array: np.asfortranarray(array),
    lambda rng, array: array.tolist(),
    lambda rng, array: array.astype("M8[s]") if np.isfinite(array).all() else array,
    lambda rng, array: array.astype("m8[s]") if np.isfinite(array).all() else array,
    _masked,
    lambda rng, array: np.tile(array, (2000, 1)) if array.ndim == 2 else np.tile(array, 2000),
]


SUBTLE: list[Callable[[np.random.Generator, Any], Any]] = [
    _entries(lambda rng, entry: entry * float(10.0 ** rng.uniform(-8, 8))),
    _entries(lambda rng, entry: entry * float(rng.choice([0.0, 1e-3, 1e-8, 1e-16, -1.0, 1.001]))),
    _entries(lambda rng, entry: entry + float(10.0 ** rng.uniform(-8, 0.9))),
    _entries(lambda rng, entry: float(rng.choice([0.0, 1.0, -1.0]))),
    _entries(lambda rng, entry: float(rng.choice([1e-300, 5e-324, -1e-300, 1e-160]))),
    lambda rng, array: np.zeros_like(array),
    lambda rng, array: np.broadcast_to(array[:1], array.shape) if array.ndim else array,
    lambda rng, array: _line(rng, array) if array.ndim and len(array) else array,
    lambda rng, array: array * float(10.0 ** rng.uniform(-8, 2)),
    lambda rng, array: array.astype(np.float16),
    lambda rng, array: np.asfortranarray(array),
    lambda rng, array: array.tolist(),
]


def corrupt(rng: np.random.Generator, arguments: Arguments) -> Arguments:
    """Arguments of which some values, one to three, are replaced or changed."""
    corrupted = copy_data(arguments)
    is_subtle = rng.random() < 0.6  # Mostly values of another kind would be refused, and nothing deeper be reached.
    for _ in range(rng.integers(1, 4)):
        paths = list(_leaves(corrupted))
        path = paths[int(rng.integers(len(paths)))]
        place = corrupted
        for step in path[:-1]:
            place = place[step]
        place[path[-1]] = _corrupt_one(rng, place[path[-1]], is_subtle)
    return corrupted


def _corrupt_one(rng: np.random.Generator, value: Any, is_subtle: bool) -> Any:
    if isinstance(value, np.ndarray) and value.dtype.kind == "f" and rng.random() < 0.9:
        changes = SUBTLE if is_subtle else ARRAYS
        with np.errstate(all="ignore"):
            return changes[int(rng.integers(len(changes)))](rng, np.array(value))
    if isinstance(value, float) and is_subtle:
        return value * float(10.0 ** rng.uniform(-8, 8)) * float(rng.choice([1.0, 1.0, 1.0, -1.0, 0.0]))
    if is_subtle and not isinstance(value, float | np.ndarray):
        return value
    if isinstance(value, float) and rng.random() < 0.5:
        return _number(rng)
    return VALUES[int(rng.integers(len(VALUES)))](rng)


def copy_data(value: Any) -> Any:
    """The same data in new dictionaries, lists and arrays; what else there is stays what it is."""
    if isinstance(value, dict):
        return {name: copy_data(entry) for name, entry in value.items()}
    if isinstance(value, list):
        return [copy_data(entry) for entry in value]
    return copy.copy(value) if isinstance(value, np.ndarray) else value


def _leaves(value: Any, path: Path = ()) -> Any:
    """The paths to every value, those of inner dictionaries and lists too."""
    steps = value.items() if isinstance(value, dict) else enumerate(value)
    for step, entry in steps:
        if step in OWN:
            continue
        yield (*path, step)
        if isinstance(entry, dict | list):
            yield from _leaves(entry, (*path, step))
