"""The touch by itself, with a prior or without one: normal equations, and a pose's whole descent in one loop.

Source: [B16] J. Bimbo, thesis, 2016, eqs. 2.30 and 2.31, 3.3 and 3.5.
"""

from typing import NamedTuple

import numpy as np

from tactopose_drake.core.compilation import (
    OutFlags1,
    OutFloats1,
    OutFloats2,
    OutFloats3,
    OutLongs1,
    kernel,
)
from tactopose_drake.core.kernels.grid_kernels import SOFT_LENGTH, Grid, cell, extend, interpolate, prefetch_cells
from tactopose_drake.core.kernels.least_squares_kernels import (
    damped_step,
    has_converged,
    next_damping,
    promised_decrease,
)
from tactopose_drake.core.kernels.pose_kernels import (
    chain_in_object,
    retract_one,
    rotate_to_object,
    to_object,
    turn_normal,
    turn_translations,
)
from tactopose_drake.core.kernels.prior_kernels import Prior, prior_row
from tactopose_drake.core.kernels.surface_contact_kernels import SOFT_ROOT, Touch, normal_weight


class DescentRule(NamedTuple):
    """What `searches.levenberg_marquardt.LevenbergMarquardt` goes by; see there."""

    max_iterations: int
    tolerance: float
    initial_damping: float
    max_damping: float


class Ends(NamedTuple):
    """Where descents end: cost (B,), gradient (B, 6), Hessian (B, 6, 6), steps tried (B,), at a minimum or not (B,)."""

    cost: OutFloats1
    gradient: OutFloats2
    hessian: OutFloats3
    iterations: OutLongs1
    converged: OutFlags1


@kernel
def descend(grid: Grid, touch: Touch, prior: Prior, rule: DescentRule, X: OutFloats3, ends: Ends) -> None:
    """Levenberg-Marquardt from each pose X (B, 3, 4), which moves; as `LevenbergMarquardt.refine` does it in rounds.

    The cost is of the contacts' residuals and the prior's; there is no prior where its weights are zero. Without
    iterations the cost's exact gradient and Gauss-Newton Hessian are those at the poses; with them they are for work.
    The Hessian is of the contacts' rows that carry information, see `surface_contact_kernels.contact_rows`.

    That is said here in another order, three times as fast: one pose after the other, so that what it reads of the grid
    is still at hand when it reads it again; by increments (w, R^T v), so all in O, until a pose's equations are done;
    the gradient's rows are added up before their one chain rule; and the grid is read by unsigned offsets, which need
    no check for negative ones. All in one body: parts that are handed their arrays in a named tuple take two and a half
    times as long, because the references of each are counted.
    """
    values, origin, inverse_spacing = grid
    p, n, weight_p, weight_n = touch
    max_iterations, tolerance, initial_damping, max_damping = rule
    cost, gradient, hessian, iterations, converged = ends
    flat = values.reshape(-1)
    nx, ny, nz = values.shape[0], values.shape[1], values.shape[2]
    sy, sx = np.uintp(4 * nz), np.uintp(4 * nz * ny)
    field, slope, m, J = np.empty(4), np.empty((4, 3)), np.empty(3), np.empty((4, 6))
    g, H, row, along = np.empty(6), np.empty((6, 6)), np.empty(3), np.empty(3)
    q, turned = np.empty(3), np.empty(3)
    there, new_gradient, new_hessian = np.empty((3, 4)), np.empty(6), np.empty((6, 6))
    L, forward, step = np.empty((6, 6)), np.empty(6), np.empty(6)
    u, difference, D = np.empty(6), np.empty(6), np.empty((6, 6))
    for b in range(X.shape[0]):
        for a in range(3):
            for c in range(4):
                there[a, c] = X[b, a, c]
        damping, promised, best = initial_damping, 0.0, np.inf
        converged[b] = False
        for iteration in range(max_iterations + 1):
            # Where no step follows, the cost is enough.
            derive = iteration == 0 or iteration < max_iterations
            total = 0.0
            prefetch_cells(grid, flat, there, p, q)
            for a in range(6):
                g[a] = 0.0
                for c in range(a + 1):
                    H[a, c] = 0.0
            for i in range(p.shape[0]):
                to_object(there, p[i], q)
                ix, fx, ox = cell(q[0], origin[0], inverse_spacing, nx - 1.0)
                iy, fy, oy = cell(q[1], origin[1], inverse_spacing, ny - 1.0)
                iz, fz, oz = cell(q[2], origin[2], inverse_spacing, nz - 1.0)
                at = np.uintp(4 * ((ix * ny + iy) * nz + iz))
                for k in range(4):
                    field[k], dx, dy, dz = interpolate(flat, at + np.uintp(k), sx, sy, fx, fy, fz)
                    slope[k, 0], slope[k, 1] = dx * inverse_spacing, dy * inverse_spacing
                    slope[k, 2] = dz * inverse_spacing
                if ox != 0.0 or oy != 0.0 or oz != 0.0:
                    extend(field, slope, ox, oy, oz, inverse_spacing)

                residual = field[0] * weight_p[i]
                total += residual * residual
                if weight_n[i] > 0.0:
                    rotate_to_object(there, n[i], m)
                    weight, spread = normal_weight(field, weight_n[i])
                    for k in range(3):
                        turned[k] = (field[k + 1] - m[k]) * weight
                        total += turned[k] * turned[k]
                    total += 2.0 * np.log(spread) + SOFT_ROOT
                if not derive:
                    continue

                square = field[1] * field[1] + field[2] * field[2] + field[3] * field[3]
                scale = 1.0 / np.sqrt(square + SOFT_LENGTH**2)
                for a in range(3):
                    along[a] = scale * weight_p[i] * field[a + 1]
                    row[a] = residual * weight_p[i] * slope[0, a]
                chain_in_object(along, q, J[0])
                if weight_n[i] > 0.0:
                    for a in range(3):  # The derivative of half the squared length.
                        along[a] = field[1] * slope[1, a] + field[2] * slope[2, a] + field[3] * slope[3, a]
                        if square >= 1.0:
                            along[a] = 0.0
                        # The log term's part of the gradient.
                        row[a] -= along[a] * weight * weight
                    for k in range(1, 4):
                        bend = 0.5 * turned[k - 1] * weight
                        turn = scale * scale * field[k]
                        x, y, z = slope[k, 0], slope[k, 1], slope[k, 2]
                        residual = turned[k - 1] * weight
                        row[0] += residual * (x + bend * along[0])
                        row[1] += residual * (y + bend * along[1])
                        row[2] += residual * (z + bend * along[2])
                        unit = weight * scale
                        slope[k, 0] = unit * (x - turn * along[0])
                        slope[k, 1] = unit * (y - turn * along[1])
                        slope[k, 2] = unit * (z - turn * along[2])
                        chain_in_object(slope[k], q, J[k])
                    turn_normal(m, weight, J)
                    weight *= weight
                    g[0] += weight * (m[1] * field[3] - m[2] * field[2])
                    g[1] += weight * (m[2] * field[1] - m[0] * field[3])
                    g[2] += weight * (m[0] * field[2] - m[1] * field[1])
                else:
                    for k in range(1, 4):
                        for a in range(6):
                            J[k, a] = 0.0
                g[0] += row[1] * q[2] - row[2] * q[1]
                g[1] += row[2] * q[0] - row[0] * q[2]
                g[2] += row[0] * q[1] - row[1] * q[0]
                for a in range(3):
                    g[3 + a] -= row[a]
                for a in range(6):
                    for c in range(a + 1):
                        H[a, c] += J[0, a] * J[0, c] + J[1, a] * J[1, c] + J[2, a] * J[2, c] + J[3, a] * J[3, c]
            total *= 0.5
            if derive:
                turn_translations(there, g, H, new_gradient, new_hessian)
            if prior.weights[0] > 0.0:
                prior_row(prior, there, u, difference, D)
                for a in range(6):
                    total += 0.5 * difference[a] * difference[a]
                    for c in range(6):
                        new_gradient[a] += D[c, a] * difference[c]
                for a in range(3):
                    new_hessian[3 + a, 3 + a] += prior.weights[3 + a] ** 2
                    for c in range(3):
                        new_hessian[a, c] += D[0, a] * D[0, c] + D[1, a] * D[1, c] + D[2, a] * D[2, c]

            iterations[b] = iteration
            decrease = best - total
            if iteration > 0:
                damping = next_damping(damping, decrease > 0.0, 0.0)
                converged[b] = has_converged(best, decrease, promised, damping, tolerance, max_damping)
            if iteration == 0 or decrease > 0.0:
                best = total
                for a in range(3):
                    for c in range(4):
                        X[b, a, c] = there[a, c]
                for a in range(6):
                    gradient[b, a] = new_gradient[a]
                    for c in range(6):
                        hessian[b, a, c] = new_hessian[a, c]
            if converged[b] or iteration == max_iterations:
                break
            damped_step(6, hessian[b], gradient[b], damping, L, forward, step)
            promised = promised_decrease(gradient[b], step)
            retract_one(X[b], step, there)
        cost[b] = best
