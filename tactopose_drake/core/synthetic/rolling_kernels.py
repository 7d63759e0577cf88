"""Nearest points of a mesh, for fingertips that roll along it, compiled."""

import numpy as np

from tactopose_drake.core.compilation import kernel
from tactopose_drake.core.kernel_types import Floats1, Floats2, OutFloats2
from tactopose_drake.core.shape.distance_kernels import closest_weights


@kernel
def nearest_points(packed: Floats2, middle: Floats2, reach: Floats1, q: Floats2, nearest: OutFloats2) -> None:
    """Fills the mesh's points (k, 3) nearest to the points q (k, 3); faces out of reach are skipped."""
    for i in range(q.shape[0]):
        least = np.inf
        for f in range(packed.shape[0]):
            far = 0.0
            for a in range(3):
                far += (q[i, a] - middle[f, a]) ** 2
            bound = least + reach[f]
            if far >= bound * bound:
                continue
            t = packed[f]
            v, w = closest_weights(t, q[i, 0], q[i, 1], q[i, 2])
            square = 0.0
            for a in range(3):
                square += (q[i, a] - t[a] - v * t[3 + a] - w * t[6 + a]) ** 2
            if square < least * least:
                least = np.sqrt(square)
                for a in range(3):
                    nearest[i, a] = t[a] + v * t[3 + a] + w * t[6 + a]
