"""Checks of input values, each with one clear error that names the value and what is allowed."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactopose_drake.errors import InvalidInputError

FloatArray = NDArray[np.float64]


def finite_array(name: str, value: ArrayLike, *shapes: tuple[int | None, ...]) -> FloatArray:
    """Returns `value` as a float64 array of one of the shapes (None: any length) with finite entries only.

    Raises:
        InvalidInputError: if it is not numeric, of another shape, or holds a NaN or an infinite number.
    """
    try:
        array = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InvalidInputError(f"{name}: not an array of numbers ({error}).") from None
    if not any(_fits(array.shape, shape) for shape in shapes):
        wanted = [str(shape).replace("None", "n") for shape in shapes]
        allowed = f"is {wanted[0]}" if len(wanted) == 1 else f"are {' and '.join(wanted)}"
        raise InvalidInputError(f"{name}: has shape {array.shape}; allowed {allowed}.")
    if not np.isfinite(array).all():
        bad = np.argwhere(~np.isfinite(array))[0]
        index = ", ".join(str(int(i)) for i in bad)
        where = f"{name}[{index}]" if index else name
        raise InvalidInputError(f"{where}: is {array[tuple(bad)]}; allowed are finite numbers.")
    return array


def _fits(shape: tuple[int, ...], wanted: tuple[int | None, ...]) -> bool:
    return len(shape) == len(wanted) and all(n is None or n == m for n, m in zip(wanted, shape, strict=True))


def positive_number(name: str, value: float, *, allow_zero: bool = False) -> float:
    """Returns `value` as a float if it is finite and above zero (or zero, where allowed).

    Raises:
        InvalidInputError: otherwise.
    """
    number = float(finite_array(name, value, ()))
    if number < 0 or (number == 0 and not allow_zero):
        raise InvalidInputError(f"{name}: is {number:g}; allowed are numbers {'>=' if allow_zero else '>'} 0.")
    return number


def unit_vectors(name: str, value: ArrayLike, shape: tuple[int | None, ...], tolerance: float = 1e-3) -> FloatArray:
    """Returns rows of unit length, normalised exactly.

    Raises:
        InvalidInputError: if a row's length differs from 1 by more than `tolerance`.
    """
    rows = finite_array(name, value, shape)
    length = np.linalg.norm(rows, axis=-1)
    worst = np.abs(length - 1.0)
    if rows.size and worst.max() > tolerance:
        index = np.unravel_index(int(worst.argmax()), worst.shape)
        where = f"{name}[{', '.join(str(int(i)) for i in index)}]" if index else name
        raise InvalidInputError(f"{where}: has length {length[index]:.6g}; allowed is 1 within {tolerance:g}.")
    unit: FloatArray = rows / length[..., None]
    return unit


def pose_matrix(name: str, value: object) -> FloatArray:
    """Returns a pose as [R | p], shape (3, 4), from such an array, a 4x4 one, or anything with `GetAsMatrix34`.

    Raises:
        InvalidInputError: if it is none of these, or if R is not a rotation (within 1e-6).
    """
    matrix = value.GetAsMatrix34() if hasattr(value, "GetAsMatrix34") else value
    X = finite_array(name, matrix, (3, 4), (4, 4))  # type: ignore[arg-type]
    R = X[:3, :3]
    if np.abs(R.T @ R - np.eye(3)).max() > 1e-6 or np.linalg.det(R) < 0:
        raise InvalidInputError(f"{name}: its left 3x3 block is not a rotation matrix.")
    return X[:3].copy()
