"""Checks of input values, each with one clear error that names the value and what is allowed.

What counts as a number is told in `number_kinds`.
"""

import contextlib
import dataclasses
import math
import numbers
import os
from collections.abc import Collection, Iterable, Iterator, Mapping
from operator import mul
from pathlib import Path
from types import MappingProxyType
from typing import Any, Protocol, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactopose_drake.core.number_kinds import as_numbers, entry_of
from tactopose_drake.errors import InvalidInputError, UnknownNameError
from tactopose_drake.errors import shown as shown

FloatArray = NDArray[np.float64]


class Checked(Protocol):
    """Parameters that say what is wrong with them."""

    def validate(self) -> None:
        """Raises InvalidInputError if a parameter is out of its range."""


Params = TypeVar("Params", bound=Checked)

# Coordinates, m, and components of unit vectors count in steps of this: about 1e-9, and exact in binary.
_STEP = 2.0**-30
_LEAST, _MOST = np.nextafter(0.0, 1.0), np.finfo(np.float64).max
_LONG = 1e3
_UNIT_TOLERANCE = 1e-3

FARTHEST = 10.0
"""No point in the palm frame is so far from it, m: one that is must be in millimetres."""
LATEST = 1e12
"""Times are up to this, s: far beyond any clock's, and still told apart to a millisecond."""
MOST_FORCE = 1e6
"""No contact's force is above this, N: simulated ones are large where bodies begin inside of each other."""
MOST_MEASURED_FORCE = 1e3
"""No fingertip's sensor measures more than this, N: what does must be in millinewtons."""
MOST_FRICTION = 1e3
"""A coefficient of friction is not above this."""
MOST_ALPHA = 1.0
"""The depth over pressure of a soft pad, m/Pa, is not above this."""
MOST_OUTLIERS = 0.99
"""More contacts than this share are not taken to be of something else."""


def finite_array(name: str, value: ArrayLike, *shapes: tuple[int | None, ...]) -> FloatArray:
    """Returns `value` as a float64 array of one of the shapes (None: any length) with finite entries only.

    It is a new array, contiguous in C's order, aligned and of the machine's byte order, so that what is computed from
    it depends on nothing but the numbers.

    Raises:
        InvalidInputError: if it is not of numbers, of another shape, or holds a NaN or an infinite number.
    """
    array = number_array(name, value, *shapes)
    _check_finite(name, array)
    return array


def _check_finite(name: str, array: FloatArray) -> None:
    if not np.isfinite(array).all():
        bad = np.argwhere(~np.isfinite(array))[0]
        raise InvalidInputError(f"{entry_of(name, bad)}: is {array[tuple(bad)]}; allowed are finite numbers.")


def number_array(name: str, value: ArrayLike, *shapes: tuple[int | None, ...]) -> FloatArray:
    """As `finite_array`, but NaN and infinite numbers may be among the entries."""
    if type(value) is np.ndarray and value.dtype.char == "d" and any(_fits(value.shape, shape) for shape in shapes):
        return np.array(value, dtype=np.float64, order="C")  # Nothing is wrong: some times as fast.
    array = as_numbers(name, value)
    if not any(_fits(array.shape, shape) for shape in shapes):
        wanted = [str(shape).replace("None", "n") for shape in shapes]
        allowed = f"is {wanted[0]}" if len(wanted) == 1 else f"are {' and '.join(wanted)}"
        raise InvalidInputError(f"{name}: has shape {array.shape}; allowed {allowed}.")
    with np.errstate(over="ignore"):  # What a wider float holds beyond float64 is infinite.
        return np.array(array, dtype=np.float64, order="C")


def _fits(shape: tuple[int, ...], wanted: tuple[int | None, ...]) -> bool:
    if shape == wanted:
        return True
    return len(shape) == len(wanted) and all(n is None or n == m for n, m in zip(wanted, shape, strict=True))


def _is_between(array: FloatArray, least: float, most: float) -> bool:
    """Whether no entry is a NaN or outside of two limits: soon told, where nothing is wrong."""
    return not array.size or bool(least <= array.min() and array.max() <= most)


def positive_number(
    name: str, value: float, *, allow_zero: bool = False, least: float = 0.0, most: float = np.inf, unit: str = ""
) -> float:
    """Returns `value` as a float if it is finite, above zero (or zero, where allowed), and between two limits.

    Raises:
        InvalidInputError: otherwise.
    """
    if type(value) is float and 0.0 < value < np.inf and least <= value <= most:
        return value  # Ten times as fast as what says what is wrong.
    return float(positive_numbers(name, value, (), allow_zero=allow_zero, least=least, most=most, unit=unit))


def positive_numbers(
    name: str,
    value: ArrayLike,
    *shapes: tuple[int | None, ...],
    allow_zero: bool = False,
    least: float = 0.0,
    most: float = np.inf,
    unit: str = "",
) -> FloatArray:
    """Returns an array of finite numbers above zero (or zero, where allowed), and between two limits.

    A unit stands in messages about limits, where a number may be one of another unit.

    Raises:
        InvalidInputError: if it is not one, or of another shape.
    """
    array = number_array(name, value, *shapes)
    if _is_between(array, least or (0.0 if allow_zero else _LEAST), min(most, _MOST)):
        return array
    _check_finite(name, array)
    low = (array < 0.0) | ((array == 0.0) & (not allow_zero))
    outside = ((array < least) & (array > 0.0)) | (array > most)
    for wrong, allowed in (
        (low, f"{'>=' if allow_zero else '>'} 0"),
        (outside, f"from {least:g} to {most:g}{unit and f' {unit}'}{', and 0' if allow_zero and least > 0.0 else ''}"),
    ):
        if wrong.any():
            raise InvalidInputError(f"{name}: is {array[wrong][0]:g}; allowed are numbers {allowed}.")
    return array


def points_near(name: str, value: ArrayLike, shape: tuple[int | None, ...]) -> FloatArray:
    """Returns points (n, 3), m, none of which is evidently in millimetres.

    Raises:
        InvalidInputError: if one is farther than `FARTHEST` from the origin, or they are not finite or of that shape.
    """
    points = number_array(name, value, shape)
    if not _is_between(points, -FARTHEST, FARTHEST):
        _check_finite(name, points)
        i = int(np.abs(points).max(axis=1).argmax())
        raise _far_off(f"{name}[{i}]", points[i])
    return points


def _far_off(name: str, point: FloatArray, most: float = FARTHEST) -> InvalidInputError:
    return InvalidInputError(
        f"{name}: is {point.tolist()}, in metres; allowed are coordinates up to {most:g} m. "
        "Multiply by 0.001 what is in millimetres."
    )


def limited(name: str, value: ArrayLike, *shapes: tuple[int | None, ...], most: float) -> FloatArray:
    """Returns an array of finite numbers whose absolute values are at most `most`.

    Raises:
        InvalidInputError: if it is not one, or of another shape.
    """
    array = number_array(name, value, *shapes)
    if not _is_between(array, -most, most):
        _check_finite(name, array)
        beyond = np.argwhere(np.abs(array) > most)[0]
        worst = array[tuple(beyond)]
        raise InvalidInputError(f"{entry_of(name, beyond)}: is {worst:g}; allowed are numbers up to {most:g}.")
    return array


def whole_number(name: str, value: object, *, least: int, most: int | None = None) -> int:
    """Returns an integer, Python's or numpy's, that is not below `least`, nor above `most`.

    Raises:
        InvalidInputError: if it is out of this range, or of another type; True and False are no integers.
    """
    allowed = f">= {least}" if most is None else f"from {least} to {most}"
    if isinstance(value, bool | np.timedelta64) or not isinstance(value, numbers.Integral):  # A time is no number.
        raise InvalidInputError(f"{name}: is {shown(value)}; allowed are integers {allowed}.")
    number = int(value)
    if number < least or (most is not None and number > most):
        raise InvalidInputError(f"{name}: is {shown(number)}; allowed are integers {allowed}.")
    return number


def flag(name: str, value: object) -> bool:
    """Returns True or False, Python's or numpy's.

    Raises:
        InvalidInputError: if it is neither.
    """
    if not isinstance(value, bool | np.bool_):
        raise InvalidInputError(f"{name}: is {shown(value)}; allowed are True and False.")
    return bool(value)


def known_name(what: str, value: object, valid: Iterable[str]) -> str:
    """Returns a name that is one of the valid ones.

    Raises:
        UnknownNameError: if it is another one, or no string.
    """
    names = list(valid)
    if not isinstance(value, str) or value not in names:
        raise UnknownNameError(what, value, names)
    return value


@contextlib.contextmanager
def told_of(place: str) -> Iterator[None]:
    """Puts where a value stands before what is wrong with it.

    Raises:
        InvalidInputError: whatever error of that kind comes from inside.
    """
    try:
        yield
    except InvalidInputError as error:
        raise InvalidInputError(f"{place}{error}") from None


def instance_of(name: str, value: object, kind: type) -> None:
    """Checks a value's type.

    Raises:
        InvalidInputError: if it is another.
    """
    if not isinstance(value, kind):
        article = "an" if kind.__name__[0] in "AEIO" else "a"
        raise InvalidInputError(f"{name}: is a {type(value).__name__}; allowed is {article} {kind.__name__}.")


def path_of(name: str, value: object) -> Path:
    """Returns a file's or folder's path, whether there is one or not.

    Raises:
        InvalidInputError: if it is neither text nor a path.
    """
    if not isinstance(value, str | os.PathLike):
        raise InvalidInputError(f"{name}: is {shown(value)}; allowed is a path.")
    return Path(value)


def params_of(kind: type[Params], value: Params | None) -> Params:
    """Returns parameters that were given, or for None the default ones, which are in their ranges.

    Raises:
        InvalidInputError: a value of another type, or a parameter that is out of its range.
    """
    params = kind() if value is None else value
    instance_of("params", params, kind)
    params.validate()
    return params


def check_parts(params: object, **kinds: type[Checked]) -> None:
    """Checks parameters that are made of others.

    Args:
        params: of all.
        kinds: of what type each part is, by its name.

    Raises:
        InvalidInputError: a part of another type, or a parameter in it that is out of its range.
    """
    for name, kind in kinds.items():
        part = getattr(params, name)
        instance_of(f"{type(params).__name__}.{name}", part, kind)
        part.validate()


def check_numbers(
    name: str,
    params: Any,
    *,
    may_be_zero: Collection[str] = (),
    most: Mapping[str, float] = MappingProxyType({}),
    units: Mapping[str, str] = MappingProxyType({}),
) -> None:
    """Checks the numbers of a dataclass by their defaults: integers from 1 on, and other numbers above 0.

    A field that is None by default is a number where it is not.

    Args:
        name: of the dataclass, for messages.
        params: the dataclass; fields with another default are left aside.
        may_be_zero: names of fields that may be 0, too.
        most: the largest value of a field, by its name.
        units: of such values, where a number may be one of another unit.

    Raises:
        InvalidInputError: a number that is out of its range, or a value that is none.
    """
    for field in dataclasses.fields(params):
        place, value, zero = f"{name}.{field.name}", getattr(params, field.name), field.name in may_be_zero
        if isinstance(field.default, int) and not isinstance(field.default, bool):
            whole_number(place, value, least=0 if zero else 1)
        elif isinstance(field.default, float) or (field.default is None and value is not None):
            largest, unit = most.get(field.name, math.inf), units.get(field.name, "")
            positive_number(place, value, allow_zero=zero, most=largest, unit=unit)


def unit_vectors(name: str, value: ArrayLike, shape: tuple[int | None, ...]) -> FloatArray:
    """Returns rows of unit length, normalised exactly.

    Raises:
        InvalidInputError: if a row's length differs from 1 by more than 0.001.
    """
    rows = finite_array(name, value, shape)
    largest = np.abs(rows).max(axis=-1, initial=0.0)
    scale = np.where(largest > _LONG, largest, 1.0)  # Squares of more might overflow.
    with np.errstate(over="ignore"):
        length = scale * np.linalg.norm(rows / scale[..., None], axis=-1)
    worst = np.abs(length - 1.0)
    if rows.size and worst.max() > _UNIT_TOLERANCE:
        index = np.unravel_index(int(worst.argmax()), worst.shape)
        raise InvalidInputError(
            f"{entry_of(name, index)}: has length {length[index]:.6g}; allowed is 1 within {_UNIT_TOLERANCE:g}."
        )
    unit: FloatArray = rows / length[..., None]
    return unit


def _is_rotation(columns: list[list[float]]) -> bool:
    """Whether three vectors are orthonormal, within 1e-6, and right-handed; for one, numpy's calls take long."""
    x, y, z = columns
    products = [sum(map(mul, a, b)) for a, b in ((x, x), (y, y), (z, z), (x, y), (y, z), (z, x))]
    is_orthonormal = all(abs(p - one) <= 1e-6 for p, one in zip(products, (1, 1, 1, 0, 0, 0), strict=True))
    across = x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0]
    return is_orthonormal and sum(map(mul, across, z)) > 0.0


def pose_matrix(name: str, value: object) -> FloatArray:
    """Returns a pose as [R | p], shape (3, 4), from such an array, a 4x4 one, or anything with `GetAsMatrix34`.

    Raises:
        InvalidInputError: if it is none of these, if R is not a rotation (within 1e-6), or if a 4x4 matrix's last row
            is not (0, 0, 0, 1).
    """
    matrix: Any = value.GetAsMatrix34() if hasattr(value, "GetAsMatrix34") else value
    X = finite_array(name, matrix, (3, 4), (4, 4))
    R = X[:3, :3]
    if not _is_rotation(R.T.tolist()):
        raise InvalidInputError(f"{name}: its left 3x3 block is not a rotation matrix.")
    if len(X) == 4 and np.abs(X[3] - [0.0, 0.0, 0.0, 1.0]).max() > 1e-6:
        raise InvalidInputError(
            f"{name}: its last row is {X[3].tolist()}; allowed is [0, 0, 0, 1]. Transpose a matrix of columns."
        )
    return X[:3].copy()


def pose_near(name: str, value: object, most: float = FARTHEST) -> FloatArray:
    """As `pose_matrix`, of a pose whose translation is not evidently in millimetres: of coordinates up to `most`, m.

    Raises:
        InvalidInputError: if it is no pose, or farther away.
    """
    X = pose_matrix(name, value)
    if not _is_between(X[:, 3], -most, most):
        raise _far_off(f"{name}.translation", X[:, 3], most)
    return X


def in_steps(values: FloatArray) -> FloatArray:
    """Coordinates, m, or components of unit vectors, rounded to about 1e-9."""
    rounded: FloatArray = np.rint(values / _STEP) * _STEP
    return rounded
