"""Thins out poses that nearly coincide, compiled."""

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.compilation import kernel
from tactopose_drake.core.kernel_types import Floats3, OutFlags1
from tactopose_drake.core.validation import FloatArray


def distinct_poses(X_PO: FloatArray, length: float, angle: float) -> NDArray[np.bool_]:
    """Marks the first of poses (B, 3, 4) in each cell of this size, m and about rad; shape (B,)."""
    distinct = np.empty(len(X_PO), dtype=np.bool_)
    mark_first_in_cell(X_PO, 1.0 / length, 1.0 / angle, distinct)
    return distinct


@kernel
def mark_first_in_cell(X: Floats3, per_length: float, per_angle: float, distinct: OutFlags1) -> None:
    """Marks the first of the poses in each cell of a grid, by a hash set: cells of equal 64-bit hashes count as one."""
    size = 16
    while size < 4 * X.shape[0]:
        size *= 2
    table = np.zeros(size, dtype=np.uint64)
    for b in range(X.shape[0]):
        key = np.uint64(14695981039346656037)
        for a in range(3):
            for c in range(1, 4):  # Two columns of the rotation determine the third.
                cell = np.int64(np.floor(X[b, a, c] * (per_length if c == 3 else per_angle)))
                key = (key ^ np.uint64(cell)) * np.uint64(1099511628211)
        key |= np.uint64(1)
        place = np.int64(key >> np.uint64(32)) & (size - 1)
        while table[place] != 0 and table[place] != key:
            place = (place + 1) & (size - 1)
        distinct[b] = table[place] == 0
        table[place] = key
