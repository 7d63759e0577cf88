"""Common behaviour of frozen dataclasses of arrays and numbers: equality by value, and dictionaries of plain data."""

import dataclasses
import math
from collections.abc import Hashable, Mapping
from typing import Any, Self, TypeVar

import numpy as np

from tactopose_drake.core.validation import instance_of
from tactopose_drake.errors import InvalidInputError, UnknownNameError

Frozen = TypeVar("Frozen", bound=Any)

_ROUNDING = 1e-12  # largest change by normalising a unit vector or a rotation once more


class ReadOnlyCopies:
    """Base class of frozen dataclasses whose copies, also in other processes, have read-only arrays like the original.

    Plain pickling makes every array writable, and kernels may round differently for writable arrays.
    """

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        seal(self)


class PlainValue(ReadOnlyCopies):
    """Base class of frozen dataclasses whose fields are arrays, numbers, texts, poses, None, or tuples of these.

    Fields excluded from the repr are not part of the value; fields excluded from comparison do not affect equality.
    """

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, type(self)) and not isinstance(self, type(other)):
            return NotImplemented
        ours, theirs = _compared(self), _compared(other)
        return ours.keys() == theirs.keys() and all(_are_equal(ours[name], theirs[name]) for name in ours)

    def __hash__(self) -> int:
        return hash(tuple((name, _hashable(value)) for name, value in _compared(self).items()))

    def to_dict(self) -> dict[str, Any]:
        """The fields by name, for JSON and YAML: arrays as lists, poses as their rows, units unchanged.

        Infinite numbers become None.
        """
        return {name: _plain(value) for name, value in _fields(self).items()}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Self:
        """Inverts `to_dict`, to the last bit.

        Raises:
            InvalidInputError: for an unknown or missing name, or a value that the class does not accept.
        """
        instance_of(f"{cls.__name__}.from_dict", data, Mapping)
        known = [field.name for field in dataclasses.fields(cls) if field.repr]  # type: ignore[arg-type]
        for name in data:
            if name not in known:
                raise UnknownNameError(f"{cls.__name__}.from_dict: a key", name, known)
        try:
            made = cls(**data)
        except TypeError as error:
            raise InvalidInputError(f"{cls.__name__}.from_dict: {error}.") from None
        # Undo changes by repeated normalisation.
        for name, value in _fields(made).items():
            given = np.asarray(data.get(name)) if isinstance(value, np.ndarray) else None
            if given is not None and given.shape == value.shape and np.abs(given - value).max(initial=0.0) < _ROUNDING:
                array = np.array(given, dtype=value.dtype)
                array.setflags(write=value.flags.writeable)
                object.__setattr__(made, name, array)
        return made


def copied(value: Frozen, **fields: Any) -> Frozen:
    """A copy of a frozen dataclass with some fields replaced, by name, without checking them.

    Cached properties are not copied, as they belong to the former values.
    """
    known, other = type(value).__dataclass_fields__, object.__new__(type(value))
    assert fields.keys() <= known.keys(), fields.keys()
    held = value.__dict__
    if len(held) > len(known):
        held = {name: held[name] for name in known}
    other.__dict__.update(held, **fields)
    return other


def seal(value: object) -> None:
    """Makes the arrays of a frozen dataclass, including all that it holds and has cached, a tuple or dict read-only."""
    if isinstance(value, np.ndarray):
        value.setflags(write=False)
    elif isinstance(value, tuple):
        for part in value:
            seal(part)
    elif isinstance(value, dict):
        for part in value.values():
            seal(part)
    elif hasattr(value, "__dataclass_fields__"):
        for part in vars(value).values():
            seal(part)


def numbers(values: Any, digits: int) -> str:
    """Formats numbers in brackets with this number of decimals, for representations."""
    return "[" + ", ".join(f"{value + 0.0:.{digits}f}" for value in np.round(values, digits)) + "]"


def counted(count: int, singular: str, plural: str) -> str:
    """Formats a number of things with their name."""
    return f"{count} {singular if count == 1 else plural}"


def _fields(value: Any) -> dict[str, Any]:
    return {field.name: getattr(value, field.name) for field in dataclasses.fields(value) if field.repr}


def _compared(value: Any) -> dict[str, Any]:
    not_compared = {field.name for field in dataclasses.fields(value) if not field.compare}
    return {name: held for name, held in _fields(value).items() if name not in not_compared}


def _are_equal(one: Any, other: Any) -> bool:
    if hasattr(one, "GetAsMatrix34") and hasattr(other, "GetAsMatrix34"):
        one, other = one.GetAsMatrix34(), other.GetAsMatrix34()
    if isinstance(one, np.ndarray) != isinstance(other, np.ndarray):
        return False
    if isinstance(one, np.ndarray):
        return np.array_equal(one, other, equal_nan=one.dtype.kind == "f" and other.dtype.kind == "f")
    return bool(one == other)


def _hashable(value: Any) -> Hashable:
    if hasattr(value, "GetAsMatrix34"):
        value = value.GetAsMatrix34()
    if isinstance(value, np.ndarray):
        return value.shape, tuple(np.nan_to_num(value).ravel().tolist())
    return value  # type: ignore[no-any-return]


def _plain(value: Any) -> Any:
    if isinstance(value, PlainValue):
        return value.to_dict()
    if isinstance(value, tuple):
        return [_plain(item) for item in value]
    if hasattr(value, "GetAsMatrix34"):
        value = value.GetAsMatrix34()
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    return None if isinstance(value, float) and not math.isfinite(value) else value
