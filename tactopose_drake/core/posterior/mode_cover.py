"""Covers modes with proposal densities for importance sampling, and finds which of the modes are one.

A narrow mode is covered by a density like Laplace's approximation. A wide one bends, and has bumps along its floor:
tiles are placed along it, more for a wider mode. Modes with hardly any barrier between them are one, whether
directly or through minima that the search has missed and the samples lead to. Where a single contact leaves a whole
surface of poses, poses drawn from all of it are among the samples; see `single_contact.py`.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.kernels.matrix_kernels import inverses
from tactopose_drake.core.kernels.mode_kernels import one_of_each
from tactopose_drake.core.posterior import importance_sampling_kernels
from tactopose_drake.core.posterior.joined_modes import Families, Landscape, find_families
from tactopose_drake.core.posterior.joining_kernels import Lengths
from tactopose_drake.core.posterior.modes import Modes
from tactopose_drake.core.posterior.posterior import Posterior
from tactopose_drake.core.posterior.single_contact import ContactDraws
from tactopose_drake.core.posterior.student_t_mixture import StudentTMixture, across_turns, draw, in_chart
from tactopose_drake.core.searches.levenberg_marquardt import TO_THE_MINIMUM
from tactopose_drake.core.validation import FloatArray


class Cover(NamedTuple):
    """The proposal densities for those modes that are worth sampling.

    Attributes:
        close: indices of the modes of non-negligible weight, shape (c,).
        lowest: the lowest known cost of these.
        laplace: log masses by Laplace's approximation, up to a common constant, shape (c,).
        worthy: indices into `close` of the modes that are sampled, shape (g,).
        X_PO: the sampled modes' minima, shape (g, 3, 4).
        cost: the smooth cost of these, shape (g,).
        information: Hessians of Laplace's approximation there, shape (g, 6, 6).
        tiles: number of tiles in a round of sampling, besides the one at each mode and those for the tails.
        proposal: the mixture of the first round, over increments from the sampled modes.
        by_contact: likely poses drawn from all that a single contact leaves; none if there is more.
        cost_by_contact: their exact costs, shape (n,).
    """

    close: NDArray[np.intp]
    lowest: float
    laplace: FloatArray
    worthy: NDArray[np.intp]
    X_PO: FloatArray
    cost: FloatArray
    information: FloatArray
    tiles: int
    proposal: StudentTMixture
    by_contact: ContactDraws
    cost_by_contact: FloatArray


def cover_modes(modes: Modes, posterior: Posterior, generator: np.random.Generator) -> Cover | None:
    """Covers the modes with proposals. Returns None where Laplace's approximation must do, as it cannot be inverted."""
    mixture, params = modes.mixture, posterior.params.sampling
    close = (mixture.weights > params.least_weighed_share * mixture.weights.max()).nonzero()[0]
    X_close = mixture.X_PO[close]
    information = inverses(mixture.covariance[close])[0] + posterior.gauge
    if not np.isfinite(information).all():
        return None  # The condition number of a mode's covariance exceeds double precision.
    least = np.minimum(posterior.exact_cost(X_close), modes.cost[close])
    laplace = -least - 0.5 * across_turns(information, posterior.turn_directions(X_close))[1]
    share = np.exp(laplace - laplace.max())
    share /= share.sum()
    worthy = (share > params.least_sampled_share).nonzero()[0]
    X_worthy, share, information = X_close[worthy], share[worthy], information[worthy]
    wide = inverses(np.concatenate([information + posterior.held, information]))[1].reshape(2, -1)
    wanted = params.tiles * float(share @ np.exp(0.5 * (wide[0] - wide[1])))
    # min and max also turn a NaN from rounding into the fewest tiles.
    tiles = round(min(params.most_tiles, max(params.fewest_tiles, wanted)))
    proposal = _tile(X_worthy, share, information, tiles, posterior, generator)
    lowest = float(least.min())
    by_contact = _draw_by_contact(lowest, X_worthy, posterior, generator)
    cost = modes.cost[close[worthy]]
    return Cover(close, lowest, laplace, worthy, X_worthy, cost, information, tiles, proposal, *by_contact)


def tile_samples(
    X_PO: FloatArray, weights: FloatArray, cover: Cover, samples: int, posterior: Posterior
) -> StudentTMixture:
    """A proposal for the given number of samples, with tiles at samples (B, 3, 4) resampled by weights (B, g)."""
    params, X_mode = posterior.params.sampling, cover.X_PO
    index, owner, times = _resample(weights, cover.tiles)
    local = posterior.objective.normal_equations(X_PO[index]).hessian + posterior.held
    center, local, turns = in_chart(X_mode, owner, X_PO[index], local, posterior.turn_directions(X_PO[index]))
    count = times * (samples // cover.tiles)
    return StudentTMixture(X_mode, owner, center, local, turns, count, params.freedom, params.farthest)


def minima_between(X_PO: FloatArray, weights: FloatArray, cover: Cover, posterior: Posterior) -> FloatArray:
    """Minima (n, 3, 4) between the sampled modes, refined from samples (B, 3, 4) of these weights (B, g)."""
    X_mode, params = cover.X_PO, posterior.params.moments
    X_found = TO_THE_MINIMUM.refine(posterior.objective, X_PO[_resample(weights, params.led).sample]).X_PO
    every = np.concatenate([X_mode, X_found])
    found = posterior.objective.normal_equations(X_found).hessian + posterior.held
    information = np.concatenate([cover.information, found])
    apart = one_of_each(every, information, posterior.symmetry_poses, params.apart)
    return every[apart[apart >= len(X_mode)][: params.most_between]]


def join_modes(cover: Cover, posterior: Posterior, X_between: FloatArray | None = None) -> Families:
    """Finds which of the sampled modes are one, directly or through minima (n, 3, 4) between them."""
    longest = posterior.params.sampling.longest_step * posterior.size
    lengths = Lengths(posterior.units, longest, 1.0 / posterior.straight**2)
    return find_families(
        cover.X_PO,
        cover.cost,
        Landscape(posterior.objective, lengths, posterior.false_ones),
        posterior.symmetry_poses,
        posterior.size,
        X_between,
        posterior.params.moments,
    )


def density_by_contact(X_PO: FloatArray, cover: Cover, posterior: Posterior) -> tuple[FloatArray, ...]:
    """The density of the draws by a single contact at poses (B, 3, 4), times their number, shape (B, g).

    It is that of the nearest mode, and zero for the others; there is none without such draws.
    """
    contact, scale = posterior.single_contact, cover.by_contact.scale
    if contact is None or scale == 0.0:
        return ()
    density, nearest = np.zeros((len(X_PO), len(cover.X_PO))), np.empty(len(X_PO), dtype=np.intp)
    importance_sampling_kernels.find_nearest_modes(X_PO, cover.X_PO, 0.5 * posterior.size, nearest)
    density[np.arange(len(X_PO)), nearest] = scale * contact.density(X_PO)
    return (density,)


def _draw_by_contact(
    lowest: float, X_mode: FloatArray, posterior: Posterior, generator: np.random.Generator
) -> tuple[ContactDraws, FloatArray]:
    """Those of the draws by a single contact, if there are any, that belong to a mode, and their costs (n,).

    All others weigh nothing.
    """
    contact, params = posterior.single_contact, posterior.params.sampling
    if contact is None:
        return ContactDraws(np.empty((0, 3, 4)), 0.0), np.empty(0)
    X_PO, scale = contact.sample(params.contact_draws, generator)
    X_PO = contact.turned(X_PO, X_mode)
    cost = cost_within_modes(X_PO, X_mode, posterior)
    likely = cost < lowest + params.most_excess_cost
    likely[likely] = contact.density(X_PO[likely]) > 0.0
    return ContactDraws(X_PO[likely], scale), cost[likely]


def cost_within_modes(X_PO: FloatArray, X_mode: FloatArray, posterior: Posterior) -> FloatArray:
    """The exact cost of samples (B, 3, 4); infinite for those that belong to no mode.

    Only one image of each pose counts, the nearest to a mode; otherwise a mode wide enough to reach its own images
    would count repeatedly. Poses out of touch do not count: without a prior their volume has no bound.
    """
    if len(posterior.symmetry_poses) == 1 and not posterior.excludes_out_of_touch:
        return posterior.exact_cost(X_PO)
    counts = np.ones(len(X_PO), dtype=np.bool_)
    if len(posterior.symmetry_poses) > 1:
        nearest = np.empty(len(X_PO), dtype=np.intp)
        importance_sampling_kernels.find_nearest_images(
            X_PO, X_mode, posterior.symmetry_poses, 0.5 * posterior.size, nearest
        )
        counts = nearest == 0
    if posterior.excludes_out_of_touch and posterior.false_ones is not None:
        counts &= ~posterior.false_ones(X_PO).all(axis=1)
    cost = np.full(len(X_PO), np.inf)
    cost[counts] = posterior.exact_cost(X_PO[counts])
    return cost


def _resample(weights: FloatArray, count: int) -> importance_sampling_kernels.Drawn:
    """Resamples `count` samples by their weights (B, g), and drops those that are not drawn."""
    drawn = importance_sampling_kernels.Drawn(*np.empty((3, count), dtype=np.int64))
    different = importance_sampling_kernels.resample(weights, drawn)
    return importance_sampling_kernels.Drawn(*(each[:different] for each in drawn))


def _tile(
    X_mode: FloatArray,
    share: FloatArray,
    information: FloatArray,
    tiles: int,
    posterior: Posterior,
    generator: np.random.Generator,
) -> StudentTMixture:
    """A mixture that covers the sampled modes with about `tiles` tiles, besides one at each, and the tails."""
    params = posterior.params.sampling
    # The square root leaves tiles for modes that Laplace's approximation underestimates.
    root_share = np.sqrt(share)
    counts = 1 + np.rint(tiles * root_share / root_share.sum()).astype(np.intp)
    each = np.arange(len(X_mode))
    group = each.repeat(counts)
    white = generator.normal(scale=params.tile_scatter, size=(int(counts.max()), 6))
    white[0] = 0.0  # The first tile of each mode is centred on it.
    laplace = draw(X_mode, each, np.zeros((len(X_mode), 6)), information, counts, white, opposed=False)
    likely = (share > params.least_tailed_share).nonzero()[0]
    X_PO = np.concatenate([_to_the_floor(laplace, posterior), X_mode[likely]])
    smooth, _, hessian = posterior.objective.normal_equations(X_PO)
    hessian, every = hessian + posterior.held, len(group)
    weight = np.exp(0.5 * (smooth[:every].min() - smooth[:every])) + params.least_tile_weight
    count = np.maximum(1, np.rint(params.round_of(tiles) * weight / weight.sum())).astype(np.intp)
    owner, tails = _tails(X_mode[likely], hessian[every:], posterior)
    each_tail = max(params.least_tail_samples, round(params.tail_samples / max(len(owner), 1)))
    group = np.concatenate([group, likely[owner]])
    order = group.argsort(kind="stable")
    group, X_PO = group[order], X_PO[np.concatenate([np.arange(every), every + owner])[order]]
    hessian = np.concatenate([hessian[:every], tails])[order]
    count = np.concatenate([count, np.full(len(owner), each_tail, dtype=np.intp)])[order]
    center, local, turns = in_chart(X_mode, group, X_PO, hessian, posterior.turn_directions(X_PO))
    return StudentTMixture(X_mode, group, center, local, turns, count, params.freedom, params.farthest)


def _tails(X_mode: FloatArray, held: FloatArray, posterior: Posterior) -> tuple[NDArray[np.intp], FloatArray]:
    """Proposals for where a mode extends if one of the contacts is false: of little mass, but far from its middle.

    Args:
        X_mode: modes, shape (n, 3, 4).
        held: their information, including what every tile has, shape (n, 6, 6).
        posterior: what is sampled.

    Returns:
        The index of the mode that each is about, shape (t,), and its information, shape (t, 6, 6). If there are too
        many, those that extend farthest.
    """
    if posterior.alternatives is None:
        return np.empty(0, dtype=np.intp), np.empty((0, 6, 6))
    most = posterior.params.sampling.most_tails
    left = posterior.alternatives(X_mode, held)
    owner, left = np.repeat(np.arange(len(held)), left.shape[1]), left.reshape(-1, 6, 6)
    if len(left) > most:
        lost = np.linalg.slogdet(held)[1][owner] - np.linalg.slogdet(left)[1]
        far = np.sort(np.argsort(-lost, kind="stable")[:most])
        owner, left = owner[far], left[far]
    return owner, left


def _to_the_floor(X_PO: FloatArray, posterior: Posterior) -> FloatArray:
    """Gauss-Newton steps of poses (B, 3, 4) along the directions that the touch determines well; damped in others."""
    params, units = posterior.params.sampling, posterior.units
    soft, longest = 1.0 / (units * posterior.straight) ** 2, params.longest_step * posterior.size
    for _ in range(params.steps if len(X_PO) else 0):
        _, gradient, hessian = posterior.likelihood.normal_equations(X_PO)
        importance_sampling_kernels.step_down(gradient, hessian, soft, units, longest, X_PO)
    return X_PO
