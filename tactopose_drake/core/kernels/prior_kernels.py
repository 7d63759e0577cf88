"""Whitened increments from a prior's pose, compiled: costs, residuals and their derivatives, one loop over poses.

Poses are (B, 3, 4); increments (w, v) as in `poses.py`.
"""

from typing import NamedTuple

import numpy as np

from tactopose_drake.core.compilation import inlined, kernel, part
from tactopose_drake.core.kernel_types import Floats1, Floats2, Floats3, OutFloats1, OutFloats2, OutFloats3
from tactopose_drake.core.kernels.pose_kernels import increment_between


class Prior(NamedTuple):
    """A pose (3, 4) and the inverse standard deviations (6,) of increments from it, zero for no prior; read-only."""

    X: Floats2
    weights: Floats1


@kernel
def prior_costs(prior: Prior, X: Floats3, cost: OutFloats1) -> None:
    """Writes half the squared whitened increment from the prior's pose (3, 4) to each pose into cost (B,)."""
    u = np.empty(6)
    for b in range(X.shape[0]):
        cost[b] = prior_cost(prior, X[b], u)


@part
def prior_cost(prior: Prior, X: Floats2, u: OutFloats1) -> float:
    """The cost of one pose (3, 4), 0 if there is no prior; u (6,) is scratch."""
    if prior.weights[0] == 0.0:
        return 0.0
    increment_between(prior.X, X, u)
    total = 0.0
    for i in range(6):
        total += (u[i] * prior.weights[i]) ** 2
    return 0.5 * total


@kernel
def prior_residuals(prior: Prior, X: Floats3, residuals: OutFloats2, jacobian: OutFloats3) -> None:
    """Whitened increments (B, 6) from the prior's pose, and their Jacobian (B, 6, 6) with respect to the increment.

    The derivative of the rotation vector is the inverse right Jacobian of SO(3): J. Sola et al., A micro Lie theory for
    state estimation, 2018, eq. 144.
    """
    u = np.empty(6)
    for b in range(X.shape[0]):
        prior_row(prior, X[b], u, residuals[b], jacobian[b])


@kernel
def compare(X_prior: Floats2, X: Floats2, increment: OutFloats1, jacobian: OutFloats2) -> None:
    """The increment (6,) from one pose (3, 4) to another, and its derivative (6, 6) by an increment of the latter."""
    _compare(X_prior, X, increment, jacobian)


@inlined
def prior_row(prior, X, u, residual, J):
    """The residual (6,) and Jacobian (6, 6) of one pose (3, 4), as of `prior_residuals`; u (6,) is scratch."""
    _compare(prior.X, X, u, J)
    for i in range(6):
        residual[i] = u[i] * prior.weights[i]
        for j in range(6):
            J[i, j] *= prior.weights[i]


@inlined
def half_square(difference):
    """The cost of a whitened increment (6,): half its squared length."""
    cost = 0.0
    for a in range(6):
        cost += 0.5 * difference[a] * difference[a]
    return cost


@inlined
def add_prior(prior, difference, D, gradient, hessian):
    """Adds the prior of one pose, as of `prior_row`, to its gradient (6,) and Hessian (6, 6)."""
    for a in range(6):
        for c in range(6):
            gradient[a] += D[c, a] * difference[c]
    for a in range(3):
        hessian[3 + a, 3 + a] += prior.weights[3 + a] ** 2
        for c in range(3):
            hessian[a, c] += D[0, a] * D[0, c] + D[1, a] * D[1, c] + D[2, a] * D[2, c]


@inlined
def _compare(X_prior, X, u, J):
    increment_between(X_prior, X, u)
    x, y, z = u[0], u[1], u[2]
    angle2 = x * x + y * y + z * z
    if angle2 < 1e-6:
        c = 1.0 / 12.0 + angle2 / 720.0
    else:
        angle = np.sqrt(angle2)
        c = 1.0 / angle2 - np.cos(0.5 * angle) / (2.0 * angle * np.sin(0.5 * angle))
    J[:, :] = 0.0
    J[0, 0], J[0, 1], J[0, 2] = 1.0 - c * (y * y + z * z), c * x * y - 0.5 * z, c * x * z + 0.5 * y
    J[1, 0], J[1, 1], J[1, 2] = c * x * y + 0.5 * z, 1.0 - c * (x * x + z * z), c * y * z - 0.5 * x
    J[2, 0], J[2, 1], J[2, 2] = c * x * z - 0.5 * y, c * y * z + 0.5 * x, 1.0 - c * (x * x + y * y)
    for i in range(3, 6):
        J[i, i] = 1.0
