"""What of contacts' covariances counts, compiled; `contacts.py` says which."""

from tactopose_drake.core.compilation import inlined, kernel
from tactopose_drake.core.kernel_types import Floats2, Floats3, OutFloats2


@kernel
def fill_variances(covariance: Floats3, n_PC: Floats2, out: OutFloats2) -> None:
    """Fills the variances (2, k) of distances and of turns by covariances (k, 6, 6); normals (0, 3) are not known."""
    for i in range(covariance.shape[0]):
        point, turn = _trace(covariance[i], 0), _trace(covariance[i], 3)
        out[0, i], out[1, i] = point / 3.0, turn / 3.0
        if len(n_PC):
            out[0, i] = _along(covariance[i], 0, n_PC[i])
            out[1, i] = 0.5 * (turn - _along(covariance[i], 3, n_PC[i]))


@inlined
def _trace(covariance, first):
    return covariance[first, first] + covariance[first + 1, first + 1] + covariance[first + 2, first + 2]


@inlined
def _along(covariance, first, n):
    """n^T A n of the block A that begins there."""
    total = 0.0
    for i in range(3):
        for k in range(3):
            total += n[i] * covariance[first + i, first + k] * n[k]
    return total
