"""The direction in which the cells of a tactile pad are longer than wide, inferred from their positions."""

import math

import numpy as np
import scipy

from tactopose_drake.core.validation import FloatArray

_NEIGHBOURS = 13  # evaluated for each cell: for cells four times as long as wide, those beside it and the next row
# Ratios of the distance to the next row over the pitch at which cells are longer than wide; rows farther apart are
# separate strips.
_LEAST_RATIO, _MOST_RATIO = 1.5, 4.0
_MOST_RISE = 0.5  # sine of the slope of a step from cell to cell over the pad
_LEAST_AGREEMENT = 0.5  # least length of the mean of the cells' long directions


def find_stretch(p_PT: FloatArray, n_PT: FloatArray) -> FloatArray:
    """How much longer than wide the typical cell is, and in which direction, shape (3,).

    The cells are at positions p_PT (n, 3), m, with normals n_PT (n, 3), and fill the pad without gaps. The stretch has
    the length sqrt(r^2 - 1), where r is the length over the width, so that a cell of half the width h extends by
    h sqrt(1 + (stretch . e)^2) along the unit vector e in the pad. It is zero if cells are nearly square, or lie in one
    row, which leaves it undetermined.
    """
    if len(p_PT) < 3:
        return np.zeros(3)
    near = np.asarray(scipy.spatial.cKDTree(p_PT).query(p_PT, k=min(_NEIGHBOURS, len(p_PT)))[1])
    steps = p_PT[near] - p_PT[:, None]
    pitch = float(np.median(np.linalg.norm(steps[:, 1], axis=1)))
    narrow = np.linalg.eigh(steps[:, 1].T @ steps[:, 1])[1][:, -1]  # column 0 holds the steps to the cells themselves
    long = np.cross(n_PT, narrow)
    aside = np.abs(np.einsum("nki,ni->nk", steps, long))
    rise = np.abs(np.einsum("nki,ni->nk", steps, n_PT))
    is_in_next_row = (aside > np.abs(steps @ narrow)) & (rise < _MOST_RISE * np.linalg.norm(steps, axis=2))
    ratio = float(np.median(np.where(is_in_next_row, aside, np.inf).min(axis=1)) / max(pitch, 1e-12))
    mean = long.mean(axis=0)
    length = float(np.linalg.norm(mean))
    if not _LEAST_RATIO <= ratio <= _MOST_RATIO or length < _LEAST_AGREEMENT:
        return np.zeros(3)
    stretch: FloatArray = math.sqrt(ratio**2 - 1.0) / length * mean
    return stretch
