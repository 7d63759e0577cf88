"""The Hessian of a cost that remains if one of its contacts is an outlier, compiled.

The mixture's cost at a pose weights each contact by the posterior probabilities of its kinds. Its Hessian, less what
one contact contributes as an inlier, is that of the cost in the case that this contact is displaced or its normal
wrong.
"""

import numpy as np

from tactopose_drake.core.compilation import inlined, kernel
from tactopose_drake.core.kernel_types import Floats3, OutFloats4
from tactopose_drake.core.kernels.contact_mixture_kernels import BY_D, BY_N, FACES, Doubts, find_shares, make_work, mix
from tactopose_drake.core.kernels.grid_kernels import Grid
from tactopose_drake.core.kernels.surface_contact_kernels import Rows, WeightedContacts, contact_rows


@inlined
def _rows_facing(grid, touch, i, facing, n, X, own):
    """A contact's rows with its normal times `facing`, from -1 (flipped) to 1 (as told); n (3,) is scratch."""
    for a in range(3):
        n[a] = facing * touch.n[i, a]
    contact_rows(grid, touch.p[i], n, touch.weight_p[i], touch.weight_n[i], X, own)


@inlined
def _normal_energy(residual):
    """Half the squared norm of those of a contact's residuals (5,) that belong to its normal."""
    return 0.5 * (residual[1] ** 2 + residual[2] ** 2 + residual[3] ** 2 + residual[4] ** 2)


@kernel
def find_alternatives(
    grid: Grid, touch: WeightedContacts, doubts: Doubts, X: Floats3, hessian: Floats3, left: OutFloats4
) -> None:
    """Writes what remains (B, 2 k, 6, 6) of each pose's Hessian (B, 6, 6) without one contact.

    The Hessian is that of `mixture_equations`. In the first k, each contact in turn is displaced; in the last k, each
    in turn has an arbitrary normal. Only the part that the contact's weight contributes is subtracted, so that the
    remainder is positive semidefinite.
    """
    k = touch.p.shape[0]
    facing, work = np.empty(3), make_work(k, doubts)
    own = Rows(np.empty(5), np.empty((5, 6)), np.empty((4, 6)), np.empty((10, 4)))
    residual, smooth = own.residual, own.smooth
    for b in range(X.shape[0]):
        for i in range(k):
            _rows_facing(grid, touch, i, -1.0, facing, X[b], own)
            work.m[i, 0] = _normal_energy(residual)
            _rows_facing(grid, touch, i, 1.0, facing, X[b], own)
            work.d[i, 0], work.n[i, 0] = 0.5 * residual[0] ** 2, _normal_energy(residual)
        mix(1, doubts, work)
        for i in range(k):
            find_shares(i, 1, doubts, work)
            _rows_facing(grid, touch, i, work.shares[FACES], facing, X[b], own)
            lost_d = max(work.shares[BY_D] - doubts.closeness[i], 0.0)
            for c in range(6):
                for e in range(6):
                    lost_n = 0.0
                    for a in range(1, 4):
                        lost_n += smooth[a, c] * smooth[a, e]
                    left[b, i, c, e] = hessian[b, c, e] - lost_d * smooth[0, c] * smooth[0, e]
                    left[b, k + i, c, e] = hessian[b, c, e] - work.shares[BY_N] * lost_n
