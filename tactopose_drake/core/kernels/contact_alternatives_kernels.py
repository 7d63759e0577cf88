"""What would be left of a cost's Hessian if one of its contacts were not as told, compiled.

The mixture's cost at a pose counts each contact by what it probably is. Its Hessian, less what one contact adds in so
far as it is as told, is that of the cost in the case that this one is displaced or turned.
"""

import numpy as np

from tactopose_drake.core.compilation import inlined, kernel
from tactopose_drake.core.kernel_types import Floats3, OutFloats4
from tactopose_drake.core.kernels.contact_mixture_kernels import Doubts, find_shares, make_work, mix
from tactopose_drake.core.kernels.grid_kernels import Grid
from tactopose_drake.core.kernels.surface_contact_kernels import Rows, Touch, contact_rows


@inlined
def _energies_and_rows(grid, touch, X, rows, d, n):
    """The contacts' rows (residual, J, smooth, work) at one pose, and the energies that are half their squares."""
    residual, J, smooth, work = rows
    for i in range(touch.p.shape[0]):
        own = Rows(residual[i], J[i], smooth[i], work)
        contact_rows(grid, touch.p[i], touch.n[i], touch.weight_p[i], touch.weight_n[i], X, own)
        d[i, 0] = 0.5 * residual[i, 0] ** 2
        n[i, 0] = 0.0
        for a in range(1, 5):
            n[i, 0] += 0.5 * residual[i, a] ** 2


@kernel
def find_alternatives(grid: Grid, touch: Touch, doubts: Doubts, X: Floats3, hessian: Floats3, left: OutFloats4) -> None:
    """What is left (B, 2 k, 6, 6) of each pose's Hessian (B, 6, 6), as of `mixture_equations`, with one contact false.

    First each in turn is displaced, then each in turn has any normal. What is taken off is what the contact counts for
    in it, no more, so that nothing negative is left.
    """
    k = touch.p.shape[0]
    residual, J, smooth, scratch = np.empty((k, 5)), np.empty((k, 5, 6)), np.empty((k, 4, 6)), np.empty((10, 4))
    d, n, work, shares, cost = np.empty((k, 1)), np.empty((k, 1)), make_work(k, doubts), np.empty((3, 1)), np.empty(1)
    for b in range(X.shape[0]):
        _energies_and_rows(grid, touch, X[b], (residual, J, smooth, scratch), d, n)
        mix(d, n, 1, doubts, cost, work)
        for i in range(k):
            find_shares(i, 1, doubts, work, shares)
            lost_d = max(shares[1, 0] - doubts.closeness[i], 0.0)
            for c in range(6):
                for e in range(6):
                    lost_n = 0.0
                    for a in range(1, 4):
                        lost_n += smooth[i, a, c] * smooth[i, a, e]
                    left[b, i, c, e] = hessian[b, c, e] - lost_d * smooth[i, 0, c] * smooth[i, 0, e]
                    left[b, k + i, c, e] = hessian[b, c, e] - shares[2, 0] * lost_n
