"""Pose and covariance of each mode from weighted samples.

A mode's pose is the mean of its samples, which has the least mean square error; a skew mode's minimum lies at one of
its ends. But the mean of a bent mode lies off the valley, so the pose moves toward the mean only as far as it still
explains the touch.

Source: [JS61] W. James and C. Stein, Estimation with quadratic loss, 4th Berkeley Symp. Math. Stat. Prob., 1961.
"""

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.kernels.matrix_kernels import inverses
from tactopose_drake.core.plain_values import copied
from tactopose_drake.core.posterior.gaussian_mixture import GaussianMixture
from tactopose_drake.core.posterior.joined_modes import Families
from tactopose_drake.core.posterior.mode_moments_kernels import (
    Joined,
    Minima,
    Tried,
    WeightedSamples,
    try_means,
)
from tactopose_drake.core.posterior.modes import Modes, free_directions
from tactopose_drake.core.posterior.posterior import Posterior
from tactopose_drake.core.validation import FloatArray


def with_moments(
    modes: Modes,
    sampled: NDArray[np.intp],
    masses: FloatArray,
    samples: WeightedSamples,
    families: Families,
    posterior: Posterior,
) -> Modes | None:
    """Moves modes toward the means of their samples as far as the touch allows, with the covariances about the poses.

    The part of a mean that may be sampling noise is shrunk away [JS61]: a mode that agrees with Laplace's covariance
    keeps its minimum. The covariance is the samples' second moment, plus a share of Laplace's.

    Args:
        modes: by Laplace's approximation, n of them.
        sampled: the indices of those that were sampled, shape (g,).
        masses: of all modes, shape (n,); those of a family become one.
        samples: the samples of those that were.
        families: which of these are one.
        posterior: what was sampled.

    Returns:
        The modes in descending order of mass; None if of no mode more than one sample counts.
    """
    mixture, params, g = modes.mixture, posterior.params.moments, len(sampled)
    shares, laplace, cost = np.array(params.tried_shares), mixture.covariance[sampled], modes.cost[sampled]
    joined = Joined(masses[sampled], np.empty(g), np.zeros((g, 6)), np.zeros((g, 6, 6)))
    shape = g, len(shares)
    tried = Tried(np.empty(g, dtype=np.int64), np.empty((*shape, 3, 4)), np.empty((*shape, 6, 6)))
    minima = Minima(*families, cost.argsort(kind="stable"), laplace)
    n = try_means(minima, samples, shares, params.noise_limit, joined, tried)
    if not n:
        return None
    mode = tried.mode[:n]
    index, cost = sampled[mode], cost[mode]
    costs = posterior.objective.cost(tried.X[:n].reshape(-1, 3, 4)).reshape(n, -1)
    costs[:, -1] = cost
    chosen = np.arange(n), (costs <= cost[:, None] + params.as_good).argmax(axis=1)
    X_moved = tried.X[chosen]
    known = spread(X_moved, tried.second[chosen], laplace[mode], joined.effective_samples[mode], posterior)
    X_PO, covariance, every_cost, mass = (
        array.copy() for array in (mixture.X_PO, mixture.covariance, modes.cost, masses)
    )
    X_PO[index], covariance[index], every_cost[index], mass[sampled] = X_moved, known, costs[chosen], joined.mass
    # Bumps along a valley's floor can hide a free direction from the curvature, but not from the samples.
    by_touch, free = inverses(known)[0] - posterior.prior_information, list(modes.free_directions)
    by_both = free_directions(by_touch, posterior.size, [free[i] for i in index], posterior.params.modes)
    for i, directions in zip(index, by_both, strict=True):
        free[i] = directions
    order = (-mass).argsort(kind="stable")[: np.count_nonzero(mass)]
    mixture = GaussianMixture(X_PO[order], mass[order], covariance[order])
    return copied(modes, mixture=mixture, cost=every_cost[order], free_directions=tuple(free[i] for i in order))


def spread(
    X_PO: FloatArray, second: FloatArray, laplace: FloatArray, effective_samples: FloatArray, posterior: Posterior
) -> FloatArray:
    """Covariances (n, 6, 6) of modes at poses (n, 3, 4): their second moments, plus a share of Laplace's covariance.

    This is the predictive covariance under an inverse Wishart prior that is centred on Laplace's covariance.
    """
    if len(posterior.turn_axes):
        directions = posterior.turn_directions(X_PO)
        second = second + posterior.turn_variance * directions @ np.swapaxes(directions, 1, 2)
    prior_share = posterior.params.moments.pseudo_samples / effective_samples[:, None, None]
    return np.asarray(second + prior_share * laplace)
