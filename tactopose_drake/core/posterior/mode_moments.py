"""Effective sample size, mean and covariance of each mode from weighted samples.

A mode's pose is the mean of its samples, which has the least mean square error; a skew mode's minimum lies at one of
its ends. But the mean of a bent mode lies off the valley, so the pose moves toward the mean only as far as it still
explains the touch.

Source: [JS61] W. James and C. Stein, Estimation with quadratic loss, 4th Berkeley Symp. Math. Stat. Prob., 1961.
"""

from typing import NamedTuple

import numpy as np

from tactopose_drake.core.objectives.objective import Objective
from tactopose_drake.core.posterior import importance_sampling_kernels
from tactopose_drake.core.posterior.posterior import Posterior
from tactopose_drake.core.posterior.posterior_params import DEFAULT_PARAMS, MomentParams
from tactopose_drake.core.validation import FloatArray


class Moments(NamedTuple):
    """Moments of weighted samples, for each of g groups.

    Attributes:
        effective_samples: their effective sample size, shape (g,).
        first: mean of the increments from the group's pose, shape (g, 6).
        second: mean product of those increments, shape (g, 6, 6).
    """

    effective_samples: FloatArray
    first: FloatArray
    second: FloatArray


def weigh_moments(increments: FloatArray, weights: FloatArray) -> Moments:
    """Moments of samples from their increments (B, g, 6) from the groups' poses and their weights (B, g)."""
    g = weights.shape[1]
    moments = Moments(np.empty(g), np.zeros((g, 6)), np.zeros((g, 6, 6)))
    importance_sampling_kernels.add_moments(increments, weights, *moments)
    return moments


def toward_the_mean(
    X_PO: FloatArray,
    cost: FloatArray,
    laplace: FloatArray,
    moments: Moments,
    objective: Objective,
    params: MomentParams = DEFAULT_PARAMS.moments,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Moves minima (g, 3, 4) with costs (g,) toward their modes' means as far as the touch allows.

    The part of a mean that may be sampling noise is shrunk away [JS61]: a mode that agrees with Laplace's covariance
    (g, 6, 6) keeps its minimum.

    Returns:
        The poses, their costs, and the second moments (g, 6, 6) of the increments from them.
    """
    g, mean, way = len(X_PO), moments.first, np.array(params.tried_shares)
    tried = importance_sampling_kernels.Tried(np.empty((g, len(way))), np.empty((g, len(way), 3, 4)))
    importance_sampling_kernels.try_shares(X_PO, laplace, mean, moments.effective_samples, way, params.chance, tried)
    costs = objective.cost(tried.X.reshape(-1, 3, 4)).reshape(g, len(way))
    costs[:, -1] = cost
    chosen = np.arange(g), (costs <= cost[:, None] + params.as_good).argmax(axis=1)
    share = tried.shares[chosen]
    left = (share * (2.0 - share))[:, None, None] * mean[:, :, None] * mean[:, None]
    return tried.X[chosen], costs[chosen], moments.second - left


def spread(X_PO: FloatArray, moments: Moments, laplace: FloatArray, posterior: Posterior) -> FloatArray:
    """Covariances (n, 6, 6) of modes at poses (n, 3, 4): their second moments, plus a share of Laplace's covariance.

    This is the predictive covariance under an inverse Wishart prior that is centred on Laplace's covariance.
    """
    second = moments.second
    if len(posterior.turns[0]):
        directions = posterior.turn_directions(X_PO)
        second = second + posterior.turn_variance * directions @ np.swapaxes(directions, 1, 2)
    prior_share = posterior.params.moments.pseudo_samples / moments.effective_samples[:, None, None]
    return np.asarray(second + prior_share * laplace)
