"""A space-filling order of the points of a triangle."""

import numpy as np

from tactopose_drake.core.compilation import kernel
from tactopose_drake.core.kernel_types import Floats1, Floats2
from tactopose_drake.core.kernels.sorting_kernels import copy_matrix

_DEPTH = 12  # Base-4 digits of the share that count: 17 million places in a triangle.


@kernel
def triangle_curve(share: Floats1) -> Floats2:
    """Barycentric weights (n, 3) of the points at the given shares, in [0, 1), of a triangle's area.

    Each base-4 digit of the share picks one of the four sub-triangles [B15]: three keep a corner, one is turned.
    """
    weights, corners, opposite = np.empty((len(share), 3)), np.empty((3, 3)), np.empty((3, 3))
    for n in range(len(share)):
        rest = share[n]
        for c in range(3):
            for a in range(3):
                corners[c, a] = 1.0 if a == c else 0.0
        for _ in range(_DEPTH):
            rest *= 4.0
            digit = int(rest)
            rest -= digit
            for a in range(3):
                total = corners[0, a] + corners[1, a] + corners[2, a]
                for c in range(3):
                    opposite[c, a] = 0.5 * (total - corners[c, a])
            if digit == 3:
                copy_matrix(opposite, corners)
            else:
                for a in range(3):
                    kept = corners[digit, a]
                    for c in range(3):
                        corners[c, a] = 0.5 * (kept + corners[c, a])
        for a in range(3):
            weights[n, a] = (corners[0, a] + corners[1, a] + corners[2, a]) / 3.0
    return weights
