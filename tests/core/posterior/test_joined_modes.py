import numpy as np
import pytest

from tactopose_drake.core.poses import compose, exp_so3, increments_between, make_poses, retract
from tactopose_drake.core.posterior.joined_modes import join_overlapping
from tactopose_drake.core.posterior.mode_moments import Moments, weigh_moments
from tactopose_drake.core.posterior.student_t_mixture import find_increments
from tactopose_drake.core.validation import FloatArray

SIGMAS = np.array([0.03, 0.02, 0.05, 0.001, 0.002, 0.0015])
SCALE = np.outer(SIGMAS, SIGMAS)
ALONE = np.eye(3, 4)[None]
X_PO = make_poses(exp_so3(np.array([0.4, -1.0, 2.0])), np.array([0.1, 0.0, -0.2]))
# A half turn about the line through this point along the y-axis.
HALF_TURN = np.array([[-1.0, 0.0, 0.0, 0.08], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, -1.0, -0.06]])


def centred(covariance: FloatArray, effective_samples: float = 50.0) -> Moments:
    """Moments of modes with these covariances about their poses."""
    return Moments(np.full(len(covariance), effective_samples), np.zeros((len(covariance), 6)), covariance.copy())


def beside(*lengths: float) -> FloatArray:
    """Poses so many standard deviations from X_PO, along a direction of its own each."""
    return retract(np.tile(X_PO, (len(lengths), 1, 1)), np.diag(SIGMAS)[: len(lengths)] * np.array(lengths)[:, None])


def join(
    X: FloatArray, mass: list[float], covariance: FloatArray | None = None, symmetries: FloatArray = ALONE
) -> tuple[FloatArray, Moments]:
    """Joins modes by rising cost."""
    spread = np.tile(np.diag(SIGMAS**2), (len(X), 1, 1)) if covariance is None else covariance
    cost = np.arange(len(X), dtype=float)
    mass_of, moments, _ = join_overlapping(X, cost, np.array(mass), spread, centred(spread), symmetries)
    return mass_of, moments


def test_modes_within_three_standard_deviations_are_one() -> None:
    mass, moments = join(beside(0.0, 2.9, 3.3), [0.5, 0.1, 0.4])
    np.testing.assert_allclose(mass, [0.6, 0.0, 0.4])
    np.testing.assert_allclose(moments.first[0] / SIGMAS, [0, 2.9 * 0.1 / 0.6, 0, 0, 0, 0], atol=1e-12)
    np.testing.assert_array_equal(moments.first[2], 0.0)


def test_of_those_that_overlap_the_lowest_cost_stays_and_owns_them() -> None:
    spread = np.tile(np.diag(SIGMAS**2), (3, 1, 1))
    mass, _, owner = join_overlapping(
        beside(0.0, 1.0, 9.0), np.array([3.0, 2.0, 4.0]), np.array([0.5, 0.1, 0.4]), spread, centred(spread), ALONE
    )
    np.testing.assert_allclose(mass, [0.0, 0.6, 0.4])
    np.testing.assert_array_equal(owner, [1, 1, 2])


def test_the_joint_moments_are_those_of_the_samples_together() -> None:
    generator = np.random.default_rng(3)
    X = beside(0.0, 1.5)
    u = generator.normal(size=(2, 4000, 6)) * np.array([SIGMAS, 1.4 * SIGMAS])[:, None] + 0.2 * SIGMAS
    samples = retract(np.repeat(X, 4000, axis=0), u.reshape(-1, 6))
    weights = np.zeros((8000, 2))
    weights[:4000, 0], weights[4000:, 1] = 0.6 / 4000, 0.4 / 4000
    apart = weigh_moments(find_increments(X, samples).u, weights)
    mass, joint, _ = join_overlapping(X, np.zeros(2), np.array([0.6, 0.4]), apart.second, apart, ALONE)
    together = weigh_moments(find_increments(X[:1], samples).u, weights.sum(axis=1, keepdims=True))
    np.testing.assert_allclose(mass, [1.0, 0.0])
    np.testing.assert_allclose(joint.first[0] / SIGMAS, together.first[0] / SIGMAS, atol=0.02)
    np.testing.assert_allclose(joint.second[0] / SCALE, together.second[0] / SCALE, atol=0.05)
    assert joint.effective_samples[0] == pytest.approx(together.effective_samples[0])


def test_a_little_mode_in_a_wide_one_joins_it_and_a_wide_one_keeps_off_a_narrow_one() -> None:
    wide, narrow = np.diag(SIGMAS**2), 1e-4 * np.diag(SIGMAS**2)
    inside, _ = join(beside(0.0, 1.0), [0.9, 0.1], np.stack([wide, narrow]))
    np.testing.assert_allclose(inside, [1.0, 0.0])
    around, _ = join(beside(0.0, 2.0), [0.9, 0.1], np.stack([narrow, wide]))
    np.testing.assert_allclose(around, [0.9, 0.1])


def test_what_is_given_stays_as_it_was() -> None:
    spread = np.tile(np.diag(SIGMAS**2), (2, 1, 1))
    mass, moments = np.array([0.7, 0.3]), centred(spread)
    join_overlapping(beside(0.0, 1.0), np.zeros(2), mass, spread, moments, ALONE)
    np.testing.assert_array_equal(mass, [0.7, 0.3])
    np.testing.assert_array_equal(moments.second, spread)
    np.testing.assert_array_equal(moments.first, 0.0)


@pytest.mark.parametrize("seed", [0, 1])
def test_images_by_a_symmetry_are_compared_where_they_are_alike(seed: int) -> None:
    # The same two modes, of which the second is given as its image: mass and moments are the same.
    generator = np.random.default_rng(seed)
    roots = generator.normal(size=(2, 6, 6)) * SIGMAS[:, None] / 6
    covariance = roots @ np.swapaxes(roots, 1, 2) + np.diag(SIGMAS**2)
    X = beside(0.0, 1.0)
    mass, direct = join(X, [0.7, 0.3], covariance)
    np.testing.assert_allclose(mass, [1.0, 0.0])

    # How the second mode's increments turn with it, by differences.
    image = compose(X[1], HALF_TURN)
    u = increments_between(image, compose(retract(np.tile(X[1], (6, 1, 1)), 1e-6 * np.eye(6)), HALF_TURN)) / 1e-6
    covariance[1] = u.T @ covariance[1] @ u
    group = np.stack([np.eye(3, 4), HALF_TURN])
    mass, there = join(np.stack([X[0], image]), [0.7, 0.3], covariance, group)
    np.testing.assert_allclose(mass, [1.0, 0.0])
    np.testing.assert_allclose(there.first / SIGMAS, direct.first / SIGMAS, atol=1e-6)
    np.testing.assert_allclose(there.second[0] / SCALE, direct.second[0] / SCALE, atol=1e-3)
    apart, _ = join(np.stack([X[0], image]), [0.7, 0.3], covariance)
    np.testing.assert_allclose(apart, [0.7, 0.3])
