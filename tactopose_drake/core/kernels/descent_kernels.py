"""Normal equations of contacts, with or without outliers and a prior, and a pose's whole descent in one compiled loop.

Source: [B16] J. Bimbo, thesis, 2016, eqs. 2.30 and 2.31, 3.3 and 3.5.
"""

from typing import NamedTuple

import numpy as np

from tactopose_drake.core.compilation import kernel
from tactopose_drake.core.kernel_types import OutFlags1, OutFloats1, OutFloats2, OutFloats3, OutLongs1
from tactopose_drake.core.kernels.contact_mixture_kernels import Doubts, add_up_doubted, make_work
from tactopose_drake.core.kernels.grid_kernels import Grid
from tactopose_drake.core.kernels.hand_sphere_kernels import Spheres
from tactopose_drake.core.kernels.lane_kernels import LANES, SIZE, leave, total_cost
from tactopose_drake.core.kernels.least_squares_kernels import (
    DescentRule,
    damped_step,
    has_converged,
    next_damping,
    promised_decrease,
)
from tactopose_drake.core.kernels.penetration_kernels import (
    add_penetration,
    find_depths,
    make_depths,
    make_near,
    penetration_cost,
)
from tactopose_drake.core.kernels.pose_kernels import retract_one
from tactopose_drake.core.kernels.prior_kernels import Prior, add_prior, half_square, prior_row
from tactopose_drake.core.kernels.sorting_kernels import copy_matrix
from tactopose_drake.core.kernels.surface_contact_kernels import WeightedContacts, add_up, find_dearest


class Ends(NamedTuple):
    """Where descents end: cost (B,), gradient (B, 6), Hessian (B, 6, 6), steps tried (B,), is at a minimum (B,)."""

    cost: OutFloats1
    gradient: OutFloats2
    hessian: OutFloats3
    iterations: OutLongs1
    converged: OutFlags1


@kernel
def descend(
    grid: Grid,
    touch: WeightedContacts,
    doubts: Doubts,
    prior: Prior,
    hand: Spheres,
    rule: DescentRule,
    trimmed: bool,
    X: OutFloats3,
    ends: Ends,
) -> None:
    """Moves poses X (B, 3, 4) by Levenberg-Marquardt, with the same result as `LevenbergMarquardt.refine`.

    The cost is that of the contacts' residuals, the prior, and the hand's volume. There is no prior if its weights are
    zero; the hand may have no spheres. If `doubts` has pairs of noise factors, the contacts' cost is the mixture's.
    Otherwise, if it is `trimmed`, each pose ignores the contact that it fits worst at the start. `ends` holds the exact
    gradient and the Gauss-Newton Hessian at the final poses; the Hessian is of the contacts' rows that carry
    information, see `surface_contact_kernels.contact_rows`.

    As many poses as there are lanes descend at a time; where one has finished, the next begins.
    """
    w, there, index = np.zeros(SIZE), np.empty((LANES, 3, 4)), np.empty(LANES, dtype=np.int64)
    damping, promised, left_out = np.empty(LANES), np.empty(LANES), np.empty(LANES, dtype=np.int64)
    g, H, u, difference, D = np.empty(6), np.empty((6, 6)), np.empty(6), np.empty(6), np.empty((6, 6))
    L, forward, step, J = np.empty((6, 6)), np.empty(6), np.empty(6), np.empty(6)
    near, depths, bounded = make_near(hand), make_depths(hand), len(hand.weight) > 0
    under_way, begun, doubted = 0, 0, len(doubts.s) > 0
    work, spared = make_work(touch.p.shape[0], doubts), np.full(X.shape[0], -1)
    if trimmed:
        find_dearest(grid, touch, X, spared)
    while True:
        while under_way < LANES and begun < X.shape[0]:
            index[under_way], damping[under_way], promised[under_way] = begun, rule.initial_damping, 0.0
            ends.iterations[begun], ends.converged[begun], ends.cost[begun] = -1, False, np.inf
            copy_matrix(X[begun], there[under_way])
            under_way, begun = under_way + 1, begun + 1
        if under_way == 0:
            return
        if doubted:
            add_up_doubted(grid, touch, doubts, there, under_way, w, work)
        else:
            for lane in range(under_way):
                left_out[lane] = spared[index[lane]]
            add_up(grid, touch, left_out, there, under_way, w)
        going = 0
        for lane in range(under_way):
            b, at = index[lane], there[lane]
            total = work.cost[lane] if doubted else total_cost(w, np.uintp(lane))
            if prior.weights[0] > 0.0:
                prior_row(prior, at, u, difference, D)
                total += half_square(difference)
            if bounded:
                find_depths(grid, hand, at, near, depths, 0)
                total += penetration_cost(hand, depths)
            ends.iterations[b] += 1
            decrease, is_first = ends.cost[b] - total, ends.iterations[b] == 0
            if not is_first:
                damping[lane] = next_damping(damping[lane], decrease > 0.0, rule.least_refused)
                ends.converged[b] = has_converged(ends.cost[b], decrease, promised[lane], damping[lane], rule)
            if is_first or decrease > 0.0:
                ends.cost[b] = total
                copy_matrix(at, X[b])
                leave(w, np.uintp(lane), at, g, H, ends.gradient[b], ends.hessian[b])
                if prior.weights[0] > 0.0:
                    add_prior(prior, difference, D, ends.gradient[b], ends.hessian[b])
                if bounded:
                    add_penetration(hand, depths, at, J, ends.gradient[b], ends.hessian[b])
            if ends.converged[b] or ends.iterations[b] == rule.max_iterations:
                continue
            damped_step(6, ends.hessian[b], ends.gradient[b], damping[lane], L, forward, step)
            index[going], damping[going] = b, damping[lane]
            promised[going] = promised_decrease(ends.gradient[b], step)
            retract_one(X[b], step, there[going])
            going += 1
        under_way = going
