"""A space-filling order of the points of a triangle, compiled."""

import numpy as np

from tactopose_drake.core.compilation import kernel
from tactopose_drake.core.kernel_types import Floats1, Floats2

_DEPTH = 12  # significant base-4 digits of the share: 17 million places in a triangle


@kernel
def triangle_curve(share: Floats1) -> Floats2:
    """Barycentric weights (n, 3) of the points at the given shares, in [0, 1), of a triangle's area.

    Each base-4 digit of the share picks one of the four sub-triangles [B15]: three keep a corner, one is inverted. A
    sub-triangle of size s, negative if inverted, has its corners k at c + s (e_k - m), where m is the centroid of the
    whole triangle: its centroid moves by s / 2 (e_k - m) toward a corner that is kept.
    """
    weights, moved, halves = np.empty((len(share), 3)), np.empty(4), np.full(4, 0.5)
    halves[3] = -0.5
    for n in range(len(share)):
        digits, half = int(share[n] * 4.0**_DEPTH), 0.5
        for a in range(4):
            moved[a] = 0.0
        for k in range(_DEPTH - 1, -1, -1):
            digit = digits >> 2 * k & 3
            moved[digit] += half  # Index 3 is no corner.
            half *= halves[digit]
        # Sums of powers of a half, which are exact.
        left = 1.0 - (moved[0] + moved[1] + moved[2])
        for a in range(3):
            weights[n, a] = (3.0 * moved[a] + left) / 3.0
    return weights
