"""The block solution against the whole problem, on contacts that an unknown shift moves in every grasp."""

import numpy as np
import pytest

from tactopose_drake.core.calibration.shared_least_squares import linearize, solve_shared
from tactopose_drake.core.poses import retract
from tactopose_drake.core.shape.object_model import ObjectModel
from tests.core.calibration.shifted_contacts import CONTACTS, GRASPS, SHIFT, SIGMA, Shifted


def test_data_without_noise_gives_the_truth(blob: ObjectModel) -> None:
    shifted = Shifted(blob, SHIFT)
    start = retract(shifted.X_PO, 0.02 * np.random.default_rng(1).normal(size=(GRASPS, 6)) * np.repeat([5, 0.2], 3))
    solution = solve_shared(shifted.problem, np.zeros(3), start, shifted.noise(0.003, 0.2))
    for share in 0.5 ** np.arange(1, 9):
        noise = shifted.noise(0.003 * share, 0.2 * share)
        solution = solve_shared(shifted.problem, solution.shared, solution.X_PO, noise)
    assert solution.converged
    np.testing.assert_allclose(SIGMA * solution.shared, SHIFT, atol=1e-5)
    np.testing.assert_allclose(solution.X_PO[:, :, 3], shifted.X_PO[:, :, 3], atol=2e-5)


def test_the_covariance_is_that_of_the_whole_normal_equations(blob: ObjectModel) -> None:
    shifted = Shifted(blob, SHIFT, noise=0.0003)
    noise = shifted.noise(0.0003, 0.03)
    solution = solve_shared(shifted.problem, np.zeros(3), shifted.X_PO, noise)
    rows, weights = solution.at.rows, solution.at.weights
    whole = np.zeros((len(shifted.p), 4, 3 + 6 * GRASPS))
    whole[:, :, :3] = rows.by_shared
    for i, g in enumerate(shifted.grasp):
        whole[i, :, 3 + 6 * g : 9 + 6 * g] = rows.by_pose[i]
    flat = whole.reshape(-1, whole.shape[2])
    information = (flat * np.repeat(weights, 4)[:, None]).T @ flat
    information += np.diag(np.concatenate([np.ones(3), np.tile(np.repeat([1 / np.pi**2, 100.0], 3), GRASPS)]))
    covariance = np.linalg.inv(information)
    np.testing.assert_allclose(solution.covariance, covariance[:3, :3], rtol=1e-6)
    leverage = weights[:, None] * np.einsum("nrd,de,nre->nr", whole, covariance, whole)
    np.testing.assert_allclose(solution.leverage, leverage, rtol=1e-6, atol=1e-12)


def test_a_grasp_in_a_wrong_pose_counts_for_nothing(blob: ObjectModel) -> None:
    shifted = Shifted(blob, SHIFT, noise=0.0003)
    shifted.p[shifted.grasp == 3] += 0.02 * np.random.default_rng(3).normal(size=(CONTACTS, 3))
    solution = solve_shared(shifted.problem, np.zeros(3), shifted.X_PO, shifted.noise(0.0005, 0.05))
    assert solution.at.grasp_weights[3] < 0.01
    assert np.delete(solution.at.grasp_weights, 3).min() > 0.99
    np.testing.assert_allclose(SIGMA * solution.shared, SHIFT, atol=0.001)


def test_a_direct_reading_is_taken(blob: ObjectModel) -> None:
    shifted = Shifted(blob, SHIFT, noise=0.0003)
    rows = np.array([[1e4, 0.0, 0.0]])
    problem = shifted.problem._replace(readings=rows, measured=rows @ (SHIFT / SIGMA))
    solution = solve_shared(problem, np.zeros(3), shifted.X_PO, shifted.noise(0.0005, 0.05))
    assert solution.shared[0] == pytest.approx(SHIFT[0] / SIGMA, abs=1e-3)
    assert solution.covariance[0, 0] < 1e-7


def test_the_weights_are_those_by_which_the_cost_changes(blob: ObjectModel) -> None:
    """By differences, where some contacts, and a grasp as a whole, count for a part."""
    shifted = Shifted(blob, SHIFT, noise=0.0003)
    shifted.p[[1, 8]] += 0.004 * shifted.n[[1, 8]]
    shifted.p[shifted.grasp == 3] += 0.0019 * shifted.n[shifted.grasp == 3]
    noise, unit, step = shifted.noise(0.0007, 0.07), SHIFT / SIGMA, 1e-5
    at = linearize(shifted.problem, unit, shifted.X_PO, noise)
    assert np.any((at.grasp_weights > 0.1) & (at.grasp_weights < 0.9))
    gradient = unit + np.einsum("n,nr,nrd->d", at.weights, at.rows.residual, at.rows.by_shared)
    costs = [
        [linearize(shifted.problem, unit + s * e, shifted.X_PO, noise).cost for s in (step, -step)] for e in np.eye(3)
    ]
    np.testing.assert_allclose(gradient, -np.diff(costs, axis=1)[:, 0] / (2.0 * step), rtol=0.02, atol=0.02)
