"""Standard deviations from contacts' covariances, and variances added to these, compiled; see `contacts`."""

import numpy as np

from tactopose_drake.core.compilation import inlined, kernel
from tactopose_drake.core.kernel_types import Floats1, Floats2, Floats3, OutFloats1, OutFloats2, OutFloats3


@kernel
def fill_variances(covariance: Floats3, n_PC: Floats2, out: OutFloats2) -> None:
    """Fills variances (2, k) of distances and of turns from covariances (k, 6, 6); normals (0, 3) are unknown."""
    for i in range(covariance.shape[0]):
        point, turn = _trace(covariance[i], 0), _trace(covariance[i], 3)
        out[0, i], out[1, i] = point / 3.0, turn / 3.0
        if len(n_PC):
            out[0, i] = _along(covariance[i], 0, n_PC[i])
            out[1, i] = 0.5 * (turn - _along(covariance[i], 3, n_PC[i]))


@kernel
def fill_tangential(covariance: Floats3, n_PC: Floats2, out: OutFloats1) -> None:
    """Fills the rms error of points along each of the surface's tangents, shape (k,), m."""
    for i in range(covariance.shape[0]):
        total = _trace(covariance[i], 0)
        outward = _along(covariance[i], 0, n_PC[i]) if len(n_PC) else total / 3.0
        out[i] = np.sqrt(max(0.5 * (total - outward), 0.0))


@kernel
def widen(n_PC: Floats2, outward: Floats1, turn: Floats1, covariance: OutFloats3) -> None:
    """Adds variances (k,) of points along their normals, or along each axis without normals, and of turns."""
    for i in range(covariance.shape[0]):
        for a in range(3):
            covariance[i, 3 + a, 3 + a] += turn[i]
            if len(n_PC):
                for b in range(3):
                    covariance[i, a, b] += outward[i] * n_PC[i, a] * n_PC[i, b]
            else:
                covariance[i, a, a] += outward[i]


@inlined
def _trace(covariance, first):
    return covariance[first, first] + covariance[first + 1, first + 1] + covariance[first + 2, first + 2]


@inlined
def _along(covariance, first, n):
    """n^T A n for the 3 by 3 block A on the diagonal that starts at `first`."""
    total = 0.0
    for i in range(3):
        for k in range(3):
            total += n[i] * covariance[first + i, first + k] * n[k]
    return total
