"""How far modes spread where each contact may be false, compiled; see `doubted_spread.py`."""

import numpy as np

from tactopose_drake.core.compilation import kernel
from tactopose_drake.core.kernel_types import OutFloats3
from tactopose_drake.core.kernels.contact_alternatives_kernels import Alternatives
from tactopose_drake.core.kernels.matrix_kernels import cholesky, invert, solve, solve_transposed, widen

# Of the weight of all, that of what does not count.
_LEAST_WEIGHT = 1e-6


@kernel
def widen_modes(alternatives: Alternatives, covariance: OutFloats3) -> None:
    """Makes covariances (B, 6, 6) no less in any direction than the alternatives together; see `widen_by_doubt`."""
    share, gradient, information = alternatives
    m = share.shape[1]
    weight, step, L, inverse = np.empty(m), np.empty((m, 6)), np.empty((6, 6)), np.empty((6, 6))
    least, root, unit = np.empty((6, 6)), np.zeros((6, 6)), np.empty((6, 6))
    A, values, rows, work = np.empty((6, 6)), np.empty(6), np.empty((6, 6)), np.empty((6, 6))
    for b in range(share.shape[0]):
        most, total = -np.inf, 0.0
        for z in range(m):
            weight[z] = -np.inf
            logarithm = cholesky(information[b, z], L)
            if share[b, z] > 0.0 and np.isfinite(logarithm):
                for i in range(6):
                    step[z, i] = -gradient[b, z, i]
                solve(L, step[z])
                gain = 0.0
                for i in range(6):
                    gain -= 0.5 * gradient[b, z, i] * step[z, i]
                weight[z] = np.log(share[b, z]) + gain - 0.5 * logarithm
            most = max(most, weight[z])
        for z in range(m):
            weight[z] = np.exp(weight[z] - most)
            total += weight[z]
        if not np.isfinite(total):  # No local model is one: there is nothing to compare with.
            continue
        least[:] = 0.0
        for z in range(m):
            if weight[z] > _LEAST_WEIGHT * total:
                cholesky(information[b, z], L)
                invert(L, inverse)
                for i in range(6):
                    for j in range(6):
                        least[i, j] += weight[z] / total * (inverse[i, j] + step[z, i] * step[z, j])
        if not np.isfinite(cholesky(least, L)):  # What is known best and the rest do not fit into doubles.
            continue
        for i in range(6):
            for j in range(6):
                root[i, j] = L[j, i] if i <= j else 0.0
                rows[i, j] = 1.0 if i == j else 0.0
            solve_transposed(L, rows[i], unit[i])
        widen(root, unit, covariance[b], A, values, rows, work)
