"""The mixture likelihood of contacts that may be false, with noise that may be larger than told, compiled.

With d the energy of a contact's distance from the surface (half its whitened square), n that of its normal, m that of
the normal flipped, and the variances of points and normals s and t times what is told, the contact's density over that
of an exact one is

    as told                  exp(-d / s - n / t) / (sqrt(s) t),
    with its normal flipped  f_m exp(-d / s - m / t) / (sqrt(s) t),
    with another normal      f_n exp(-d / s) / sqrt(s),
    displaced                f_d exp(-c d - n / t) / t,
    of something else        f_p,

summed, without t, n and m where there is no normal. The factors s and t are the same for all contacts: the likelihood
is the sum over pairs of them of their prior probability times the product over the contacts. They are powers of two, so
that one exponential of each energy serves for all.
"""

import math
from typing import NamedTuple

import numpy as np

from tactopose_drake.core.compilation import inlined, kernel, part
from tactopose_drake.core.kernel_types import Floats1, Floats3, Longs1, OutFloats1, OutFloats2, OutFloats3
from tactopose_drake.core.kernels.grid_kernels import Grid
from tactopose_drake.core.kernels.lane_kernels import (
    DISTANCE_ENERGY,
    DISTANCE_SHARE,
    FACING,
    FLIPPED_ENERGY,
    LANES,
    NORMAL_ENERGY,
    NORMAL_SHARE,
    SIZE,
    add_equations,
    enter,
    leave,
    read_grid,
    weigh,
)
from tactopose_drake.core.kernels.prior_kernels import Prior, add_prior, half_square, prior_cost, prior_row
from tactopose_drake.core.kernels.surface_contact_kernels import Touch

# The factors of the variances are two to the powers 0 to this.
MOST_DOUBLINGS = 4
_ROOT_2 = math.sqrt(2.0)


class Doubts(NamedTuple):
    """What is doubted of contacts, read-only.

    Attributes:
        s, t: logarithms to base two of the pairs of factors, shape (q,); the first is 0, 0.
        per_s, per_t: one over the factors, shape (q,).
        probability: of each pair over that of the first, shape (q,).
        flipped, normal, displaced, other: f_m, f_n, f_d and f_p, shape (k,); 0 where that cannot be, but for f_p, which
            is above 0.
        closeness: c, the contacts' variances over that of how far they are displaced, shape (k,).
        has_normals: whether there are normals.
    """

    s: Longs1
    t: Longs1
    per_s: Floats1
    per_t: Floats1
    probability: Floats1
    flipped: Floats1
    normal: Floats1
    displaced: Floats1
    other: Floats1
    closeness: Floats1
    has_normals: bool


class Exact(NamedTuple):
    """The exact densities (B, k) of contacts, and the energy up to which they are known."""

    density: OutFloats2
    reached: float


class Equations(NamedTuple):
    """Cost (B,), gradient (B, 6) and Hessian (B, 6, 6), as a kernel fills them."""

    cost: OutFloats1
    gradient: OutFloats2
    hessian: OutFloats3


class Judged(NamedTuple):
    """What `judge` fills: see `ContactMixture.judge`."""

    cost: OutFloats1
    inlier_probability: OutFloats2
    noise_scale: OutFloats1
    misfit: OutFloats1


@inlined
def mix(d, n, m, lanes, doubts, cost, work):
    """The costs of energies d, n and m (k, lanes), 0 where d and n are; fills the factors, and what the pairs weigh."""
    point, turn, back, moved, total, most = work
    pairs = total.shape[0]
    for lane in range(lanes):
        cost[lane] = 0.0
        for q in range(pairs):
            total[q, lane] = doubts.probability[q]
    for i in range(d.shape[0]):
        for lane in range(lanes):
            per, root = 0.5**MOST_DOUBLINGS, 0.5 ** (0.5 * MOST_DOUBLINGS)
            by_point, by_turn, by_back = np.exp(-d[i, lane] * per), np.exp(-n[i, lane] * per), np.exp(-m[i, lane] * per)
            for a in range(MOST_DOUBLINGS, -1, -1):
                point[i, a, lane] = by_point * root
                turn[i, a, lane] = by_turn * per if doubts.has_normals else 1.0
                back[i, a, lane] = doubts.flipped[i] * by_back * per
                by_point, by_turn, by_back = by_point * by_point, by_turn * by_turn, by_back * by_back
                per, root = 2.0 * per, _ROOT_2 * root
            moved[i, lane] = doubts.displaced[i] * np.exp(-doubts.closeness[i] * d[i, lane])
            most[lane] = 0.0
        for q in range(pairs):
            s, t = doubts.s[q], doubts.t[q]
            for lane in range(lanes):
                by_point, by_turn = point[i, s, lane], turn[i, t, lane]
                false = (back[i, t, lane] + doubts.normal[i]) * by_point + moved[i, lane] * by_turn + doubts.other[i]
                total[q, lane] *= by_point * by_turn + false
                most[lane] = max(most[lane], total[q, lane])
        for lane in range(lanes):
            if not 1e-50 <= most[lane] <= 1e50:  # Many contacts' densities are too small or large for one number.
                cost[lane] -= np.log(most[lane])
                for q in range(pairs):
                    total[q, lane] /= most[lane]
    for lane in range(lanes):
        mass = 0.0
        for q in range(pairs):
            mass += total[q, lane]
        for q in range(pairs):
            total[q, lane] /= mass
        cost[lane] -= np.log(mass)


@inlined
def find_shares(i, lanes, doubts, work, shares):
    """That a contact is as told, and what its distance and its normal count for, into shares (4, lanes).

    These are the derivatives of the cost by its energies, that by n and that by m together; what the first of the two
    is more than the second, as a share of both, comes last.
    """
    point, turn, back, moved, total, _ = work
    for lane in range(lanes):
        told, weight_d, weight_n, weight_m = 0.0, 0.0, 0.0, 0.0
        for q in range(total.shape[0]):
            if total[q, lane] > 1e-6:
                by_point, by_turn = point[i, doubts.s[q], lane], turn[i, doubts.t[q], lane]
                as_told = by_point * by_turn
                flipped = by_point * back[i, doubts.t[q], lane]
                turned, displaced = doubts.normal[i] * by_point, moved[i, lane] * by_turn
                part = total[q, lane] / (as_told + flipped + turned + displaced + doubts.other[i])
                told += part * as_told
                weight_d += part * ((as_told + flipped + turned) * doubts.per_s[q] + displaced * doubts.closeness[i])
                weight_n += part * (as_told + displaced) * doubts.per_t[q]
                weight_m += part * flipped * doubts.per_t[q]
        shares[0, lane], shares[1, lane], shares[2, lane] = told, weight_d, weight_n + weight_m
        shares[3, lane] = (weight_n - weight_m) / (weight_n + weight_m) if weight_m > 0.0 else 1.0


@inlined
def make_work(contacts, doubts):
    """What `mix` fills: the contacts' factors by points, normals, flipped ones, as displaced; what the pairs weigh."""
    factors = (contacts, MOST_DOUBLINGS + 1, LANES)
    return (
        np.empty(factors),
        np.empty(factors),
        np.empty(factors),
        np.empty((contacts, LANES)),
        np.empty((len(doubts.s), LANES)),
        np.empty(LANES),
    )


@part
def _find_energies(
    grid: Grid, touch: Touch, lanes: int, w: OutFloats1, d: OutFloats2, n: OutFloats2, m: OutFloats2
) -> None:
    """The energies of each contact's distance, normal and flipped normal, into (k, lanes), by the distance field."""
    for i in range(touch.p.shape[0]):
        read_grid(grid, touch.p[i], touch.n[i], lanes, w)
        weigh(grid.inverse_spacing, touch.weight_p[i], touch.weight_n[i], lanes, w)
        for lane in range(lanes):
            d[i, lane], n[i, lane] = w[DISTANCE_ENERGY + np.uintp(lane)], w[NORMAL_ENERGY + np.uintp(lane)]
            m[i, lane] = w[FLIPPED_ENERGY + np.uintp(lane)]


@kernel
def mixture_equations(
    grid: Grid,
    touch: Touch,
    doubts: Doubts,
    prior: Prior,
    X: Floats3,
    equations: Equations,
) -> None:
    """Cost, its exact gradient and the Gauss-Newton Hessian at poses (B, 3, 4), of the contacts and the prior.

    The Hessian is that of the contacts' squares by what each counts for, as in iteratively reweighted least squares.
    There is no prior where its weights are zero.
    """
    cost, gradient, hessian = equations
    k = touch.p.shape[0]
    w, work = np.zeros(SIZE), make_work(k, doubts)
    d, n, m = np.empty((k, LANES)), np.empty((k, LANES)), np.empty((k, LANES))
    shares, g, H = np.empty((4, LANES)), np.empty(6), np.empty((6, 6))
    u, difference, D = np.empty(6), np.empty(6), np.empty((6, 6))
    for first in range(0, X.shape[0], LANES):
        lanes = min(LANES, X.shape[0] - first)
        enter(X, first, lanes, w)
        _find_energies(grid, touch, lanes, w, d, n, m)
        mix(d, n, m, lanes, doubts, cost[first:], work)
        for i in range(k):
            find_shares(i, lanes, doubts, work, shares)
            read_grid(grid, touch.p[i], touch.n[i], lanes, w)
            for lane in range(lanes):
                w[DISTANCE_SHARE + np.uintp(lane)] = shares[1, lane]
                w[NORMAL_SHARE + np.uintp(lane)], w[FACING + np.uintp(lane)] = shares[2, lane], shares[3, lane]
            add_equations(grid.inverse_spacing, touch.weight_p[i], touch.weight_n[i], lanes, w)
        for lane in range(lanes):
            b = first + lane
            leave(w, np.uintp(lane), X[b], g, H, gradient[b], hessian[b])
            if prior.weights[0] > 0.0:
                prior_row(prior, X[b], u, difference, D)
                cost[b] += half_square(difference)
                add_prior(prior, difference, D, gradient[b], hessian[b])


@kernel
def judge(
    grid: Grid, touch: Touch, doubts: Doubts, prior: Prior, exact: Exact, X: Floats3, judged: Judged, whole: bool
) -> None:
    """Judges poses (B, 3, 4): as a whole, or by their costs alone, and then all else that is judged stays as it is.

    Where the contacts' exact densities are more than exp(-reached), they take the place of d + n. Farther off they are
    cut, and the distance field is as good; how well a flipped normal fits is known by that field alone. The prior
    counts in the costs alone.
    """
    density, reached = exact
    k, least, u, shares = touch.p.shape[0], np.exp(-reached), np.empty(6), np.empty((4, LANES))
    w, work = np.zeros(SIZE), make_work(k, doubts)
    d, n, m = np.empty((k, LANES)), np.empty((k, LANES)), np.empty((k, LANES))
    for first in range(0, X.shape[0], LANES):
        lanes = min(LANES, X.shape[0] - first)
        enter(X, first, lanes, w)
        _find_energies(grid, touch, lanes, w, d, n, m)
        for lane in range(lanes):
            for i in range(k):
                if density[first + lane, i] > least:
                    both = -np.log(density[first + lane, i])
                    d[i, lane] = min(d[i, lane], max(both, 0.0))
                    n[i, lane] = both - d[i, lane]
                else:
                    n[i, lane] = max(d[i, lane] + n[i, lane], reached) - d[i, lane]
        mix(d, n, m, lanes, doubts, judged.cost[first:], work)
        for b in range(first, first + lanes):
            judged.cost[b] += prior_cost(prior, X[b], u)
        if not whole:
            continue
        for i in range(k):
            find_shares(i, lanes, doubts, work, shares)
            for lane in range(lanes):
                judged.inlier_probability[first + lane, i] = shares[0, lane]
        for lane in range(lanes):
            b, total = first + lane, work[4][:, lane]
            judged.noise_scale[b], narrowed, calmed = 0.0, 0.0, 0.0
            for pair in range(len(doubts.s)):
                judged.noise_scale[b] += total[pair] / np.sqrt(doubts.per_s[pair])
                narrowed += total[pair] * doubts.per_s[pair]
                calmed += total[pair] * doubts.per_t[pair]
            judged.misfit[b] = 0.0
            for i in range(k):
                judged.misfit[b] += judged.inlier_probability[b, i] * (d[i, lane] * narrowed + n[i, lane] * calmed)
