"""Conversion of plain data, such as JSON, to the field values of results, with checks."""

from collections.abc import Callable, Mapping
from typing import Any, TypeVar, get_args

import numpy as np

from tactopose_drake.core.plain_values import PlainValue
from tactopose_drake.core.statuses import Status
from tactopose_drake.core.validation import (
    FloatArray,
    finite_array,
    instance_of,
    known_name,
    positive_number,
    positive_numbers,
    shown,
)
from tactopose_drake.errors import InvalidInputError

Part = TypeVar("Part", bound=PlainValue)
Read = Callable[[str, Any], Any]
Readers = Mapping[str, Read]
"""Functions that read values, by the names of an object's fields."""

_WHOLE = 1.0 + 1e-9  # largest probability, with rounding
_ROUNDING = 1e-4  # tolerance of correlations: covariances may have been written with few digits


def read_fields(owner: type, data: Mapping[str, Any], readers: Readers) -> dict[str, Any]:
    """Converts the values in plain data to those of an object's fields.

    Args:
        owner: the object's class, for messages.
        data: plain data by the fields' names; names may be missing or unknown.
        readers: functions that convert the values, by name; values of other names are kept.

    Raises:
        InvalidInputError: if `data` is not a mapping, or a value is invalid for its field.
    """
    instance_of(f"{owner.__name__}.from_dict", data, Mapping)
    return {name: readers[name](name, value) if name in readers else value for name, value in data.items()}


def read_parts(owner: type, name: str, value: object, kind: type[Part]) -> tuple[Part, ...]:
    """Reads a list of one or more parts of a class.

    Raises:
        InvalidInputError: if the value is not a list or empty, or a part is invalid.
    """
    if not isinstance(value, list | tuple):
        raise InvalidInputError(f"{name} must be a list of at least one, not {shown(value)}.")
    if not value:
        raise InvalidInputError(f"{owner.__name__}.from_dict: {name} must be at least one, not none.")
    parts = []
    for i, part in enumerate(value):
        try:
            parts.append(kind.from_dict(part))
        except InvalidInputError as error:
            error.args = (f"{name}[{i}]: {error}",)
            raise
    return tuple(parts)


def read_number(name: str, value: Any) -> float:
    """A finite number."""
    return float(finite_array(name, value, ()))


def read_amount(name: str, value: Any) -> float:
    """A finite number that is not below 0."""
    return positive_number(name, value, allow_zero=True)


def number_or(infinite: float, read: Read = read_number) -> Read:
    """A reader of numbers that may be infinite, which is None in plain data."""
    return lambda name, value: infinite if value is None or value == infinite else read(name, value)


def read_share(name: str, value: Any) -> float:
    """A probability."""
    return min(positive_number(name, value, allow_zero=True, most=_WHOLE), 1.0)


def read_shares(name: str, value: Any) -> FloatArray:
    """Probabilities, shape (k,)."""
    return positive_numbers(name, value, (None,), allow_zero=True, most=_WHOLE)


def read_covariance(name: str, value: Any) -> FloatArray:
    """A covariance matrix of a pose's increments, shape (6, 6), checked up to rounding."""
    covariance = finite_array(name, value, (6, 6))
    variance = np.diag(covariance)
    if variance.min() < 0.0:
        raise InvalidInputError(f"{name} must have variances >= 0, not {variance.min():g}.")
    sigma = np.sqrt(np.where(variance > 0.0, variance, 1.0))
    with np.errstate(over="ignore", invalid="ignore"):  # An infinite or NaN correlation fails the check below.
        correlation = covariance / sigma[:, None] / sigma
        off = np.abs(correlation - correlation.T).max()
    if off > _ROUNDING:
        raise InvalidInputError(f"{name} must be symmetric, not of correlations that differ by {off:.3g}.")
    if np.isnan(off) or np.linalg.eigvalsh(correlation)[0] < -_ROUNDING:
        raise InvalidInputError(
            f"{name} must be positive semidefinite, but some combination of errors has a variance below 0."
        )
    return covariance


def read_status(name: str, value: Any) -> str:
    """The status of an estimate."""
    return known_name(name, value, get_args(Status))
