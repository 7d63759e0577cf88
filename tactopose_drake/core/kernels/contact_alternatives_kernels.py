"""What would be left of a cost if one of its contacts were not as told, compiled.

The mixture's cost at a pose counts each contact by what it probably is. Its gradient and Hessian, less what one contact
adds in so far as it is as told, are the local model of the cost in the case that this one is displaced or turned.
"""

from typing import NamedTuple

import numpy as np

from tactopose_drake.core.compilation import inlined, kernel
from tactopose_drake.core.kernel_types import Floats2, Floats3, OutFloats2, OutFloats3, OutFloats4
from tactopose_drake.core.kernels.contact_mixture_kernels import Doubts, find_shares, make_work, mix
from tactopose_drake.core.kernels.grid_kernels import Grid
from tactopose_drake.core.kernels.surface_contact_kernels import Rows, Touch, contact_rows


class Alternatives(NamedTuple):
    """Local models of the cost at B poses by what the contacts are, of which there are m = 1 + 2 k.

    First all are as told, then each in turn is displaced, then each in turn has any normal.

    Attributes:
        share: how probable that is there, shape (B, m).
        gradient: of the cost if it is so, shape (B, m, 6).
        information: its Hessian, shape (B, m, 6, 6).
    """

    share: OutFloats2
    gradient: OutFloats3
    information: OutFloats4


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


@inlined
def _false_shares(i, doubts, work):
    """That a contact is displaced, and that its normal is any, at the first of the poses."""
    point, turn, moved, total, _ = work
    displaced, turned = 0.0, 0.0
    for q in range(total.shape[0]):
        by_point, by_turn = point[i, doubts.s[q], 0], turn[i, doubts.t[q], 0]
        with_any, elsewhere = doubts.normal[i] * by_point, moved[i, 0] * by_turn
        part = total[q, 0] / (by_point * by_turn + with_any + elsewhere + doubts.other[i])
        displaced += part * elsewhere
        turned += part * with_any
    return displaced, turned


@kernel
def find_alternatives(
    grid: Grid, touch: Touch, doubts: Doubts, X: Floats3, gradient: Floats2, hessian: Floats3, found: Alternatives
) -> None:
    """What is left of each pose's gradient (B, 6) and Hessian (B, 6, 6), as of `mixture_equations`, see `Alternatives`.

    What is taken off a Hessian is what the contact counts for in it, no more, so that nothing negative is left.
    """
    k = touch.p.shape[0]
    residual, J, smooth, scratch = np.empty((k, 5)), np.empty((k, 5, 6)), np.empty((k, 4, 6)), np.empty((10, 4))
    d, n, work, shares, cost = np.empty((k, 1)), np.empty((k, 1)), make_work(k, doubts), np.empty((3, 1)), np.empty(1)
    for b in range(X.shape[0]):
        _energies_and_rows(grid, touch, X[b], (residual, J, smooth, scratch), d, n)
        mix(d, n, 1, doubts, cost, work)
        found.share[b, 0] = 1.0
        for c in range(6):
            found.gradient[b, 0, c] = gradient[b, c]
            for e in range(6):
                found.information[b, 0, c, e] = hessian[b, c, e]
        for i in range(k):
            find_shares(i, 1, doubts, work, shares)
            moved, turned = 1 + i, 1 + k + i
            found.share[b, 0] *= shares[0, 0]
            found.share[b, moved], found.share[b, turned] = _false_shares(i, doubts, work)
            lost_d = max(shares[1, 0] - doubts.closeness[i], 0.0)
            for c in range(6):
                lost = 0.0
                for a in range(1, 5):
                    lost += residual[i, a] * J[i, a, c]
                found.gradient[b, moved, c] = gradient[b, c] - lost_d * residual[i, 0] * J[i, 0, c]
                found.gradient[b, turned, c] = gradient[b, c] - shares[2, 0] * lost
                for e in range(6):
                    found.information[b, moved, c, e] = hessian[b, c, e] - lost_d * smooth[i, 0, c] * smooth[i, 0, e]
                    lost = 0.0
                    for a in range(1, 4):
                        lost += smooth[i, a, c] * smooth[i, a, e]
                    found.information[b, turned, c, e] = hessian[b, c, e] - shares[2, 0] * lost
