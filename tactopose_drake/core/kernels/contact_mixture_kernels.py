"""The mixture likelihood of contacts that may be false, with noise that may be larger than told, compiled.

With d the energy of a contact's distance from the surface (half its whitened square), n that of its normal, and the
variances of points and normals s and t times what is told, the contact's density over that of an exact one is

    as told                  exp(-d / s - n / t) / (sqrt(s) t),
    with another normal      f_n exp(-d / s) / sqrt(s),
    displaced                f_d exp(-c d - n / t) / t,
    of something else        f_p,

summed, without t and n where there is no normal. The factors s and t are the same for all contacts: the likelihood is
the sum over pairs of them of their prior probability times the product over the contacts. They are powers of two, so
that one exponential of each energy serves for all.
"""

from typing import NamedTuple

import numpy as np

from tactopose_drake.core.compilation import (
    Floats1,
    Floats2,
    Floats3,
    Longs1,
    OutFloats1,
    OutFloats2,
    OutFloats3,
    OutFloats4,
    inlined,
    kernel,
)
from tactopose_drake.core.kernels.grid_kernels import Grid, look_up
from tactopose_drake.core.kernels.pose_kernels import rotate_to_object, to_object
from tactopose_drake.core.kernels.surface_contact_kernels import SOFT_ROOT, Rows, Touch, contact_rows, normal_weight

# The factors of the variances are two to the powers 0 to this.
MOST_DOUBLINGS = 4


class Doubts(NamedTuple):
    """What is doubted of contacts, read-only.

    Attributes:
        s, t: logarithms to base two of the pairs of factors, shape (q,); the first is 0, 0.
        per_s, per_t: one over the factors, shape (q,).
        probability: of each pair over that of the first, shape (q,).
        normal, displaced, other: f_n, f_d and f_p, shape (k,); 0 where that cannot be, but for f_p, which is above 0.
        closeness: c, the contacts' variances over that of how far they are displaced, shape (k,).
        has_normals: whether there are normals.
    """

    s: Longs1
    t: Longs1
    per_s: Floats1
    per_t: Floats1
    probability: Floats1
    normal: Floats1
    displaced: Floats1
    other: Floats1
    closeness: Floats1
    has_normals: bool


class Judged(NamedTuple):
    """What `judge` fills: see `ContactMixture.judge`."""

    cost: OutFloats1
    inlier_probability: OutFloats2
    noise_scale: OutFloats1
    misfit: OutFloats1


@inlined
def _mix(d, n, doubts, point, turn, far, total):
    """The cost of energies d and n (k,), zero where those are; fills the factors, and what the pairs weigh."""
    pairs, shift = total.shape[0], 0.0
    for q in range(pairs):
        total[q] = doubts.probability[q]
    for i in range(d.shape[0]):
        far[i] = np.exp(-doubts.closeness[i] * d[i])
        per = 0.5**MOST_DOUBLINGS
        by_point, by_turn = np.exp(-d[i] * per), np.exp(-n[i] * per)
        for a in range(MOST_DOUBLINGS, -1, -1):
            point[i, a] = by_point * np.sqrt(per)
            turn[i, a] = by_turn * per if doubts.has_normals else 1.0
            by_point, by_turn, per = by_point * by_point, by_turn * by_turn, 2.0 * per
        most, moved = 0.0, doubts.displaced[i] * far[i]
        for q in range(pairs):
            by_point, by_turn = point[i, doubts.s[q]], turn[i, doubts.t[q]]
            false = doubts.normal[i] * by_point + moved * by_turn + doubts.other[i]
            total[q] *= by_point * by_turn + false
            most = max(most, total[q])
        if most < 1e-50:  # Many contacts' densities are too small for one number.
            shift += np.log(most)
            for q in range(pairs):
                total[q] /= most
    mass = 0.0
    for q in range(pairs):
        mass += total[q]
    for q in range(pairs):
        total[q] /= mass
    return -shift - np.log(mass)


@inlined
def _shares(doubts, i, point, turn, far, total):
    """That a contact is as told; and the derivatives of the cost by its energies d and n."""
    told, weight_d, weight_n, displaced = 0.0, 0.0, 0.0, doubts.displaced[i] * far[i]
    for q in range(total.shape[0]):
        if total[q] > 1e-6:
            by_point, by_turn = point[i, doubts.s[q]], turn[i, doubts.t[q]]
            as_told = by_point * by_turn
            turned, moved = doubts.normal[i] * by_point, displaced * by_turn
            part = total[q] / (as_told + turned + moved + doubts.other[i])
            told += part * as_told
            weight_d += part * ((as_told + turned) * doubts.per_s[q] + moved * doubts.closeness[i])
            weight_n += part * (as_told + moved) * doubts.per_t[q]
    return told, weight_d, weight_n


@inlined
def _energies(grid, touch, X, i, q, m, field):
    """The energies of one contact's distance and normal at one pose, by the distance field."""
    to_object(X, touch.p[i], q)
    look_up(grid, q[0], q[1], q[2], field)
    r = field[0] * touch.weight_p[i]
    n = 0.0
    if touch.weight_n[i] > 0.0:
        rotate_to_object(X, touch.n[i], m)
        weight, spread = normal_weight(field, touch.weight_n[i])
        square = 0.0
        for a in range(3):
            square += (field[a + 1] - m[a]) ** 2
        n = 0.5 * weight * weight * square + np.log(spread) + 0.5 * SOFT_ROOT
    return 0.5 * r * r, n


@inlined
def _energies_and_rows(grid, touch, X, rows, d, n):
    """The contacts' rows (residual, J, smooth, work) at one pose, and the energies that are half their squares."""
    residual, J, smooth, work = rows
    for i in range(touch.p.shape[0]):
        own = Rows(residual[i], J[i], smooth[i], work)
        contact_rows(grid, touch.p[i], touch.n[i], touch.weight_p[i], touch.weight_n[i], X, own)
        d[i] = 0.5 * residual[i, 0] ** 2
        n[i] = 0.0
        for a in range(1, 5):
            n[i] += 0.5 * residual[i, a] ** 2


@kernel
def mixture_equations(
    grid: Grid,
    touch: Touch,
    doubts: Doubts,
    X: Floats3,
    cost: OutFloats1,
    gradient: OutFloats2,
    hessian: OutFloats3,
) -> None:
    """Cost (B,), its exact gradient (B, 6) and the Gauss-Newton Hessian (B, 6, 6) at poses (B, 3, 4).

    The Hessian is that of the contacts' squares by what each counts for, as in iteratively reweighted least squares.
    """
    k = touch.p.shape[0]
    residual, J, smooth, work = np.empty((k, 5)), np.empty((k, 5, 6)), np.empty((k, 4, 6)), np.empty((10, 4))
    d, n, S = np.empty(k), np.empty(k), MOST_DOUBLINGS + 1
    point, turn, far, total = np.empty((k, S)), np.empty((k, S)), np.empty(k), np.empty(len(doubts.s))
    for b in range(X.shape[0]):
        _energies_and_rows(grid, touch, X[b], (residual, J, smooth, work), d, n)
        cost[b] = _mix(d, n, doubts, point, turn, far, total)
        for c in range(6):
            gradient[b, c] = 0.0
            for e in range(6):
                hessian[b, c, e] = 0.0
        for i in range(k):
            _, weight_d, weight_n = _shares(doubts, i, point, turn, far, total)
            for c in range(6):
                gradient[b, c] += weight_d * residual[i, 0] * J[i, 0, c]
                for a in range(1, 5):
                    gradient[b, c] += weight_n * residual[i, a] * J[i, a, c]
                for e in range(c + 1):
                    square = 0.0
                    for a in range(1, 4):
                        square += smooth[i, a, c] * smooth[i, a, e]
                    hessian[b, c, e] += weight_d * smooth[i, 0, c] * smooth[i, 0, e] + weight_n * square
        for c in range(6):
            for e in range(c):
                hessian[b, e, c] = hessian[b, c, e]


@kernel
def judge(
    grid: Grid, touch: Touch, doubts: Doubts, density: Floats2, reached: float, X: Floats3, judged: Judged
) -> None:
    """Judges poses (B, 3, 4).

    Where the contacts' exact densities (B, k) are more than exp(-reached), they take the place of d + n. Farther off
    they are cut, and the distance field is as good.
    """
    k, least = touch.p.shape[0], np.exp(-reached)
    q, m, field = np.empty(3), np.empty(3), np.empty(4)
    d, n, S = np.empty(k), np.empty(k), MOST_DOUBLINGS + 1
    point, turn, far, total = np.empty((k, S)), np.empty((k, S)), np.empty(k), np.empty(len(doubts.s))
    for b in range(X.shape[0]):
        for i in range(k):
            d[i], n[i] = _energies(grid, touch, X[b], i, q, m, field)
            if density[b, i] > least:
                both = -np.log(density[b, i])
                d[i] = min(d[i], max(both, 0.0))
                n[i] = both - d[i]
            else:
                n[i] = max(d[i] + n[i], reached) - d[i]
        judged.cost[b] = _mix(d, n, doubts, point, turn, far, total)
        judged.noise_scale[b], narrowed, calmed = 0.0, 0.0, 0.0
        for pair in range(len(doubts.s)):
            judged.noise_scale[b] += total[pair] / np.sqrt(doubts.per_s[pair])
            narrowed += total[pair] * doubts.per_s[pair]
            calmed += total[pair] * doubts.per_t[pair]
        judged.misfit[b] = 0.0
        for i in range(k):
            judged.inlier_probability[b, i] = _shares(doubts, i, point, turn, far, total)[0]
            judged.misfit[b] += judged.inlier_probability[b, i] * (d[i] * narrowed + n[i] * calmed)


@kernel
def doubted_information(
    grid: Grid, touch: Touch, doubts: Doubts, X: Floats3, hessian: Floats3, information: OutFloats4
) -> None:
    """Of each pose's Hessian (B, 6, 6), as of `mixture_equations`, what is left if one contact were false.

    Into information (B, 2 k, 6, 6): the first k where each is displaced, the others where its normal is any. What is
    taken off is what the contact counts for in the Hessian, no more, so that nothing negative is left.
    """
    k = touch.p.shape[0]
    residual, J, smooth, work = np.empty((k, 5)), np.empty((k, 5, 6)), np.empty((k, 4, 6)), np.empty((10, 4))
    d, n, S = np.empty(k), np.empty(k), MOST_DOUBLINGS + 1
    point, turn, far, total = np.empty((k, S)), np.empty((k, S)), np.empty(k), np.empty(len(doubts.s))
    for b in range(X.shape[0]):
        _energies_and_rows(grid, touch, X[b], (residual, J, smooth, work), d, n)
        _mix(d, n, doubts, point, turn, far, total)
        for i in range(k):
            _, weight_d, weight_n = _shares(doubts, i, point, turn, far, total)
            lost_d = max(weight_d - doubts.closeness[i], 0.0)
            for c in range(6):
                for e in range(6):
                    information[b, i, c, e] = hessian[b, c, e] - lost_d * smooth[i, 0, c] * smooth[i, 0, e]
                    lost = 0.0
                    for a in range(1, 4):
                        lost += smooth[i, a, c] * smooth[i, a, e]
                    information[b, k + i, c, e] = hessian[b, c, e] - weight_n * lost
