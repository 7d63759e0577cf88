"""The rank correlation (Spearman's rho) over final poses of an optimal estimator.

Near the true pose, a touch is represented by H, its information about the six increments. Its noise displaces the
minimum of the exact likelihood by b ~ N(0, H^-1), if H is regular, and a trial starts at a displacement s. Of all
estimators, the posterior mean has the least mean squared error: x = (H + P)^-1 (H b + P s), with the prior information
P of the trials' displacements. Its cost is (x - b)^T H (x - b) / 2.

With H = L L^T and standard normal numbers y in place of L^T b, neither needs an inverse of H; a direction that the
touch does not determine remains unchanged.
"""

from typing import NamedTuple

import numpy as np
from pad_corrections import errors_of, rank_correlations
from pad_grasps import OURS, SIGMA_SHIFT, SIGMA_TURN, Array, PadGrasp, displaced_poses

from tactopose_drake.core.poses import increments_between, retract


class IdealTrials(NamedTuple):
    """The ideal estimator on one grip, for several draws of the touch's noise.

    Attributes:
        error: means over the trials, mm and deg, shape (draws, 2).
        rho: rank correlation over the trials' final poses, for both, shape (draws, 2).
    """

    error: Array
    rho: Array


def ideal_trials(grasp: PadGrasp, trials: int, draws: int, generator: np.random.Generator) -> IdealTrials:
    """Corrects displaced poses as well as the grip's touch allows, with the touch's noise drawn anew."""
    H = grasp.objectives[OURS].normal_equations(grasp.X_PO[None]).hessian[0]
    eigenvalues, eigenvectors = np.linalg.eigh(H)
    L = eigenvectors * np.sqrt(eigenvalues.clip(0.0))
    P = np.diag(np.repeat([SIGMA_TURN**-2, SIGMA_SHIFT**-2], 3))
    true = np.repeat(grasp.X_PO[None], trials, axis=0)
    errors, rhos = np.empty((2, draws, 2))
    for i in range(draws):
        y = generator.normal(size=6)
        s = increments_between(true, displaced_poses(grasp.X_PO, trials, generator))
        x = np.linalg.solve(H + P, (L @ y)[:, None] + P @ s.T).T
        cost = 0.5 * np.sum((x @ L - y) ** 2, axis=1)
        error = errors_of(grasp, retract(true, x))
        errors[i], rhos[i] = error.mean(axis=0), rank_correlations(cost, error)
    return IdealTrials(errors, rhos)
