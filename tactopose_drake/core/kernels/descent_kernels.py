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
    inlined,
    kernel,
)
from tactopose_drake.core.kernels.grid_kernels import SOFT_LENGTH, Grid, cell, extend, interpolate, prefetch_cells
from tactopose_drake.core.kernels.least_squares_kernels import damped_step
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


class _Work(NamedTuple):
    """Scratch: a pose, what one contact comes to there, the sums over all contacts, and a step from there.

    Attributes:
        X: the pose, shape (3, 4).
        q, m: a contact's point and normal in O, shape (3,).
        field, slope: the grid's four channels there, shape (4,), and their derivatives, shape (4, 3).
        turned: the whitened difference of the normals, shape (3,).
        row, along: a contact's derivatives by its point in O, shape (3,).
        J: rows that carry information, by (w, R^T v), shape (4, 6).
        g, H: the sums by (w, R^T v), shape (6,) and the lower triangle of (6, 6).
        gradient, hessian: the same by (w, v).
        u, difference, D: the prior's increment, residuals (6,) and their derivatives (6, 6).
        L, forward, step: of the damped equations, shape (6, 6) and (6,).
    """

    X: OutFloats2
    q: OutFloats1
    m: OutFloats1
    field: OutFloats1
    slope: OutFloats2
    turned: OutFloats1
    row: OutFloats1
    along: OutFloats1
    J: OutFloats2
    g: OutFloats1
    H: OutFloats2
    gradient: OutFloats1
    hessian: OutFloats2
    u: OutFloats1
    difference: OutFloats1
    D: OutFloats2
    L: OutFloats2
    forward: OutFloats1
    step: OutFloats1


@kernel
def descend(grid: Grid, touch: Touch, prior: Prior, rule: DescentRule, X: OutFloats3, ends: Ends) -> None:
    """Levenberg-Marquardt from each pose X (B, 3, 4), which moves; as `LevenbergMarquardt.refine` does it in rounds.

    The cost is of the contacts' residuals and the prior's; there is no prior where its weights are zero. Without
    iterations the cost's exact gradient and Gauss-Newton Hessian are those at the poses; with them they are for work.
    The Hessian is of the contacts' rows that carry information, see `surface_contact_kernels.contact_rows`.

    That is said here in another order, three times as fast: one pose after the other, so that what it reads of the grid
    is still at hand when it reads it again; by increments (w, R^T v), so all in O, until a pose's equations are done;
    the gradient's rows are added up before their one chain rule; and the grid is read by unsigned offsets, which need
    no check for negative ones. Its parts are inlined, because arrays that are given to a function have their references
    counted, which would cost a tenth.
    """
    work = _Work(
        np.empty((3, 4)),
        np.empty(3),
        np.empty(3),
        np.empty(4),
        np.empty((4, 3)),
        np.empty(3),
        np.empty(3),
        np.empty(3),
        np.empty((4, 6)),
        np.empty(6),
        np.empty((6, 6)),
        np.empty(6),
        np.empty((6, 6)),
        np.empty(6),
        np.empty(6),
        np.empty((6, 6)),
        np.empty((6, 6)),
        np.empty(6),
        np.empty(6),
    )
    for b in range(X.shape[0]):
        work.X[:, :] = X[b]
        damping, promised, best = rule.initial_damping, 0.0, np.inf
        ends.converged[b] = False
        for iteration in range(rule.max_iterations + 1):
            # Where no step follows, the cost is enough.
            total = _evaluate(grid, touch, prior, iteration == 0 or iteration < rule.max_iterations, work)
            ends.iterations[b] = iteration
            decrease = best - total
            if iteration > 0:
                least = rule.tolerance * (best + 1.0)
                damping *= 0.1 if decrease > 0.0 else 10.0
                too_stiff = decrease <= 0.0 and damping > rule.max_damping
                ends.converged[b] = promised < least or 0.0 < decrease < least or too_stiff
            if iteration == 0 or decrease > 0.0:
                best = total
                X[b], ends.gradient[b], ends.hessian[b] = work.X, work.gradient, work.hessian
            if ends.converged[b] or iteration == rule.max_iterations:
                break
            damped_step(6, ends.hessian[b], ends.gradient[b], damping, work.L, work.forward, work.step)
            promised = 0.0
            for a in range(6):
                promised -= 0.5 * ends.gradient[b, a] * work.step[a]
            retract_one(X[b], work.step, work.X)
        ends.cost[b] = best


@inlined
def _evaluate(grid, touch, prior, derive, work):
    """The cost at the work's pose; where `derive`, the gradient and the Hessian go there too."""
    flat, g, H = grid.values.reshape(-1), work.g, work.H
    prefetch_cells(grid, flat, work.X, touch.p, work.q)
    for a in range(6):
        g[a] = 0.0
        for c in range(a + 1):
            H[a, c] = 0.0
    total = 0.0
    for i in range(touch.p.shape[0]):
        total = _add_contact(grid, flat, touch, i, derive, total, work)
    total *= 0.5
    if derive:
        turn_translations(work.X, g, H, work.gradient, work.hessian)
    if prior.weights[0] > 0.0:
        total = _add_prior(prior, total, work)
    return total


@inlined
def _add_contact(grid, flat, touch, i, derive, total, work):
    """Adds twice a contact's cost to the total, and where `derive` what it tells to the sums by (w, R^T v)."""
    X, q, m, field, slope, turned = work.X, work.q, work.m, work.field, work.slope, work.turned
    _read_grid(grid, flat, touch.p[i], work)
    weight_p, weight_n = touch.weight_p[i], touch.weight_n[i]
    residual = field[0] * weight_p
    total += residual * residual
    weight = 0.0
    if weight_n > 0.0:
        rotate_to_object(X, touch.n[i], m)
        weight, spread = normal_weight(field, weight_n)
        for k in range(3):
            turned[k] = (field[k + 1] - m[k]) * weight
            total += turned[k] * turned[k]
        total += 2.0 * np.log(spread) + SOFT_ROOT
    if derive:
        row, along, J, g, H = work.row, work.along, work.J, work.g, work.H
        square = field[1] * field[1] + field[2] * field[2] + field[3] * field[3]
        scale = 1.0 / np.sqrt(square + SOFT_LENGTH**2)
        for a in range(3):
            along[a] = scale * weight_p * field[a + 1]
            row[a] = residual * weight_p * slope[0, a]
        chain_in_object(along, q, J[0])
        if weight_n > 0.0:
            _derive_normal(square, scale, weight, work)
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
    return total


@inlined
def _read_grid(grid, flat, p, work):
    """The contact's point in O, the grid's four channels there, and their slopes."""
    q, field, slope = work.q, work.field, work.slope
    inverse_spacing = grid.inverse_spacing
    nx, ny, nz = grid.values.shape[0], grid.values.shape[1], grid.values.shape[2]
    sy, sx = np.uintp(4 * nz), np.uintp(4 * nz * ny)
    to_object(work.X, p, q)
    ix, fx, ox = cell(q[0], grid.origin[0], inverse_spacing, nx - 1.0)
    iy, fy, oy = cell(q[1], grid.origin[1], inverse_spacing, ny - 1.0)
    iz, fz, oz = cell(q[2], grid.origin[2], inverse_spacing, nz - 1.0)
    at = np.uintp(4 * ((ix * ny + iy) * nz + iz))
    for k in range(4):
        field[k], dx, dy, dz = interpolate(flat, at + np.uintp(k), sx, sy, fx, fy, fz)
        slope[k, 0], slope[k, 1] = dx * inverse_spacing, dy * inverse_spacing
        slope[k, 2] = dz * inverse_spacing
    if ox != 0.0 or oy != 0.0 or oz != 0.0:
        extend(field, slope, ox, oy, oz, inverse_spacing)


@inlined
def _derive_normal(square, scale, weight, work):
    """The normal's part of a contact's rows and gradient; `square` is the mean normal's squared length."""
    q, m, field, slope, turned = work.q, work.m, work.field, work.slope, work.turned
    row, along, J, g = work.row, work.along, work.J, work.g
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
    square_weight = weight * weight
    g[0] += square_weight * (m[1] * field[3] - m[2] * field[2])
    g[1] += square_weight * (m[2] * field[1] - m[0] * field[3])
    g[2] += square_weight * (m[0] * field[2] - m[1] * field[1])


@inlined
def _add_prior(prior, total, work):
    """Adds the prior's cost to the total, and its derivatives to the gradient and the Hessian."""
    difference, D, gradient, hessian = work.difference, work.D, work.gradient, work.hessian
    prior_row(prior, work.X, work.u, difference, D)
    for a in range(6):
        total += 0.5 * difference[a] * difference[a]
        for c in range(6):
            gradient[a] += D[c, a] * difference[c]
    for a in range(3):
        hessian[3 + a, 3 + a] += prior.weights[3 + a] ** 2
        for c in range(3):
            hessian[a, c] += D[0, a] * D[0, c] + D[1, a] * D[1, c] + D[2, a] * D[2, c]
    return total
