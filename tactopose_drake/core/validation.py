"""Checks of input values, each with one clear error that names the value and what is allowed.

`number_kinds` defines what counts as a number.
"""

import contextlib
import functools
import logging
import numbers
import os
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactopose_drake.core.number_kinds import as_numbers, entry_of
from tactopose_drake.errors import InvalidInputError, UnknownNameError
from tactopose_drake.errors import kind_name as kind_name
from tactopose_drake.errors import shown as shown

FloatArray = NDArray[np.float64]


_LEAST, _MOST = np.nextafter(0.0, 1.0), np.finfo(np.float64).max

LATEST = 1e12
"""Largest time, s: far beyond any clock's, and still resolved to a millisecond."""
MOST_FORCE = 1e6
"""Largest force of a contact, N: simulated ones are large if bodies start inside each other."""
MOST_MEASURED_FORCE = 1e3
"""Largest force that a fingertip's sensor measures, N: a larger one must be in millinewtons."""
MOST_FRICTION = 1e3
"""Largest coefficient of friction."""
MOST_ALPHA = 1.0
"""Largest depth over pressure of a soft pad, m/Pa."""
MOST_OUTLIERS = 0.99
"""Largest probability that a contact is with something else than the object."""


@functools.lru_cache(maxsize=64)
def remark(text: str) -> None:
    """Logs once that a value, though allowed, is probably not what was meant: it may be given many times."""
    logging.getLogger("tactopose_drake").warning("%s", text)


def finite_array(name: str, value: ArrayLike, *shapes: tuple[int | None, ...]) -> FloatArray:
    """Returns `value` as a float64 array of one of the shapes (None: any length) with finite entries only.

    It is a new array, C-contiguous, aligned and in native byte order, so that results depend on the numbers only.

    Raises:
        InvalidInputError: if it does not consist of numbers, has another shape, or contains a NaN or an infinity.
    """
    array = number_array(name, value, *shapes)
    check_finite(name, array)
    return array


def check_finite(name: str, array: FloatArray) -> None:
    """Raises InvalidInputError that names the first entry that is NaN or infinite."""
    if not np.isfinite(array).all():
        bad = np.argwhere(~np.isfinite(array))[0]
        raise InvalidInputError(f"{entry_of(name, bad)} must be a finite number, not {array[tuple(bad)]}.")


def number_array(name: str, value: ArrayLike, *shapes: tuple[int | None, ...]) -> FloatArray:
    """The same as `finite_array`, but entries may be NaN and infinite."""
    if type(value) is np.ndarray and value.dtype.char == "d" and any(_fits(value.shape, shape) for shape in shapes):
        return np.array(value, dtype=np.float64, order="C")  # The common case, several times as fast.
    array = as_numbers(name, value, "be a number" if shapes == ((),) else "consist of numbers")
    if not any(_fits(array.shape, shape) for shape in shapes):
        wanted = either([str(shape).replace("None", "n") for shape in shapes])
        raise InvalidInputError(f"{name} must have the shape {wanted}, not {array.shape}.")
    with np.errstate(over="ignore"):  # Numbers of a wider float beyond float64 become infinite.
        return np.array(array, dtype=np.float64, order="C")


def _fits(shape: tuple[int, ...], wanted: tuple[int | None, ...]) -> bool:
    if shape == wanted:
        return True
    return len(shape) == len(wanted) and all(n is None or n == m for n, m in zip(wanted, shape, strict=True))


def is_between(array: FloatArray, least: float, most: float) -> bool:
    """Whether all entries are within the limits and none is NaN; fast if so."""
    return not array.size or bool(least <= array.min() and array.max() <= most)


def positive_number(
    name: str, value: float, *, allow_zero: bool = False, least: float = 0.0, most: float = np.inf, unit: str = ""
) -> float:
    """Returns `value` as a float if it is finite, above zero (or zero, if allowed), and within the limits.

    Raises:
        InvalidInputError: otherwise.
    """
    if type(value) is float and 0.0 < value < np.inf and least <= value <= most:
        return value  # The common case, ten times as fast.
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
    """Returns an array of finite numbers above zero (or zero, if allowed), and within the limits.

    A unit is stated in messages about limits, where a number may be in another unit.

    Raises:
        InvalidInputError: if it is not, or of another shape.
    """
    array = number_array(name, value, *shapes)
    if is_between(array, least or (0.0 if allow_zero else _LEAST), min(most, _MOST)):
        return array
    check_finite(name, array)
    low = (array < 0.0) | ((array == 0.0) & (not allow_zero))
    outside = ((array < least) & (array > 0.0)) | (array > most)
    span = f">= {least:g}" if np.isinf(most) else f"from {least:g} to {most:g}{unit and f' {unit}'}"
    for wrong, allowed in (
        (low, f"{'>=' if allow_zero else '>'} 0"),
        (outside, f"{span}{', or 0' if allow_zero and least > 0.0 else ''}"),
    ):
        if wrong.any():
            where = entry_of(name, np.argwhere(wrong)[0])
            raise InvalidInputError(f"{where} must be a number {allowed}, not {array[wrong][0]:g}.")
    return array


def limited(name: str, value: ArrayLike, *shapes: tuple[int | None, ...], most: float) -> FloatArray:
    """Returns an array of finite numbers whose absolute values are at most `most`.

    Raises:
        InvalidInputError: if it is not, or of another shape.
    """
    array = number_array(name, value, *shapes)
    if not is_between(array, -most, most):
        check_finite(name, array)
        beyond = np.argwhere(np.abs(array) > most)[0]
        allowed = f"a number from {-most:g} to {most:g}"
        raise InvalidInputError(f"{entry_of(name, beyond)} must be {allowed}, not {array[tuple(beyond)]:g}.")
    return array


def whole_number(name: str, value: object, *, least: int, most: int | None = None) -> int:
    """Returns an integer, Python's or numpy's, that is at least `least` and at most `most`.

    Raises:
        InvalidInputError: if it is out of this range, or of another type; True and False are not integers.
    """
    # A time is no number.
    if isinstance(value, numbers.Integral) and not isinstance(value, bool | np.timedelta64):
        value = int(value)
        if least <= value and (most is None or value <= most):
            return value
    allowed = f">= {least}" if most is None else f"from {least} to {most}"
    raise InvalidInputError(f"{name} must be an integer {allowed}, not {shown(value)}.")


def check_count(name: str, count: int, of: str, *, most: int | None = None) -> None:
    """Checks how many parts a value has; `of` names them, in the plural.

    Raises:
        InvalidInputError: if there is none, or more than `most`.
    """
    if not count or (most is not None and count > most):
        allowed = "1 or more" if most is None else f"1 to {most}"
        raise InvalidInputError(f"{name} must have {allowed} {of}, not {count}.")


def flag(name: str, value: object) -> bool:
    """Returns True or False, Python's or numpy's.

    Raises:
        InvalidInputError: if it is neither.
    """
    if not isinstance(value, bool | np.bool_):
        raise InvalidInputError(f"{name} must be True or False, not {shown(value)}.")
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
def told_of(place: str, kind: type[InvalidInputError] = InvalidInputError) -> Iterator[None]:
    """Prefixes errors raised inside with the place of the value.

    Raises:
        InvalidInputError: of this kind, for any such error raised inside.
    """
    try:
        yield
    except InvalidInputError as error:
        raise kind(f"{place}{error}") from None


def instance_of(name: str, value: object, *kinds: type) -> None:
    """Checks that a value's type is one of these.

    Raises:
        InvalidInputError: if it is of another type.
    """
    if not isinstance(value, kinds):
        raise InvalidInputError(
            f"{name} must be {either([kind_name(kind) for kind in kinds])}, not {kind_name(type(value))}."
        )


def either(choices: Sequence[str]) -> str:
    """What is allowed, as messages list it: "x", "x or y", "x, y or z"."""
    return " or ".join(filter(None, [", ".join(choices[:-1]), choices[-1]]))


def path_of(name: str, value: object) -> Path:
    """Returns the path of a file or folder, which need not exist.

    Raises:
        InvalidInputError: if it is neither a string nor a path.
    """
    if not isinstance(value, str | os.PathLike):
        raise InvalidInputError(f"{name} must be a path, not {shown(value)}.")
    return Path(value)
