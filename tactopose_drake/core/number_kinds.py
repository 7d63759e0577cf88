"""The definition of a number in input values.

Numbers are integers and floats of any width, Python's or numpy's, alone, in lists and tuples, or in arrays. All are
converted to float64. Nothing else is a number: no boolean, no string of digits, no complex, decimal or fraction, no
date, no object, and no masked entry of an array (whatever is behind the mask).
"""

from collections.abc import Iterable
from typing import Any

import numpy as np

from tactopose_drake.errors import InvalidInputError, shown

_DEEPEST = 8  # nesting of lists


def as_numbers(name: str, value: object, allowed: str) -> np.ndarray[Any, Any]:
    """Returns `value` as an array of integers or floats of any width.

    `allowed` says in messages what it must do, such as "be a number" or "consist of numbers".

    Raises:
        InvalidInputError: if it contains anything but numbers, or if it is ragged.
    """
    try:
        _check_numbers(name, value, allowed)
        array = np.asarray(value)
        if array.dtype.kind == "O" and _are_large(value):
            array = array.astype(np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        if isinstance(error, InvalidInputError):
            raise
        raise InvalidInputError(f"{name} must {allowed} ({error}).") from None
    if array.dtype.kind not in "iuf":
        raise InvalidInputError(f"{name} must {allowed}, not {shown(value)} of type {array.dtype}.")
    return array


def _check_numbers(name: str, value: object, allowed: str, depth: int = 0) -> None:
    """Raises if a value contains anything but numbers, some of which numpy would silently convert."""
    if isinstance(value, np.ma.MaskedArray):
        masked = np.argwhere(np.ma.getmaskarray(value))
        if len(masked):
            raise InvalidInputError(f"{entry_of(name, masked[0])} must be a finite number, not masked.")
    elif isinstance(value, list | tuple):
        if depth > _DEEPEST:
            raise InvalidInputError(f"{name} must be a number, not another list, {depth + 1} deep.")
        for i, entry in enumerate(value):
            if type(entry) is not float:
                _check_numbers(f"{name}[{i}]", entry, "be a number", depth + 1)
    elif value is None or isinstance(value, str | bytes | bytearray | bool | np.bool_):
        raise InvalidInputError(f"{name} must {allowed}, not {shown(value)}.")
    elif isinstance(value, np.ndarray) and value.dtype.kind not in "iufO":
        raise InvalidInputError(f"{name} must {allowed}, not {shown(value)} of type {value.dtype}.")


def _are_large(value: object) -> bool:
    """Whether a value that numpy stores as objects consists of Python's integers and floats only."""
    if isinstance(value, list | tuple):
        return all(_are_large(entry) for entry in value)
    return isinstance(value, int | float)


def entry_of(name: str, index: Iterable[Any]) -> str:
    """The name of an array's entry in messages."""
    inside = ", ".join(str(int(i)) for i in index)
    return f"{name}[{inside}]" if inside else name
