"""The mass and the spread of each mode, by importance sampling of the exact posterior.

Laplace's approximation takes each mode for a Gaussian by its curvature. Real modes have kinks where a contact passes an
edge, and bend where a direction is hardly determined: a Gaussian that fits at the middle leaves the valley. Therefore
each mode is covered by tiles, densities like Laplace's that lie along its floor; samples of their mixture are weighted
by the exact posterior over the mixture [OZ00]; and a mode's mass, its pose and the spread about it are its samples'.
Modes that turn out to overlap are joined.

Source: [OZ00] A. Owen and Y. Zhou, Safe and effective importance sampling, J. Am. Stat. Assoc. 95, 2000 (deterministic
mixture weights).
"""

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.kernels.matrix_kernels import inverses
from tactopose_drake.core.posterior import sampling_weight_kernels
from tactopose_drake.core.posterior.gaussian_mixture import GaussianMixture
from tactopose_drake.core.posterior.hypotheses import Modes, free_directions
from tactopose_drake.core.posterior.joined_modes import join_overlapping
from tactopose_drake.core.posterior.mode_moments import Moments, toward_the_mean, weigh_moments
from tactopose_drake.core.posterior.posterior import Posterior
from tactopose_drake.core.posterior.student_t_mixture import StudentTMixture, across_turns, draw, in_chart
from tactopose_drake.core.validation import FloatArray

# Logarithm of the volume of the turns about one continuous axis, or about the three of a ball.
_LOG_TURNS = {0: 0.0, 1: np.log(2.0 * np.pi), 3: np.log(8.0 * np.pi**2)}


def weigh_modes(modes: Modes, posterior: Posterior, generator: np.random.Generator) -> Modes:
    """The modes with the mass and covariance that samples of the exact posterior give them."""
    mixture, params = modes.mixture, posterior.params.sampling
    close = np.flatnonzero(mixture.weights > params.least_weighed_share * mixture.weights.max())
    X_close = mixture.X_PO[close]
    information = inverses(mixture.covariance[close])[0] + posterior.gauge
    least = np.minimum(posterior.exact_cost(X_close), modes.cost[close])
    laplace = -least - 0.5 * across_turns(information, posterior.turn_directions(X_close))[1]
    share = np.exp(laplace - laplace.max())
    share /= share.sum()
    worthy = np.flatnonzero(share > params.least_sampled_share)
    sampled = close[worthy]

    proposal = _cover(mixture.X_PO[sampled], share[worthy], information[worthy], posterior, generator)
    X_PO = proposal.sample(generator)
    densities = proposal.densities(X_PO)
    weights = np.empty_like(densities)
    cost = posterior.exact_cost(X_PO)
    lowest = min(float(least.min()), float(cost.min()))
    sampling_weight_kernels.weigh(cost, lowest, densities, weights)
    mass = weights.sum(axis=0)
    moments = weigh_moments(mixture.X_PO[sampled], X_PO, weights)
    if not (moments.effective_samples > 1.0).any():
        return modes  # One sample outweighs all others: they say less than Laplace's approximation.
    every = np.exp(laplace + lowest) * (2.0 * np.pi) ** (3.0 - 0.5 * len(posterior.turns[0]))
    every[worthy] = mass
    masses = mixture.weights * (every.sum() / mixture.weights[close].sum())
    masses[close] = every
    log_mass = float(np.log(masses.sum()) - lowest + _LOG_TURNS[len(posterior.turns[0])])
    return _update(modes, sampled, masses / masses.sum(), moments, posterior, log_mass)


def _cover(
    X_mode: FloatArray,
    share: FloatArray,
    information: FloatArray,
    posterior: Posterior,
    generator: np.random.Generator,
) -> StudentTMixture:
    """A mixture that covers the sampled modes: one density for a narrow one, tiles along a wide one."""
    params, units = posterior.params.sampling, posterior.units
    widest = 1.0 / (params.tile_reach * posterior.straight) ** 2
    # The root leaves something for modes that Laplace's approximation underrates.
    root_share = np.sqrt(share)
    counts = 1 + np.rint(params.tiles * root_share / root_share.sum()).astype(np.intp)
    each = np.arange(len(X_mode))
    group = np.repeat(each, counts)
    normal = generator.normal(scale=params.tile_scatter, size=(len(group), 6))
    normal[np.cumsum(counts) - counts] = 0.0  # The first at each mode stands in its middle.
    laplace = draw(X_mode, each, np.zeros((len(X_mode), 6)), information, counts, normal)
    X_PO = _to_the_floor(laplace, posterior)
    equations = posterior.objective.normal_equations(X_PO)
    # As wide as that and the tile's own reach allow.
    local = equations.hessian + np.diag(widest / units**2) + posterior.gauge
    center, local, turns = in_chart(X_mode, group, X_PO, local, posterior.turn_directions(X_PO))
    least = np.minimum(posterior.exact_cost(X_PO), equations.cost)
    weight = np.exp(-0.5 * (least - least.min())) + params.least_tile_weight
    count = np.maximum(1, np.rint(params.samples * weight / weight.sum())).astype(np.intp)
    return StudentTMixture(X_mode, group, center, local, turns, count, params.freedom, params.farthest)


def _to_the_floor(X_PO: FloatArray, posterior: Posterior) -> FloatArray:
    """Moves poses (B, 3, 4) in the directions that the touch determines well, and little in others."""
    params, units = posterior.params.sampling, posterior.units
    soft, longest = 1.0 / (units * posterior.straight) ** 2, params.longest_step * posterior.size
    for _ in range(params.steps):
        _, gradient, hessian = posterior.likelihood.normal_equations(X_PO)
        sampling_weight_kernels.step_down(gradient, hessian, soft, units, longest, X_PO)
    return X_PO


def _update(
    modes: Modes,
    sampled: NDArray[np.intp],
    masses: FloatArray,
    moments: Moments,
    posterior: Posterior,
    log_mass: float,
) -> Modes:
    """The modes with these masses, and of those that the samples know their moments; what overlaps is one."""
    params, X_PO, covariance = posterior.params, modes.mixture.X_PO.copy(), modes.mixture.covariance.copy()
    cost, mass = modes.cost.copy(), masses.copy()
    known = moments.effective_samples > 1.0
    index, moments = sampled[known], Moments(*(moment[known] for moment in moments))
    laplace = covariance[index]
    mass[index], moments = join_overlapping(
        X_PO[index],
        cost[index],
        mass[index],
        _spread(X_PO[index], moments, laplace, posterior),
        moments,
        posterior.symmetry_poses,
        params.moments,
    )
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
    order = np.argsort(-mass, kind="stable")[: np.count_nonzero(mass)]
    named = tuple(free[i] for i in order)
    return Modes(GaussianMixture(X_PO[order], mass[order], covariance[order]), cost[order], named, log_mass)


def _spread(X_PO: FloatArray, moments: Moments, laplace: FloatArray, posterior: Posterior) -> FloatArray:
    """Covariances (n, 6, 6) of modes at poses (n, 3, 4) by their moments, and by Laplace's as far as those know little.

    That is what the next sample of an inverse Wishart distribution is expected to be, with Laplace's as prior.
    """
    directions = posterior.turn_directions(X_PO)
    turns = posterior.turn_variance * directions @ np.swapaxes(directions, 1, 2)
    prior_share = posterior.params.moments.pseudo_samples / moments.effective_samples[:, None, None]
    spread: FloatArray = moments.second + turns + prior_share * laplace
    return spread
