"""What frozen dataclasses of arrays and numbers have in common: equality by value, and dictionaries of plain data."""

import dataclasses
import math
from collections.abc import Hashable, Mapping
from typing import Any, Self, TypeVar

import numpy as np

from tactopose_drake.core.validation import instance_of
from tactopose_drake.errors import InvalidInputError, UnknownNameError

Frozen = TypeVar("Frozen", bound=Any)

_ROUNDING = 1e-12  # what normalising a unit vector or a rotation once more may change


class PlainValue:
    """The base of a frozen dataclass whose fields are arrays, numbers, texts, poses, None, or tuples of such.

    Fields that its repr leaves out are no part of the value; for those that are not compared equality has no regard.
    """

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, type(self)) and not isinstance(self, type(other)):
            return NotImplemented
        ours, theirs = _compared(self), _compared(other)
        return ours.keys() == theirs.keys() and all(_are_equal(ours[name], theirs[name]) for name in ours)

    def __hash__(self) -> int:
        return hash(tuple((name, _hashable(value)) for name, value in _compared(self).items()))

    def __setstate__(self, state: dict[str, Any]) -> None:
        # Copies, and those in other processes, are read-only too: kernels may round otherwise for writable arrays.
        for value in state.values():
            if isinstance(value, np.ndarray):
                value.setflags(write=False)
        self.__dict__.update(state)

    def to_dict(self) -> dict[str, Any]:
        """The fields by name, as JSON and YAML take them: arrays as lists, poses as their rows, m and rad as here.

        What is infinite is None.
        """
        return {name: _plain(value) for name, value in _fields(self).items()}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Self:
        """What `to_dict` has made it of, to the last bit.

        Raises:
            InvalidInputError: for an unknown or missing name, or a value that the class does not take.
        """
        instance_of(f"{cls.__name__}.from_dict", data, Mapping)
        known = [field.name for field in dataclasses.fields(cls) if field.repr]  # type: ignore[arg-type]
        for name in data:
            if name not in known:
                raise UnknownNameError(f"{cls.__name__}.from_dict", name, known)
        try:
            made = cls(**data)
        except TypeError as error:
            raise InvalidInputError(f"{cls.__name__}.from_dict: {error}.") from None
        # What the class has normalised once more is to be what it was.
        for name, value in _fields(made).items():
            given = np.asarray(data.get(name)) if isinstance(value, np.ndarray) else None
            if given is not None and given.shape == value.shape and np.abs(given - value).max(initial=0.0) < _ROUNDING:
                array = np.array(given, dtype=value.dtype)
                array.setflags(write=value.flags.writeable)
                object.__setattr__(made, name, array)
        return made


def copied(value: Frozen, **fields: Any) -> Frozen:
    """A frozen dataclass with other values of some fields, by name, which are not checked anew.

    What it has cached is of the values before, and is left out.
    """
    known, other = type(value).__dataclass_fields__, object.__new__(type(value))
    assert fields.keys() <= known.keys(), fields.keys()
    held = value.__dict__
    if len(held) > len(known):
        held = {name: held[name] for name in known}
    other.__dict__.update(held, **fields)
    return other


def seal(value: object) -> None:
    """Makes the arrays of a frozen dataclass, of all that it holds and has cached, or of a tuple, read-only."""
    if isinstance(value, np.ndarray):
        value.setflags(write=False)
    elif isinstance(value, tuple):
        for part in value:
            seal(part)
    elif hasattr(value, "__dataclass_fields__"):
        for part in vars(value).values():
            seal(part)


def numbers(values: Any, digits: int) -> str:
    """Numbers in brackets with so many decimals, as short representations have them."""
    return "[" + ", ".join(f"{value + 0.0:.{digits}f}" for value in np.round(values, digits)) + "]"


def counted(count: int, singular: str, plural: str) -> str:
    """A number of things, with their name."""
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
