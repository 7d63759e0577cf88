"""Poses that explain one grasp, by what all other grasps say of a shift that moves some of its contacts."""

import numpy as np
import pytest

from tactopose_drake.core.calibration.grasp_candidates import GraspTouches, explain, mixture
from tactopose_drake.core.calibration.mixture_loss import grasp_limit
from tactopose_drake.core.calibration.shared_least_squares import (
    POSE_INFORMATION,
    Knowledge,
    SharedProblem,
    others,
    solve_shared,
)
from tactopose_drake.core.calibration.surface_residuals import surface_rows
from tactopose_drake.core.poses import retract
from tactopose_drake.core.shape.object_model import ObjectModel
from tests.core.calibration.shifted_contacts import CONTACTS, SHIFT, SIGMA, Shifted

GRASP = 2


def known_by_others(shifted: Shifted) -> Knowledge:
    solution = solve_shared(shifted.problem, np.zeros(3), shifted.X_PO, shifted.noise(0.0003, 0.03))
    return others(shifted.problem, solution)[GRASP]


def felt(shifted: Shifted, known: Knowledge, problem: SharedProblem | None = None) -> GraspTouches:
    touches = (problem or shifted.problem).touch(known.mean)
    return GraspTouches.of(touches, shifted.noise(0.0003, 0.03), shifted.problem.grids, GRASP)


def test_what_others_say_is_the_fit_without_the_grasp(blob: ObjectModel) -> None:
    shifted = Shifted(blob, SHIFT, noise=0.0003)
    noise = shifted.noise(0.0003, 0.03)
    solution = solve_shared(shifted.problem, np.zeros(3), shifted.X_PO, noise)
    said = others(shifted.problem, solution)[GRASP]
    # Without this grasp's contacts.
    rest = shifted.problem._replace(touch=lambda unit: _without(shifted, unit))
    alone = solve_shared(rest, np.zeros(3), shifted.X_PO, noise)
    np.testing.assert_allclose(said.mean, alone.shared, atol=0.1 * np.sqrt(np.diag(alone.covariance)).min())
    np.testing.assert_allclose(said.covariance, alone.covariance, atol=0.1 * np.abs(alone.covariance).max())
    assert np.all(np.diag(said.covariance) > np.diag(solution.covariance))


def _without(shifted: Shifted, unit: np.ndarray):
    touches = shifted.touch(unit)
    return touches._replace(valid=touches.grasp != GRASP)


def test_the_true_pose_is_found_and_certain(blob: ObjectModel) -> None:
    shifted = Shifted(blob, SHIFT, noise=0.0003)
    known = known_by_others(shifted)
    generator = np.random.default_rng(0)
    near = retract(shifted.X_PO[[GRASP] * 6], generator.normal(size=(6, 6)) * np.repeat([0.1, 0.003], 3))
    far = retract(shifted.X_PO[[GRASP] * 6], generator.normal(size=(6, 6)) * np.repeat([1.0, 0.01], 3))
    candidates = explain(felt(shifted, known), np.concatenate([far, near]), known)
    assert candidates.probability[0] > 0.99
    assert candidates.probability.sum() <= 1.0 + 1e-9
    np.testing.assert_allclose(candidates.X_PO[0, :, 3], shifted.X_PO[GRASP, :, 3], atol=0.001)
    # Poses that came to the same place are one.
    assert len(candidates.X_PO) < 12
    # It says of the hand what the fit of all says.
    both = solve_shared(shifted.problem, np.zeros(3), shifted.X_PO, shifted.noise(0.0003, 0.03))
    np.testing.assert_allclose(SIGMA * candidates.shared[0], SIGMA * both.shared, atol=0.0001)


def test_the_pose_that_was_taken_is_known_among_the_candidates(blob: ObjectModel) -> None:
    shifted = Shifted(blob, SHIFT, noise=0.0003)
    known = known_by_others(shifted)
    turned = retract(shifted.X_PO[[GRASP]], np.array([[0.0, 3.0, 0.0, 0.0, 0.0, 0.0]]))
    taken = explain(felt(shifted, known), np.concatenate([turned, shifted.X_PO[[GRASP]]]), known)
    assert taken.taken > 0
    assert explain(felt(shifted, known), np.concatenate([shifted.X_PO[[GRASP]], turned]), known).taken == 0


def test_a_grasp_that_nothing_explains_has_no_pose(blob: ObjectModel) -> None:
    shifted = Shifted(blob, SHIFT, noise=0.0003)
    known = known_by_others(shifted)
    shifted.p[shifted.grasp == GRASP] += 0.02 * np.random.default_rng(3).normal(
        size=((shifted.grasp == GRASP).sum(), 3)
    )
    candidates = explain(felt(shifted, known), shifted.X_PO[[GRASP]], known)
    assert candidates.probability.sum() < 0.01


def test_a_grasp_whose_residuals_are_at_the_limit_is_as_likely_explained_as_not(blob: ObjectModel) -> None:
    """The odds that a pose is right fall with its residuals' sum of squares, and are even at the limit."""
    shifted, known = Shifted(blob, np.zeros(3), noise=0.0003), Knowledge(np.zeros(3), 1e-12 * np.eye(3))
    squares = []
    for sigma in (0.00004, 0.00005, 0.00006):
        touches = shifted.touch(known.mean)
        one = GraspTouches.of(touches, shifted.noise(sigma, 100.0 * sigma), shifted.problem.grids, GRASP)
        found = explain(one, shifted.X_PO[[GRASP]], known)
        alone = one.touches._replace(grasp=np.zeros(CONTACTS, dtype=np.int64))
        squares.append(np.sum(surface_rows([one.grid], found.X_PO, alone, one.noise).residual ** 2))
        odds = 0.5 * (grasp_limit(np.array([CONTACTS]))[0] - squares[-1])
        assert np.log(found.probability[0] / (1.0 - found.probability[0])) == pytest.approx(odds, abs=0.01)
    assert squares[0] > grasp_limit(np.array([CONTACTS]))[0] > squares[1]


@pytest.mark.parametrize("variance", [1e-12, 2.0, 20.0])
def test_poses_are_as_probable_as_the_touch_is_about_them(blob: ObjectModel, variance: float) -> None:
    """By Laplace: of poses that explain a grasp alike, the one that it determines less is the more probable."""
    shifted, known = Shifted(blob, np.zeros(3)), Knowledge(np.zeros(3), variance * np.eye(3))
    one = GraspTouches.of(shifted.touch(known.mean), shifted.noise(0.002, 0.6), shifted.problem.grids, GRASP)
    turns = np.random.default_rng(0).normal(size=(12, 6)) * np.repeat([1.5, 0.01], 3)
    found = explain(one, retract(shifted.X_PO[[GRASP] * 12], turns), known)
    assert np.count_nonzero(found.probability > 0.01) > 4
    log_density, log_volume, log_spread = [], [], []
    for X_PO in found.X_PO:
        alone = one.touches._replace(grasp=np.zeros(CONTACTS, dtype=np.int64))
        residual, by_pose, by_shared, log_scale = surface_rows([one.grid], X_PO[None], alone, one.noise)
        r, J, B = residual.ravel(), by_pose.reshape(-1, 6), by_shared.reshape(-1, 3)
        spread = np.eye(len(r)) + B @ known.covariance @ B.T
        information = J.T @ np.linalg.solve(spread, J) + POSE_INFORMATION
        log_density.append(-0.5 * (r @ np.linalg.solve(spread, r) + np.linalg.slogdet(spread)[1]) - log_scale.sum())
        log_spread.append(np.linalg.slogdet(spread)[1])
        log_volume.append(-0.5 * np.linalg.slogdet(information)[1])
    assert np.ptp(log_volume) > 0.5
    assert np.ptp(log_spread) > 0.2 or variance < 20.0, "much of the residuals' spread is of what grasps share"
    log_mass = np.add(log_density, log_volume)
    np.testing.assert_allclose(np.log(found.probability / found.probability[0]), log_mass - log_mass[0], atol=0.01)


def test_two_poses_are_as_uncertain_as_they_are_apart(blob: ObjectModel) -> None:
    shifted = Shifted(blob, SHIFT, noise=0.0003)
    solution = solve_shared(shifted.problem, np.zeros(3), shifted.X_PO, shifted.noise(0.0003, 0.03))
    known = Knowledge(solution.shared, solution.covariance)
    without = others(shifted.problem, solution)[GRASP]
    one = explain(felt(shifted, without), shifted.X_PO[[GRASP]], without)
    away = np.array([0.3, 0.0, 0.0])
    both = one._replace(
        X_PO=np.repeat(one.X_PO, 2, axis=0),
        probability=np.array([0.75, 0.25]),
        shared=np.array([one.shared[0], one.shared[0] + away]),
    )
    sure = mixture([one._replace(probability=np.ones(1))], [without], known)
    np.testing.assert_allclose(sure.mean, known.mean)
    np.testing.assert_allclose(sure.covariance, known.covariance)
    doubtful = mixture([both], [without], known)
    np.testing.assert_allclose(doubtful.mean, known.mean + 0.25 * away)
    np.testing.assert_allclose(doubtful.covariance, known.covariance + 0.75 * 0.25 * np.outer(away, away), atol=1e-12)
    none = mixture([one._replace(probability=np.zeros(1))], [without], known)
    np.testing.assert_allclose(none.mean, without.mean)
    np.testing.assert_allclose(none.covariance, without.covariance)


def test_a_grasp_without_a_contact_says_nothing(blob: ObjectModel) -> None:
    shifted = Shifted(blob, SHIFT, noise=0.0003)
    known = known_by_others(shifted)
    touches = felt(shifted, known)
    none = touches._replace(
        touches=touches.touches.chosen(np.zeros(0, dtype=np.intp)),
        noise=touches.noise.chosen(np.zeros(0, dtype=np.intp)),
    )
    invalid = touches._replace(touches=touches.touches._replace(valid=np.zeros(6, dtype=np.bool_)))
    for silent in (none, invalid):
        candidates = explain(silent, shifted.X_PO[[GRASP]], known)
        np.testing.assert_allclose(candidates.shared, known.mean[None], atol=1e-12)
