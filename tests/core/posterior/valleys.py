"""Posteriors with one valley, straight or bent, and the modes that a search would find in it."""

import numpy as np

from tactopose_drake.core.objectives.objective import LeastSquaresObjective
from tactopose_drake.core.poses import exp_so3, increments_between, make_poses, retract
from tactopose_drake.core.posterior.gaussian_mixture import GaussianMixture
from tactopose_drake.core.posterior.mode_moments_kernels import Joined, WeightedSamples, add_moments
from tactopose_drake.core.posterior.modes import Modes
from tactopose_drake.core.posterior.posterior import Posterior
from tactopose_drake.core.posterior.posterior_params import PosteriorParams, SamplingParams
from tactopose_drake.core.validation import FloatArray

SIGMAS = np.array([0.03, 0.02, 0.05, 0.001, 0.002, 0.0015])
NO_TURNS = (np.empty((0, 3)), np.empty((0, 3)))


class Valley(LeastSquaresObjective):
    """Independent Gaussians of the increments from a pose, one of which may bend: a turn moves the object along too."""

    def __init__(self, X_PO: FloatArray, sigmas: FloatArray, bend: float = 0.0) -> None:
        self.X_PO, self.sigmas, self.bend = X_PO, sigmas, bend

    def residuals(self, X_PO: FloatArray) -> FloatArray:
        u = increments_between(self.X_PO, X_PO)
        u[:, 3] -= self.bend * (1.0 - np.cos(u[:, 2]))
        u[:, 4] -= self.bend * np.sin(u[:, 2])
        return u / self.sigmas

    def residuals_and_jacobian(self, X_PO: FloatArray) -> tuple[FloatArray, FloatArray]:
        here = self.residuals(X_PO)
        steps = 1e-6 * np.eye(6)
        columns = [(self.residuals(retract(X_PO, step)) - here) / 1e-6 for step in steps]
        return here, np.stack(columns, axis=-1)


def posterior(
    valley: Valley,
    exact: object = None,
    turns: tuple[FloatArray, FloatArray] = NO_TURNS,
    samples: int = 128,
    tiles: int = 16,
) -> Posterior:
    cost = valley.cost if exact is None else exact
    params = PosteriorParams(sampling=SamplingParams(samples=samples, fewest_tiles=tiles, most_tiles=tiles))
    return Posterior(valley, valley, cost, None, *turns, np.eye(6) / 1.7, np.eye(3, 4)[None], 0.15, 0.001, params)  # type: ignore[arg-type]


def modes(valley: Valley, X_PO: FloatArray) -> Modes:
    count = len(X_PO)
    covariance = np.linalg.inv(valley.normal_equations(X_PO).hessian + 1e-9 * np.eye(6))
    mixture = GaussianMixture(X_PO, np.full(count, 1 / count), covariance)
    return Modes(mixture, valley.cost(X_PO), (np.empty((0, 6)),) * count, 0.0)


def pose() -> FloatArray:
    return make_poses(exp_so3(np.array([0.4, -1.0, 2.0])), np.array([0.1, 0.0, -0.2]))


def moments_of(X_mode: FloatArray, X_PO: FloatArray, weights: FloatArray) -> Joined:
    """Moments of samples (B, 3, 4) by their increments from modes (g, 3, 4) and their weights (B, g)."""
    g = weights.shape[1]
    moments = Joined(weights.sum(axis=0), np.empty(g), np.zeros((g, 6)), np.zeros((g, 6, 6)))
    add_moments(WeightedSamples(X_mode, X_PO, weights), *moments[1:])
    return moments
