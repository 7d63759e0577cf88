"""Checks of points, directions and poses, each with one clear error that names the value and what is allowed."""

from operator import mul
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tactopose_drake.core.number_kinds import entry_of
from tactopose_drake.core.validation import FloatArray, check_finite, finite_array, is_between, number_array
from tactopose_drake.errors import InvalidInputError, shown

# Coordinates, m, and components of unit vectors are rounded to multiples of this: about 1e-9, and exact in binary.
_STEP = 2.0**-30
_LONG = 1e3
_UNIT_TOLERANCE = 1e-3

FARTHEST = 10.0
"""Largest coordinate of a point in the palm frame, m: a larger one must be in millimetres."""


def pose_batch(X_PO: ArrayLike) -> FloatArray:
    """Returns poses (B, 3, 4) in the form that kernels read, which is that of nearly all: C-contiguous float64.

    Raises:
        InvalidInputError: if they are of another shape, or do not consist of numbers.
    """
    if type(X_PO) is np.ndarray and X_PO.dtype.char == "d" and X_PO.ndim == 3 and X_PO.shape[1:] == (3, 4):
        return np.ascontiguousarray(X_PO)
    return number_array("X_PO", X_PO, (None, 3, 4))


def points_near(name: str, value: ArrayLike, shape: tuple[int | None, ...]) -> FloatArray:
    """Returns points (n, 3), m, unless any is evidently in millimetres.

    Raises:
        InvalidInputError: if one is farther than `FARTHEST` from the origin, or they are not finite or of that shape.
    """
    points = number_array(name, value, shape)
    if not is_between(points, -FARTHEST, FARTHEST):
        check_finite(name, points)
        i = int(np.abs(points).max(axis=1).argmax())
        raise _far_off(f"{name}[{i}]", points[i])
    return points


def _far_off(name: str, point: FloatArray, most: float = FARTHEST) -> InvalidInputError:
    return InvalidInputError(
        f"{name} must have coordinates from {-most:g} to {most:g} m, not {point.tolist()} m. "
        "Multiply by 0.001 what is in millimetres."
    )


def unit_vectors(name: str, value: ArrayLike, shape: tuple[int | None, ...]) -> FloatArray:
    """Returns rows of unit length, normalised exactly.

    Raises:
        InvalidInputError: if a row's length differs from 1 by more than 0.001.
    """
    rows = finite_array(name, value, shape)
    largest = np.abs(rows).max(axis=-1, initial=0.0)
    scale = np.where(largest > _LONG, largest, 1.0)  # Avoids overflow of the squares.
    with np.errstate(over="ignore"):
        length = scale * np.linalg.norm(rows / scale[..., None], axis=-1)
    worst = np.abs(length - 1.0)
    if rows.size and worst.max() > _UNIT_TOLERANCE:
        index = np.unravel_index(int(worst.argmax()), worst.shape)
        raise InvalidInputError(
            f"{entry_of(name, index)} must have the length 1 within {_UNIT_TOLERANCE:g}, not {length[index]:.6g}."
        )
    unit: FloatArray = rows / length[..., None]
    return unit


def _is_rotation(columns: list[list[float]]) -> bool:
    """Whether three vectors are orthonormal, within 1e-6, and right-handed; for a single one numpy's calls are slow."""
    x, y, z = columns
    products = [sum(map(mul, a, b)) for a, b in ((x, x), (y, y), (z, z), (x, y), (y, z), (z, x))]
    is_orthonormal = all(abs(p - one) <= 1e-6 for p, one in zip(products, (1, 1, 1, 0, 0, 0), strict=True))
    across = x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0]
    return is_orthonormal and sum(map(mul, across, z)) > 0.0


def pose_matrix(name: str, value: object) -> FloatArray:
    """Returns a pose as [R | p], shape (3, 4), from such an array, a 4x4 one, or anything with `GetAsMatrix34`.

    Raises:
        InvalidInputError: if it has another form, if R is not a rotation (within 1e-6), or if a 4x4 matrix's last row
            is not (0, 0, 0, 1).
    """
    matrix: Any = value.GetAsMatrix34() if hasattr(value, "GetAsMatrix34") else value
    X = finite_array(name, matrix, (3, 4), (4, 4))
    R = X[:3, :3]
    if not _is_rotation(R.T.tolist()):
        raise InvalidInputError(f"{name} must have a rotation matrix as its left 3x3 block, not {shown(R.tolist())}.")
    if len(X) == 4 and np.abs(X[3] - [0.0, 0.0, 0.0, 1.0]).max() > 1e-6:
        raise InvalidInputError(
            f"{name} must have the last row [0, 0, 0, 1], not {X[3].tolist()}. Transpose a matrix of columns."
        )
    return X[:3].copy()


def pose_near(name: str, value: object, most: float = FARTHEST) -> FloatArray:
    """The same as `pose_matrix`, for a pose whose coordinates of the translation are at most `most`, m.

    Raises:
        InvalidInputError: if the pose is invalid, or farther away.
    """
    X = pose_matrix(name, value)
    if not is_between(X[:, 3], -most, most):
        raise _far_off(f"{name}.translation", X[:, 3], most)
    return X


def in_steps(values: FloatArray) -> FloatArray:
    """Coordinates, m, or components of unit vectors, rounded to about 1e-9."""
    rounded: FloatArray = np.rint(values / _STEP) * _STEP
    return rounded
