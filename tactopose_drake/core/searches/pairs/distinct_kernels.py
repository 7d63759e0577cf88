"""Marks the first of the poses in each cell of a grid over poses, compiled."""

import numpy as np

from tactopose_drake.core.compilation import kernel
from tactopose_drake.core.kernel_types import Floats3, OutFlags1


@kernel
def mark_first_in_cell(X: Floats3, per_length: float, per_angle: float, distinct: OutFlags1) -> None:
    """Uses a hash set; cells whose 64-bit hashes are equal are taken for the same."""
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
