"""Of poses that nearly coincide the first."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tactopose_drake.core.validation import FloatArray


def distinct_poses(X_PO: FloatArray, length: float, angle: float) -> NDArray[np.bool_]:
    """Marks, of poses (B, 3, 4), the first in each cell of this size, m and about rad; shape (B,)."""
    distinct = np.empty(len(X_PO), dtype=np.bool_)
    _mark_first_in_cell(X_PO, 1.0 / length, 1.0 / angle, distinct)
    return distinct


@njit(cache=True)
def _mark_first_in_cell(X, per_length, per_angle, distinct):  # type: ignore[no-untyped-def]
    """By a table of hashes: cells that share all 64 bits are taken for one."""
    size = 16
    while size < 4 * X.shape[0]:
        size *= 2
    table = np.zeros(size, dtype=np.uint64)
    for b in range(X.shape[0]):
        key = np.uint64(14695981039346656037)
        for a in range(3):
            for c in range(1, 4):  # Two columns of the rotation say the third.
                cell = np.int64(np.floor(X[b, a, c] * (per_length if c == 3 else per_angle)))
                key = (key ^ np.uint64(cell)) * np.uint64(1099511628211)
        key |= np.uint64(1)
        place = np.int64(key >> np.uint64(32)) & (size - 1)
        while table[place] != 0 and table[place] != key:
            place = (place + 1) & (size - 1)
        distinct[b] = table[place] == 0
        table[place] = key
