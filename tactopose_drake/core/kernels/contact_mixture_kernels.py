"""The mixture likelihood of contacts that may be outliers, with noise that may exceed what is told, compiled.

Let d be the energy of a contact's distance from the surface (half its whitened square), n that of its normal, m that of
the flipped normal, and let the variances of points and normals be s and t times what is told. Relative to the density
of an exact contact, the density of each kind is

    as told                  exp(-d / s - n / t) / (sqrt(s) t),
    with a flipped normal    f_m exp(-d / s - m / t) / (sqrt(s) t),
    with an arbitrary normal f_n exp(-d / s) / sqrt(s),
    displaced                f_d exp(-c d - n / t) / t,
    of something else        f_p,

without t, n and m if there is no normal. For contact i, their sum with the odds f of independent outliers is a_i, and
that of the false kinds, with the odds of being the single outlier of all contacts, is b_i. The factors s and t are the
same for all contacts: the likelihood is the sum over pairs (s, t) of their prior probability times

    prod_i a_i (1 + sum_i b_i / a_i).

The factors are powers of two, so that one exponential of each energy suffices for all.
"""

import math
from typing import NamedTuple

import numpy as np

from tactopose_drake.core.compilation import inlined, part
from tactopose_drake.core.kernel_types import Floats1, Floats2, Floats3, Longs1, OutFloats1, OutFloats2, OutFloats3
from tactopose_drake.core.kernels.grid_kernels import Grid
from tactopose_drake.core.kernels.lane_kernels import (
    DISTANCE_ENERGY,
    DISTANCE_SHARE,
    FACING,
    FLIPPED_ENERGY,
    LANES,
    NORMAL_ENERGY,
    NORMAL_SHARE,
    add_equations,
    enter,
    read_grid,
    weigh,
)
from tactopose_drake.core.kernels.surface_contact_kernels import WeightedContacts

# The factors of the variances are two to the powers 0 to MOST_DOUBLINGS.
MOST_DOUBLINGS = 4
_ROOT_2 = math.sqrt(2.0)
# Taylor coefficients of exp(x), and the largest |x| for which it does not overflow.
_SERIES = tuple(1.0 / math.factorial(order) for order in range(9))
_MOST = 700.0
# Where the rows of shares after the first begin: the weights of a contact's distance and normal, and how it faces.
BY_D, BY_N, FACES = (np.uintp(LANES * row) for row in (1, 2, 3))


class Doubts(NamedTuple):
    """Prior probabilities of the kinds of contacts and of the noise's size, read-only.

    Attributes:
        s, t: logarithms to base two of the pairs of factors, shape (q,); the first pair is (0, 0).
        per_s, per_t: one over the factors, shape (q,).
        probability: prior probability of each pair over that of the first, shape (q,).
        flipped, normal, displaced, other: f_m, f_n, f_d and f_p, of independent outliers in row 0 and of the single one
            in row 1, shape (2, k); 0 for impossible kinds, but f_p of independent ones is always above 0.
        closeness: c, the contact's variance over that of its displacement if displaced, shape (k,).
        has_normals: whether there are normals.
    """

    s: Longs1
    t: Longs1
    per_s: Floats1
    per_t: Floats1
    probability: Floats1
    flipped: Floats2
    normal: Floats2
    displaced: Floats2
    other: Floats2
    closeness: Floats1
    has_normals: bool


class MixtureScratch(NamedTuple):
    """Input and output of `mix`, for k contacts, f factors of the variances, q pairs of them, and the lanes.

    Attributes:
        d, n, m: the energies of distances, normals and flipped normals, shape (k, lanes).
        point, turn, back: the factors of a contact's density that belong to d, n and m, shape (k, f, lanes).
        moved: exp(-c d), the one that belongs to d if the contact is displaced, shape (k, lanes).
        total: posterior probability of each pair of factors, shape (q, lanes).
        by_itself: the part of it in which all outliers are independent, shape (q, lanes).
        most: scratch, the largest total, shape (lanes,).
        cost: of each pose, shape (lanes,).
        shares: the output of `find_shares`, four rows of lanes.
    """

    d: OutFloats2
    n: OutFloats2
    m: OutFloats2
    point: OutFloats3
    turn: OutFloats3
    back: OutFloats3
    moved: OutFloats2
    total: OutFloats2
    by_itself: OutFloats2
    most: OutFloats1
    cost: OutFloats1
    shares: OutFloats1


@part
def mix(lanes: int, doubts: Doubts, work: MixtureScratch) -> None:
    """Costs from the energies, relative to contacts with d = n = 0; also fills the factors and the pairs' posterior."""
    point, turn, back, moved = work.point, work.turn, work.back, work.moved
    total, by_itself, most, cost = work.total, work.by_itself, work.most, work.cost
    pairs = total.shape[0]
    for lane in range(lanes):
        cost[lane] = 0.0
        for q in range(pairs):
            total[q, lane] = by_itself[q, lane] = doubts.probability[q]
    for i in range(work.d.shape[0]):
        _find_factors(i, lanes, doubts, work)
        (f_m, f_n, f_d, f_p), (g_m, g_n, g_d, g_p) = _odds(doubts, 0, i), _odds(doubts, 1, i)
        for q in range(pairs):
            s, t = doubts.s[q], doubts.t[q]
            for lane in range(lanes):
                by_point, by_back, displaced = point[i, s, lane], back[i, t, lane], moved[i, lane] * turn[i, t, lane]
                own = by_point * turn[i, t, lane] + ((f_m * by_back + f_n) * by_point + f_d * displaced + f_p)
                one = (g_m * by_back + g_n) * by_point + g_d * displaced + g_p
                total[q, lane] = total[q, lane] * own + by_itself[q, lane] * one
                by_itself[q, lane] *= own
        for lane in range(lanes):
            most[lane] = total[0, lane]
        for q in range(1, pairs):
            for lane in range(lanes):
                most[lane] = max(most[lane], total[q, lane])
        for lane in range(lanes):
            if not 1e-50 <= most[lane] <= 1e50:  # Rescaled, as the product of many densities would over- or underflow.
                cost[lane] -= np.log(most[lane])
                for q in range(pairs):
                    total[q, lane] /= most[lane]
                    by_itself[q, lane] /= most[lane]
    for lane in range(lanes):
        mass = 0.0
        for q in range(pairs):
            mass += total[q, lane]
        for q in range(pairs):
            total[q, lane] /= mass
            by_itself[q, lane] /= mass
        cost[lane] -= np.log(mass)


@inlined
def _odds(doubts, row, i):
    """The odds of a contact's false kinds, as an independent outlier (row 0) or as the single one (row 1)."""
    return doubts.flipped[row, i], doubts.normal[row, i], doubts.displaced[row, i], doubts.other[row, i]


@inlined
def _exp_minus(x):
    """exp(-x) as the 1024th power of a short series, with relative error 1e-12 unless it is negligibly small.

    NumPy's exp is scalar here; a loop over this one is vectorised by the compiler.
    """
    y = max(min(x, _MOST), -_MOST) * (-1.0 / 1024.0)
    high = _SERIES[4] + y * (_SERIES[5] + y * (_SERIES[6] + y * (_SERIES[7] + y * _SERIES[8])))
    power = 1.0 + y * (1.0 + y * (_SERIES[2] + y * (_SERIES[3] + y * high)))
    for _ in range(10):
        power = power * power
    return power


@inlined
def _find_factors(i, lanes, doubts, work):
    """The factors of a contact's densities, from its energies, for each scale of the noise."""
    d, n, m, closeness = work.d, work.n, work.m, doubts.closeness[i]
    point, turn, back, moved = work.point, work.turn, work.back, work.moved
    least, root = 0.5**MOST_DOUBLINGS, 0.5 ** (0.5 * MOST_DOUBLINGS)
    for lane in range(lanes):
        point[i, MOST_DOUBLINGS, lane] = _exp_minus(d[i, lane] * least)
        moved[i, lane] = _exp_minus(closeness * d[i, lane])
    for lane in range(lanes):
        turn[i, MOST_DOUBLINGS, lane] = _exp_minus(n[i, lane] * least)
        back[i, MOST_DOUBLINGS, lane] = _exp_minus(m[i, lane] * least)
    for a in range(MOST_DOUBLINGS - 1, -1, -1):
        for lane in range(lanes):
            point[i, a, lane] = point[i, a + 1, lane] * point[i, a + 1, lane]
            turn[i, a, lane] = turn[i, a + 1, lane] * turn[i, a + 1, lane]
            back[i, a, lane] = back[i, a + 1, lane] * back[i, a + 1, lane]
    for a in range(MOST_DOUBLINGS, -1, -1):
        for lane in range(lanes):
            point[i, a, lane] *= root
            back[i, a, lane] *= least
            turn[i, a, lane] = turn[i, a, lane] * least if doubts.has_normals else 1.0
        least, root = 2.0 * least, _ROOT_2 * root


@part
def find_shares(i: int, lanes: int, doubts: Doubts, work: MixtureScratch) -> None:
    """Fills the rows of shares: a contact's inlier probability, its distance's and normal's weights, and its facing.

    The weights are the derivatives of the cost with respect to d, and to n and m together. With w_n and w_m those with
    respect to n and m, the last row is (w_n - w_m) / (w_n + w_m).
    """
    shares, moved = work.shares, work.moved[i]
    for lane in range(FACES + np.uintp(LANES)):
        shares[lane] = 0.0
    (f_m, f_n, f_d, f_p), (g_m, g_n, g_d, g_p) = _odds(doubts, 0, i), _odds(doubts, 1, i)
    closeness = doubts.closeness[i]
    for q in range(work.total.shape[0]):
        point, turn, back = work.point[i, doubts.s[q]], work.turn[i, doubts.t[q]], work.back[i, doubts.t[q]]
        per_s, per_t, total, by_itself = doubts.per_s[q], doubts.per_t[q], work.total[q], work.by_itself[q]
        for lane in range(np.uintp(lanes)):
            by_back, displaced = point[lane] * back[lane], moved[lane] * turn[lane]
            own = point[lane] * turn[lane] + ((f_m * back[lane] + f_n) * point[lane] + f_d * displaced + f_p)
            one = (g_m * back[lane] + g_n) * point[lane] + g_d * displaced + g_p
            # Posterior weight of the other contacts: without a single outlier among them, and with or without.
            per_own = 1.0 / own
            none = by_itself[lane] * per_own
            others = max((total[lane] - none * one) * per_own, none)
            as_told, flipped = others * point[lane] * turn[lane], (others * f_m + none * g_m) * by_back
            turned, displaced = (others * f_n + none * g_n) * point[lane], (others * f_d + none * g_d) * displaced
            shares[lane] += as_told
            shares[BY_D + lane] += (as_told + flipped + turned) * per_s + displaced * closeness
            shares[BY_N + lane] += (as_told + displaced) * per_t
            shares[FACES + lane] += flipped * per_t
    for lane in range(np.uintp(lanes)):
        by_n, by_m = shares[BY_N + lane], shares[FACES + lane]
        shares[BY_N + lane] = by_n + by_m
        shares[FACES + lane] = (by_n - by_m) / (by_n + by_m) if by_m > 0.0 else 1.0


@part
def make_work(contacts: int, doubts: Doubts) -> MixtureScratch:
    """Allocates scratch for a number of contacts."""
    each, factors, pairs = (contacts, LANES), (contacts, MOST_DOUBLINGS + 1, LANES), (len(doubts.s), LANES)
    return MixtureScratch(
        np.empty(each),
        np.empty(each),
        np.empty(each),
        np.empty(factors),
        np.empty(factors),
        np.empty(factors),
        np.empty(each),
        np.empty(pairs),
        np.empty(pairs),
        np.empty(LANES),
        np.empty(LANES),
        np.empty(4 * LANES),
    )


@part
def find_energies(grid: Grid, touch: WeightedContacts, lanes: int, w: OutFloats1, work: MixtureScratch) -> None:
    """The energies of each contact's distance, normal and flipped normal, from the distance field."""
    for i in range(touch.p.shape[0]):
        read_grid(grid, touch.p[i], touch.n[i], lanes, w)
        weigh(grid.inverse_spacing, touch.weight_p[i], touch.weight_n[i], lanes, w)
        for lane in range(np.uintp(lanes)):
            work.d[i, lane], work.n[i, lane] = w[DISTANCE_ENERGY + lane], w[NORMAL_ENERGY + lane]
            work.m[i, lane] = w[FLIPPED_ENERGY + lane]


@part
def add_up_doubted(
    grid: Grid, touch: WeightedContacts, doubts: Doubts, X: Floats3, lanes: int, w: OutFloats1, work: MixtureScratch
) -> None:
    """Writes costs to `work`, and adds gradients and Hessians to the rows w, at poses X (3, 4), one per lane.

    The gradient is exact. The Hessian is that of the weighted squares of the contacts, as in iteratively reweighted
    least squares.
    """
    enter(X, 0, lanes, w)
    find_energies(grid, touch, lanes, w, work)
    mix(lanes, doubts, work)
    for i in range(touch.p.shape[0]):
        find_shares(i, lanes, doubts, work)
        read_grid(grid, touch.p[i], touch.n[i], lanes, w)
        for lane in range(np.uintp(lanes)):
            w[DISTANCE_SHARE + lane], w[NORMAL_SHARE + lane] = work.shares[BY_D + lane], work.shares[BY_N + lane]
            w[FACING + lane] = work.shares[FACES + lane]
        add_equations(grid.inverse_spacing, touch.weight_p[i], touch.weight_n[i], lanes, w)
