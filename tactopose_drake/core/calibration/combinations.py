"""Combinations of unknowns that data does not determine: they stay as uncertain as they were."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from tactopose_drake.core.validation import FloatArray

_AS_BEFORE = 0.9  # of the prior's standard deviation, from which on a combination is undetermined
_COUNTS = 0.35  # of a combination's largest coefficient, from which on an unknown is named
_NOTHING = 1e-9


class Combination(NamedTuple):
    """A direction in the unknowns that data does not determine.

    Attributes:
        parts: indices of the unknowns in it, the one with the largest coefficient first.
        signs: of the coefficients, relative to the first.
        text: in words.
    """

    parts: tuple[int, ...]
    signs: tuple[int, ...]
    text: str


def undetermined(covariance: FloatArray, names: Sequence[str]) -> tuple[Combination, ...]:
    """The combinations whose posterior is as wide as their prior, each with few unknowns.

    Args:
        covariance: posterior of the unknowns, in units of their prior's standard deviations, shape (d, d).
        names: of the unknowns.
    """
    variances, directions = np.linalg.eigh(covariance)
    basis = directions[:, variances >= _AS_BEFORE**2].T
    return tuple(_named(row, names) for row in _sparse(basis))


def _sparse(basis: FloatArray) -> FloatArray:
    """A sparser basis of the same row space, by Gauss-Jordan elimination with the largest entries as pivots."""
    rows = basis.copy()
    for k in range(len(rows)):
        rest = rows[k:]
        i, j = np.unravel_index(int(np.argmax(np.abs(rest))), rest.shape)
        if abs(rest[i, j]) < _NOTHING:
            return rows[:k]
        swapped = [k, k + int(i)]
        rows[swapped] = rows[swapped[::-1]]
        rows[k] /= rows[k, j]
        others = np.arange(len(rows)) != k
        rows[others] -= np.outer(rows[others, j], rows[k])
    return rows


def _named(row: FloatArray, names: Sequence[str]) -> Combination:
    order = [int(i) for i in np.argsort(-np.abs(row), kind="stable") if abs(row[i]) >= _COUNTS * np.abs(row).max()]
    signs = [1 if row[i] * row[order[0]] > 0 else -1 for i in order]
    same = [names[i] for i, sign in zip(order, signs, strict=True) if sign > 0]
    against = [names[i] for i, sign in zip(order, signs, strict=True) if sign < 0]
    text = " with ".join(same) + (f" against {' with '.join(against)}" if against else "")
    return Combination(tuple(order), tuple(signs), text)
