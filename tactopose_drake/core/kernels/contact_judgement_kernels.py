"""Evaluates the exact likelihood of contacts at poses, compiled; see `contact_mixture_kernels`."""

from typing import NamedTuple

import numpy as np

from tactopose_drake.core.compilation import kernel
from tactopose_drake.core.kernel_types import Floats3, OutFloats1, OutFloats2
from tactopose_drake.core.kernels.contact_mixture_kernels import Doubts, find_energies, find_shares, make_work, mix
from tactopose_drake.core.kernels.grid_kernels import Grid
from tactopose_drake.core.kernels.lane_kernels import LANES, SIZE, enter
from tactopose_drake.core.kernels.prior_kernels import Prior, prior_cost
from tactopose_drake.core.kernels.surface_contact_kernels import WeightedContacts


class Exact(NamedTuple):
    """The exact densities (B, k) of contacts, and the energy up to which they are accurate."""

    density: OutFloats2
    reached: float


class Judged(NamedTuple):
    """The output of `judge`, see `ContactMixture.judge`."""

    cost: OutFloats1
    inlier_probability: OutFloats2
    noise_scale: OutFloats1
    misfit: OutFloats1
    factors: OutFloats2


@kernel
def judge(
    grid: Grid,
    touch: WeightedContacts,
    doubts: Doubts,
    prior: Prior,
    exact: Exact,
    X: Floats3,
    judged: Judged,
    whole: bool,
) -> None:
    """Judges poses (B, 3, 4). Unless `whole`, only their costs are written.

    Where the exact density of a contact is more than exp(-reached), -log of it replaces d + n. Farther away the exact
    densities are truncated, and the distance field is as good; how well a flipped normal fits is always evaluated by
    the distance field. The prior enters only the costs.
    """
    density, reached = exact
    k, least, u = touch.p.shape[0], np.exp(-reached), np.empty(6)
    w, work = np.zeros(SIZE), make_work(k, doubts)
    d, n, shares = work.d, work.n, work.shares
    for first in range(0, X.shape[0], LANES):
        lanes = min(LANES, X.shape[0] - first)
        enter(X, first, lanes, w)
        find_energies(grid, touch, lanes, w, work)
        for lane in range(lanes):
            for i in range(k):
                if density[first + lane, i] > least:
                    both = -np.log(density[first + lane, i])
                    below = max(both, 0.0)
                else:
                    both, below = max(d[i, lane] + n[i, lane], reached), np.inf
                # Without normals, all of it is the point's: `mix` reads no other energy.
                d[i, lane] = min(d[i, lane], below) if doubts.has_normals else both
                n[i, lane] = both - d[i, lane]
        mix(lanes, doubts, work)
        for lane in range(lanes):
            judged.cost[first + lane] = work.cost[lane] + prior_cost(prior, X[first + lane], u)
        if not whole:
            continue
        for i in range(k):
            find_shares(i, lanes, doubts, work)
            for lane in range(lanes):
                judged.inlier_probability[first + lane, i] = shares[lane]
        for lane in range(lanes):
            b, total = first + lane, work.total
            judged.noise_scale[b], narrowed, calmed = 0.0, 0.0, 0.0
            for pair in range(len(doubts.s)):
                judged.factors[b, pair] = total[pair, lane]
                judged.noise_scale[b] += total[pair, lane] / np.sqrt(doubts.per_s[pair])
                narrowed += total[pair, lane] * doubts.per_s[pair]
                calmed += total[pair, lane] * doubts.per_t[pair]
            judged.misfit[b] = 0.0
            for i in range(k):
                judged.misfit[b] += judged.inlier_probability[b, i] * (d[i, lane] * narrowed + n[i, lane] * calmed)
