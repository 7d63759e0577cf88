"""The mass and the spread of each mode, by importance sampling of the exact posterior.

Laplace's approximation takes each mode for a Gaussian by its curvature. Real modes have kinks where a contact passes an
edge, and bend where a direction is hardly determined: a Gaussian that fits at the middle leaves the valley. Therefore
each mode is covered by tiles, densities like Laplace's that lie along its floor; samples of their mixture are weighted
by the exact posterior over the mixture [OZ00]; and a mode's mass, its pose and the spread about it are its samples'.
Modes between which the density hardly falls are joined. A sample far out, where hardly any is drawn, would outweigh
thousands: none weighs more than so many times the mean [I08].

Source: [OZ00] A. Owen and Y. Zhou, Safe and effective importance sampling, J. Am. Stat. Assoc. 95, 2000 (deterministic
mixture weights). [CDG08] O. Cappe et al., Adaptive importance sampling in general mixture classes, Stat. Comput. 18,
2008. [CMMR12] J.-M. Cornuet et al., Adaptive multiple importance sampling, Scand. J. Stat. 39, 2012. [I08] E. Ionides,
Truncated importance sampling, J. Comput. Graph. Stat. 17, 2008.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.kernels.matrix_kernels import inverses
from tactopose_drake.core.plain_values import copied
from tactopose_drake.core.posterior.doubted_spread import widen_by_doubt
from tactopose_drake.core.posterior.gaussian_mixture import GaussianMixture
from tactopose_drake.core.posterior.hypotheses import Modes, free_directions
from tactopose_drake.core.posterior.importance_sampling_kernels import Draws, Weighed, find_nearest_images, weigh
from tactopose_drake.core.posterior.joined_modes import Families
from tactopose_drake.core.posterior.mode_cover import Cover, cover_modes, join_by_samples, tile_samples
from tactopose_drake.core.posterior.mode_moments import Moments, toward_the_mean, weigh_moments
from tactopose_drake.core.posterior.posterior import Posterior
from tactopose_drake.core.posterior.student_t_mixture import Increments, StudentTMixture
from tactopose_drake.core.validation import FloatArray

# Logarithm of the volume of the turns about one continuous axis, or about the three of a ball.
_LOG_TURNS = {0: 0.0, 1: np.log(2.0 * np.pi), 3: np.log(8.0 * np.pi**2)}


def weigh_modes(modes: Modes, posterior: Posterior, generator: np.random.Generator) -> Modes:
    """The modes with the mass and covariance that samples of the exact posterior give them.

    Each is no narrower than the doubt of single contacts makes it, which few of the samples show.
    """
    cover = cover_modes(modes, posterior, generator)
    return widen_by_doubt(modes if cover is None else weigh_covered(modes, cover, posterior, generator), posterior)


def weigh_covered(modes: Modes, cover: Cover, posterior: Posterior, generator: np.random.Generator) -> Modes:
    """Draws samples of what covers the modes, and weighs the modes by them."""
    close, worthy = cover.close, cover.worthy
    increments, weights, weighed, families = _draw(cover, posterior, generator)
    moments = weigh_moments(increments, weights)
    if not (moments.effective_samples > 1.0).any():
        return modes  # One sample outweighs all others: they say less than Laplace's approximation.
    every = np.exp(cover.laplace + weighed.lowest) * (2.0 * np.pi) ** (3.0 - 0.5 * len(posterior.turns[0]))
    every[worthy] = weights.sum(axis=0)
    masses = modes.mixture.weights * (every.sum() / modes.mixture.weights[close].sum())
    masses[close] = every
    whole = masses.sum() + weighed.mass - weights.sum()  # What is no part of any mode is part of that.
    log_mass = float(np.log(whole) - weighed.lowest + _LOG_TURNS[len(posterior.turns[0])])
    found = _update(modes, close[worthy], masses / masses.sum(), moments, families, posterior, log_mass)
    return copied(found, standard_error=weighed.error)


class _Samples(NamedTuple):
    """Samples' increments (B, g, 6) from the modes, their weights (B, g) in the modes' shares, what they say together.

    The weights are over the density exp(lowest - cost). `families` are those that the modes make.
    """

    increments: FloatArray
    weights: FloatArray
    weighed: Weighed
    families: Families


def _draw(cover: Cover, posterior: Posterior, generator: np.random.Generator) -> _Samples:
    """Samples, so many that the modes' probabilities are sure enough, or as many as are drawn at the most.

    Where those of one round are not enough, the next are drawn about them as their weights say [CDG08]; all are weighed
    by all proposals together [CMMR12].
    """
    params, proposal, families = posterior.params.sampling, cover.proposal, cover.families
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
        draws = Draws(cost[all_drawn], density[all_drawn], np.concatenate([each.count for each in proposals]))
        limits = params.depth, params.truncation
        weighed = weigh(draws, cover.low, families.family, cover.lowest, *limits, weights[all_drawn])
        if len(proposals) == 1 and weighed.error > params.standard_error:
            # Maybe minima between the modes have been missed.
            families = join_by_samples(X_PO[all_drawn], weights[all_drawn], cover, posterior)
            weighed = weigh(draws, cover.low, families.family, cover.lowest, *limits, weights[all_drawn])
        sure = weighed.error <= params.standard_error and weighed.worth >= params.effective_samples
        count = max(params.round_of(cover.tiles), int(params.growth * drawn))
        if sure or weighed.worth == 0.0 or drawn + count > params.most_samples:
            return _Samples(increments.u[all_drawn], weights[all_drawn], weighed, families)
        proposal = tile_samples(X_PO[all_drawn], weights[all_drawn], cover, count, posterior)


def _cost_of_one_image(X_PO: FloatArray, X_mode: FloatArray, posterior: Posterior) -> FloatArray:
    """The exact cost of samples (B, 3, 4); infinite where an image by a symmetry is nearer to a mode than the sample.

    Of all images of a pose one counts, or modes that are wide enough to reach their own images would count manyfold.
    """
    if len(posterior.symmetry_poses) == 1:
        return posterior.exact_cost(X_PO)
    nearest = np.empty(len(X_PO), dtype=np.intp)
    find_nearest_images(X_PO, X_mode, posterior.symmetry_poses, 0.5 * posterior.size, nearest)
    cost, own = np.full(len(X_PO), np.inf), nearest == 0
    cost[own] = posterior.exact_cost(X_PO[own])
    return cost


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
