"""The mass and the spread of each mode, by importance sampling of the exact posterior.

Laplace's approximation takes each mode for a Gaussian by its curvature. Real modes have kinks where a contact passes an
edge, and bend where a direction is hardly determined: a Gaussian that fits at the middle leaves the valley. Therefore
each mode is covered by tiles, densities like Laplace's that lie along its floor; samples of their mixture are weighted
by the exact posterior over the mixture [OZ00]; and a mode's mass, its pose and the spread about it are its samples'.
Modes between which the density hardly falls are joined.

Source: [OZ00] A. Owen and Y. Zhou, Safe and effective importance sampling, J. Am. Stat. Assoc. 95, 2000 (deterministic
mixture weights). [CDG08] O. Cappe et al., Adaptive importance sampling in general mixture classes, Stat. Comput. 18,
2008. [CMMR12] J.-M. Cornuet et al., Adaptive multiple importance sampling, Scand. J. Stat. 39, 2012.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.kernels.matrix_kernels import inverses
from tactopose_drake.core.plain_values import copied
from tactopose_drake.core.posterior import importance_sampling_kernels
from tactopose_drake.core.posterior.doubted_spread import widen_by_doubt
from tactopose_drake.core.posterior.gaussian_mixture import GaussianMixture
from tactopose_drake.core.posterior.hypotheses import Modes, free_directions
from tactopose_drake.core.posterior.joined_modes import Families, find_families
from tactopose_drake.core.posterior.mode_moments import Moments, toward_the_mean, weigh_moments
from tactopose_drake.core.posterior.posterior import Posterior
from tactopose_drake.core.posterior.student_t_mixture import (
    Increments,
    StudentTMixture,
    across_turns,
    draw,
    in_chart,
)
from tactopose_drake.core.validation import FloatArray

# Logarithm of the volume of the turns about one continuous axis, or about the three of a ball.
_LOG_TURNS = {0: 0.0, 1: np.log(2.0 * np.pi), 3: np.log(8.0 * np.pi**2)}


class Cover(NamedTuple):
    """The densities that cover those of some modes that are worth sampling.

    Attributes:
        close: which modes are not out of the question, shape (c,).
        lowest: the lowest of their costs that is known.
        laplace: the logarithms of their masses by Laplace's approximation, but for what all have in common, shape (c,).
        worthy: which of these are sampled, shape (g,).
        proposal: the densities, over increments from the sampled modes.
        families: which of the sampled modes are one.
    """

    close: NDArray[np.intp]
    lowest: float
    laplace: FloatArray
    worthy: NDArray[np.intp]
    proposal: StudentTMixture
    families: Families


def weigh_modes(modes: Modes, posterior: Posterior, generator: np.random.Generator) -> Modes:
    """The modes with the mass and covariance that samples of the exact posterior give them.

    Each is no narrower than the doubt of single contacts makes it, which few of the samples show.
    """
    cover = cover_modes(modes, posterior, generator)
    return widen_by_doubt(modes if cover is None else weigh_covered(modes, cover, posterior, generator), posterior)


def cover_modes(modes: Modes, posterior: Posterior, generator: np.random.Generator) -> Cover | None:
    """Covers the modes: the first half of the work. None where they cannot be: Laplace's approximation has to do."""
    mixture, params = modes.mixture, posterior.params.sampling
    close = (mixture.weights > params.least_weighed_share * mixture.weights.max()).nonzero()[0]
    X_close = mixture.X_PO[close]
    information = inverses(mixture.covariance[close])[0] + posterior.gauge
    if not np.isfinite(information).all():
        return None  # What is best known of one and the rest of it do not fit into doubles.
    least = np.minimum(posterior.exact_cost(X_close), modes.cost[close])
    laplace = -least - 0.5 * across_turns(information, posterior.turn_directions(X_close))[1]
    share = np.exp(laplace - laplace.max())
    share /= share.sum()
    worthy = (share > params.least_sampled_share).nonzero()[0]
    proposal = _cover(X_close[worthy], share[worthy], information[worthy], posterior, generator)
    families = find_families(
        X_close[worthy],
        posterior.objective,
        lambda X_PO: _to_the_floor(X_PO, posterior),
        posterior.symmetry_poses,
        posterior.size,
        posterior.params.moments,
    )
    return Cover(close, float(least.min()), laplace, worthy, proposal, families)


def weigh_covered(modes: Modes, cover: Cover, posterior: Posterior, generator: np.random.Generator) -> Modes:
    """Draws samples of what covers the modes, and weighs the modes by them: the other half."""
    close, worthy = cover.close, cover.worthy
    increments, weights, lowest, error = _draw(cover, posterior, generator)
    moments = weigh_moments(increments, weights)
    if not (moments.effective_samples > 1.0).any():
        return modes  # One sample outweighs all others: they say less than Laplace's approximation.
    every = np.exp(cover.laplace + lowest) * (2.0 * np.pi) ** (3.0 - 0.5 * len(posterior.turns[0]))
    every[worthy] = weights.sum(axis=0)
    masses = modes.mixture.weights * (every.sum() / modes.mixture.weights[close].sum())
    masses[close] = every
    log_mass = float(np.log(masses.sum()) - lowest + _LOG_TURNS[len(posterior.turns[0])])
    found = _update(modes, close[worthy], masses / masses.sum(), moments, cover.families, posterior, log_mass)
    return copied(found, standard_error=error)


class _Samples(NamedTuple):
    """Samples' increments (B, g, 6) from the modes, their weights (B, g) in the modes' shares, and the lowest cost.

    The weights are over the density exp(lowest - cost); `standard_error` is the largest of the modes' probabilities.
    """

    increments: FloatArray
    weights: FloatArray
    lowest: float
    standard_error: float


def _draw(cover: Cover, posterior: Posterior, generator: np.random.Generator) -> _Samples:
    """Samples, so many that the modes' probabilities are sure enough, or as many as are drawn at the most.

    Where those of one round are not enough, the next are drawn about them as their weights say [CDG08]; all are weighed
    by all proposals together [CMMR12].
    """
    params, proposal, families, lowest = posterior.params.sampling, cover.proposal, cover.families, cover.lowest
    X_mode, g = families.X_PO, len(families.X_PO)
    most = max(params.most_samples, int(proposal.count.sum()))
    X_PO, cost, density, weights = np.empty((most, 3, 4)), np.empty(most), np.zeros((most, g)), np.empty((most, g))
    increments, drawn = Increments.empty(most, g), 0
    proposals: list[StudentTMixture] = []
    while True:
        proposals.append(proposal)
        fresh = slice(drawn, drawn + int(proposal.count.sum()))
        X_PO[fresh] = proposal.sample(generator)
        to_fresh = increments.part(fresh).find(X_mode, X_PO[fresh])
        for earlier in proposals[:-1]:
            earlier.add_to(density[fresh], to_fresh)
        drawn, all_drawn = fresh.stop, slice(fresh.stop)
        proposal.add_to(density[all_drawn], increments.part(all_drawn))
        cost[fresh] = _cost_of_one_image(X_PO[fresh], X_mode, posterior)
        lowest, error, worth = importance_sampling_kernels.weigh(
            cost[all_drawn],
            lowest,
            density[all_drawn],
            families.family,
            np.concatenate([each.count for each in proposals]),
            weights[all_drawn],
        )
        sure = error <= params.standard_error and worth >= params.effective_samples
        count = max(params.samples, int(params.growth * drawn))
        if sure or worth == 0.0 or drawn + count > params.most_samples:
            return _Samples(increments.u[all_drawn], weights[all_drawn], lowest, error)
        proposal = _about(X_PO[all_drawn], weights[all_drawn], X_mode, count, posterior)


def _cost_of_one_image(X_PO: FloatArray, X_mode: FloatArray, posterior: Posterior) -> FloatArray:
    """The exact cost of samples (B, 3, 4); infinite where an image by a symmetry is nearer to a mode than the sample.

    Of all images of a pose one counts, or modes that are wide enough to reach their own images would count manyfold.
    """
    if len(posterior.symmetry_poses) == 1:
        return posterior.exact_cost(X_PO)
    nearest = np.empty(len(X_PO), dtype=np.intp)
    importance_sampling_kernels.find_nearest_images(
        X_PO, X_mode, posterior.symmetry_poses, 0.5 * posterior.size, nearest
    )
    cost, own = np.full(len(X_PO), np.inf), nearest == 0
    cost[own] = posterior.exact_cost(X_PO[own])
    return cost


def _about(
    X_PO: FloatArray, weights: FloatArray, X_mode: FloatArray, samples: int, posterior: Posterior
) -> StudentTMixture:
    """Tiles for so many samples, about ones (B, 3, 4) as often as their weights (B, g) say."""
    params = posterior.params.sampling
    drawn = importance_sampling_kernels.Drawn(*np.empty((3, params.tiles), dtype=np.int64))
    different = importance_sampling_kernels.resample(weights, drawn)
    index, owner, times = (each[:different] for each in drawn)
    local = posterior.objective.normal_equations(X_PO[index]).hessian + posterior.held
    center, local, turns = in_chart(X_mode, owner, X_PO[index], local, posterior.turn_directions(X_PO[index]))
    count = times * (samples // params.tiles)
    return StudentTMixture(X_mode, owner, center, local, turns, count, params.freedom, params.farthest)


def _cover(
    X_mode: FloatArray,
    share: FloatArray,
    information: FloatArray,
    posterior: Posterior,
    generator: np.random.Generator,
) -> StudentTMixture:
    """A mixture that covers the sampled modes: one density for a narrow one, tiles along a wide one."""
    params = posterior.params.sampling
    # The root leaves something for modes that Laplace's approximation underrates.
    root_share = np.sqrt(share)
    counts = 1 + np.rint(params.tiles * root_share / root_share.sum()).astype(np.intp)
    each = np.arange(len(X_mode))
    group = each.repeat(counts)
    white = generator.normal(scale=params.tile_scatter, size=(int(counts.max()), 6))
    white[0] = 0.0  # The first at each mode stands in its middle.
    laplace = draw(X_mode, each, np.zeros((len(X_mode), 6)), information, counts, white, opposed=False)
    likely = (share > params.least_tailed_share).nonzero()[0]
    X_PO = np.concatenate([_to_the_floor(laplace, posterior), X_mode[likely]])
    smooth, _, hessian = posterior.objective.normal_equations(X_PO)
    hessian, tiles = hessian + posterior.held, len(group)
    weight = np.exp(0.5 * (smooth[:tiles].min() - smooth[:tiles])) + params.least_tile_weight
    count = np.maximum(1, np.rint(params.samples * weight / weight.sum())).astype(np.intp)
    owner, tails = _tails(X_mode[likely], hessian[tiles:], posterior)
    each_tail = max(params.least_tail_samples, round(params.tail_samples / max(len(owner), 1)))
    group = np.concatenate([group, likely[owner]])
    order = group.argsort(kind="stable")
    group, X_PO = group[order], X_PO[np.concatenate([np.arange(tiles), tiles + owner])[order]]
    hessian = np.concatenate([hessian[:tiles], tails])[order]
    count = np.concatenate([count, np.full(len(owner), each_tail, dtype=np.intp)])[order]
    center, local, turns = in_chart(X_mode, group, X_PO, hessian, posterior.turn_directions(X_PO))
    return StudentTMixture(X_mode, group, center, local, turns, count, params.freedom, params.farthest)


def _tails(X_mode: FloatArray, held: FloatArray, posterior: Posterior) -> tuple[NDArray[np.intp], FloatArray]:
    """Densities for what a mode reaches if one of the contacts is false: of little mass, but far from its middle.

    Args:
        X_mode: modes, shape (n, 3, 4).
        held: their information, that which every tile has included, shape (n, 6, 6).
        posterior: what is sampled.

    Returns:
        Which mode each is about, shape (t,), and its information, shape (t, 6, 6); of many those that reach farthest.
    """
    if posterior.alternatives is None:
        return np.empty(0, dtype=np.intp), np.empty((0, 6, 6))
    most = posterior.params.sampling.tail_samples
    left = posterior.alternatives(X_mode, held)
    owner, left = np.repeat(np.arange(len(held)), left.shape[1]), left.reshape(-1, 6, 6)
    if len(left) > most:
        lost = np.linalg.slogdet(held)[1][owner] - np.linalg.slogdet(left)[1]
        far = np.sort(np.argsort(-lost, kind="stable")[:most])
        owner, left = owner[far], left[far]
    return owner, left


def _to_the_floor(X_PO: FloatArray, posterior: Posterior) -> FloatArray:
    """Moves poses (B, 3, 4) in the directions that the touch determines well, and little in others."""
    params, units = posterior.params.sampling, posterior.units
    soft, longest = 1.0 / (units * posterior.straight) ** 2, params.longest_step * posterior.size
    for _ in range(params.steps if len(X_PO) else 0):
        _, gradient, hessian = posterior.likelihood.normal_equations(X_PO)
        importance_sampling_kernels.step_down(gradient, hessian, soft, units, longest, X_PO)
    return X_PO


def _update(
    modes: Modes,
    sampled: NDArray[np.intp],
    masses: FloatArray,
    moments: Moments,
    families: Families,
    posterior: Posterior,
    log_mass: float,
) -> Modes:
    """The modes with these masses, and of those that the samples know their moments; of a family one."""
    params, X_PO, covariance = posterior.params, modes.mixture.X_PO.copy(), modes.mixture.covariance.copy()
    cost, mass = modes.cost.copy(), masses.copy()
    known = moments.effective_samples > 1.0
    index, moments = sampled[known], Moments(*(moment[known] for moment in moments))
    laplace = covariance[index]
    mass[index], moments, _ = families.chosen(known.nonzero()[0]).join(cost[index], mass[index], moments)
    left = mass[index] > 0.0
    index, laplace, moments = index[left], laplace[left], Moments(*(moment[left] for moment in moments))
    X_PO[index], cost[index], second = toward_the_mean(
        X_PO[index], cost[index], laplace, moments, posterior.objective, params.moments
    )
    covariance[index] = _spread(X_PO[index], moments._replace(second=second), laplace, posterior)
    # Bumps along a valley's floor may hide from the curvature that it is one.
    by_touch = inverses(covariance[index])[0] - posterior.prior_information
    free = list(modes.free_directions)
    by_both = free_directions(by_touch, posterior.size, [free[i] for i in index], params.modes)
    for i, directions in zip(index, by_both, strict=True):
        free[i] = directions
    order = (-mass).argsort(kind="stable")[: np.count_nonzero(mass)]
    named = tuple(free[i] for i in order)
    return Modes(GaussianMixture(X_PO[order], mass[order], covariance[order]), cost[order], named, log_mass)


def _spread(X_PO: FloatArray, moments: Moments, laplace: FloatArray, posterior: Posterior) -> FloatArray:
    """Covariances (n, 6, 6) of modes at poses (n, 3, 4) by their moments, and by Laplace's as far as those know little.

    That is what the next sample of an inverse Wishart distribution is expected to be, with Laplace's as prior.
    """
    spread = moments.second
    if len(posterior.turns[0]):
        directions = posterior.turn_directions(X_PO)
        spread = spread + posterior.turn_variance * directions @ np.swapaxes(directions, 1, 2)
    prior_share = posterior.params.moments.pseudo_samples / moments.effective_samples[:, None, None]
    return np.asarray(spread + prior_share * laplace)
