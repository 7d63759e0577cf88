"""Contacts against the surface, compiled: costs, residuals and their derivatives, each one loop over poses.

Poses are (B, 3, 4); increments (w, v) as in `poses.py`.

Source: [B16] J. Bimbo, thesis, 2016, eqs. 3.3 and 3.5, whitened by the sensors' standard deviations.
"""

from typing import NamedTuple

import numpy as np

from tactopose_drake.core.compilation import inlined, kernel, part
from tactopose_drake.core.kernel_types import (
    Floats1,
    Floats2,
    Floats3,
    Longs1,
    OutFloats1,
    OutFloats2,
    OutFloats3,
    OutFloats4,
    OutLongs1,
)
from tactopose_drake.core.kernels.grid_kernels import (
    SOFT_LENGTH,
    Grid,
    look_up_with_derivative,
)
from tactopose_drake.core.kernels.lane_kernels import (
    DISTANCE_ENERGY,
    DISTANCE_SHARE,
    FACING,
    LANES,
    NORMAL_ENERGY,
    NORMAL_SHARE,
    SIZE,
    SOFT_ROOT,
    add_equations,
    enter,
    read_grid,
    weigh,
)
from tactopose_drake.core.kernels.pose_kernels import chain, rotate_to_object, to_object, turn_normal
from tactopose_drake.core.kernels.prior_kernels import Prior, prior_cost


class WeightedContacts(NamedTuple):
    """Contacts, as kernels read them; all arrays are read-only.

    Attributes:
        p: points in P, shape (k, 3), m.
        n: unit normals in P, shape (k, 3); arbitrary where there is none.
        weight_p: one over the standard deviation of each point, shape (k,), 1/m.
        weight_n: one over the standard deviation of each normal, shape (k,), 1/rad; zero where there is none.
    """

    p: Floats2
    n: Floats2
    weight_p: Floats1
    weight_n: Floats1


class Rows(NamedTuple):
    """The residuals and derivatives of one contact at one pose, see `contact_rows`.

    Attributes:
        residual: shape (5,).
        J: its Jacobian with respect to the increment, shape (5, 6).
        smooth: the rows that carry information, shape (4, 6).
        work: scratch, shape (10, 4).
    """

    residual: OutFloats1
    J: OutFloats2
    smooth: OutFloats2
    work: OutFloats2


@part
def add_up(grid: Grid, touch: WeightedContacts, spared: Longs1, X: Floats3, lanes: int, w: OutFloats1) -> None:
    """Adds up cost, gradient and Hessian at poses X (3, 4), one in each lane of the rows w.

    A lane ignores the contact whose index `spared` gives for it, if there is one.
    """
    enter(X, 0, lanes, w)
    for lane in range(lanes):
        w[FACING + np.uintp(lane)] = 1.0
    for i in range(touch.p.shape[0]):
        for lane in range(lanes):
            share = 0.0 if spared[lane] == i else 1.0
            w[DISTANCE_SHARE + np.uintp(lane)] = w[NORMAL_SHARE + np.uintp(lane)] = share
        read_grid(grid, touch.p[i], touch.n[i], lanes, w)
        add_equations(grid.inverse_spacing, touch.weight_p[i], touch.weight_n[i], lanes, w)


@kernel
def contact_costs(grid: Grid, touch: WeightedContacts, prior: Prior, X: Floats3, cost: OutFloats1) -> None:
    """Writes half the sum of squared residuals of contacts and prior at each pose into cost (B,)."""
    w, u = np.zeros(SIZE), np.empty(6)
    for first in range(0, X.shape[0], LANES):
        lanes = min(LANES, X.shape[0] - first)
        enter(X, first, lanes, w)
        for lane in range(lanes):
            cost[first + lane] = prior_cost(prior, X[first + lane], u)
        for i in range(touch.p.shape[0]):
            read_grid(grid, touch.p[i], touch.n[i], lanes, w)
            weigh(grid.inverse_spacing, touch.weight_p[i], touch.weight_n[i], lanes, w)
            for lane in range(lanes):
                cost[first + lane] += w[DISTANCE_ENERGY + np.uintp(lane)] + w[NORMAL_ENERGY + np.uintp(lane)]


@part
def find_dearest(grid: Grid, touch: WeightedContacts, X: Floats3, dearest: OutLongs1) -> None:
    """Writes the index of the contact with the largest energy at each pose into dearest (B,)."""
    w, largest = np.zeros(SIZE), np.empty(LANES)
    for first in range(0, X.shape[0], LANES):
        lanes = min(LANES, X.shape[0] - first)
        enter(X, first, lanes, w)
        for lane in range(lanes):
            largest[lane] = -np.inf
        for i in range(touch.p.shape[0]):
            read_grid(grid, touch.p[i], touch.n[i], lanes, w)
            weigh(grid.inverse_spacing, touch.weight_p[i], touch.weight_n[i], lanes, w)
            for lane in range(lanes):
                energy = w[DISTANCE_ENERGY + np.uintp(lane)] + w[NORMAL_ENERGY + np.uintp(lane)]
                if energy > largest[lane]:
                    largest[lane], dearest[first + lane] = energy, i


@kernel
def contact_residuals(
    grid: Grid, touch: WeightedContacts, X: Floats3, residuals: OutFloats3, jacobian: OutFloats4
) -> None:
    """Residuals (B, k, 5), see `contact_rows`, and their Jacobian (B, k, 5, 6) with respect to the increment."""
    p, n, weight_p, weight_n = touch
    smooth, work = np.empty((4, 6)), np.empty((10, 4))
    for b in range(X.shape[0]):
        for i in range(p.shape[0]):
            rows = Rows(residuals[b, i], jacobian[b, i], smooth, work)
            contact_rows(grid, p[i], n[i], weight_p[i], weight_n[i], X[b], rows)


@inlined
def normal_weight(field, weight_n):
    """One over the standard deviation of the normal's difference, and its variance in units of the sensor's.

    The more unit vectors spread, the shorter is their mean n: per axis, their variance is (1 - |n|^2) / 2.
    """
    square = field[1] ** 2 + field[2] ** 2 + field[3] ** 2
    spread = 1.0 + 0.5 * max(0.0, 1.0 - square) * weight_n * weight_n
    return weight_n / np.sqrt(spread), spread


@part
def contact_rows(grid: Grid, p: Floats1, n: Floats1, weight_p: float, weight_n: float, X: Floats2, rows: Rows) -> None:
    """The five residuals of one contact at one pose, their Jacobian (5, 6), and the rows (4, 6) that carry information.

    The residuals are the distance, the difference of the normals, and sqrt(2 log(variance)) of the normal, which turns
    the sum of squares into a likelihood: a crease explains any normal, but none well.

    The contact's information on the pose is in the derivatives of the distance along the mean normal, and of that
    normal's direction. The exact derivatives follow each facet, and each change of the mean normal's length; they would
    claim that the facets of a tessellated cylinder determine its rotation about the axis.
    """
    residual, J, smooth, work = rows
    # Views of the caller's scratch array, as an allocation would cost as much as the arithmetic.
    q, m, along, row, field, slope, mean = work[0], work[1], work[2], work[3], work[4], work[5:9], work[9]
    to_object(X, p, q)
    look_up_with_derivative(grid, q[0], q[1], q[2], field, slope)
    square = field[1] ** 2 + field[2] ** 2 + field[3] ** 2
    scale = 1.0 / np.sqrt(square + SOFT_LENGTH**2)
    for a in range(3):
        mean[a] = scale * field[a + 1]
    chain(mean, q, X, weight_p, smooth[0])
    residual[0] = field[0] * weight_p
    chain(slope[0], q, X, weight_p, J[0])
    if weight_n > 0.0:
        rotate_to_object(X, n, m)
        weight, spread = normal_weight(field, weight_n)
        for c in range(3):  # The derivative of half the mean normal's squared length.
            along[c] = field[1] * slope[1, c] + field[2] * slope[2, c] + field[3] * slope[3, c]
            if square >= 1.0:
                along[c] = 0.0
        for a in range(3):
            difference = field[a + 1] - m[a]
            residual[a + 1] = difference * weight
            for c in range(3):
                row[c] = slope[a + 1, c] + 0.5 * difference * weight * weight * along[c]
            chain(row, q, X, weight, J[a + 1])
            for c in range(3):
                row[c] = scale * (slope[a + 1, c] - mean[a] * scale * along[c])
            chain(row, q, X, weight, smooth[a + 1])
        turn_normal(m, weight, J)
        turn_normal(m, weight, smooth)
        residual[4] = np.sqrt(2.0 * np.log(spread) + SOFT_ROOT)
        for c in range(3):
            row[c] = -along[c] * weight * weight / residual[4]
        chain(row, q, X, 1.0, J[4])
    else:
        for a in range(1, 5):
            residual[a] = 0.0
            for c in range(6):
                J[a, c] = 0.0
        for a in range(1, 4):
            for c in range(6):
                smooth[a, c] = 0.0
