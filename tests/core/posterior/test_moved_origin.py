import numpy as np

from tactopose_drake.core.poses import increments_between, make_poses, random_rotations, retract
from tactopose_drake.core.posterior.gaussian_mixture import GaussianMixture
from tactopose_drake.core.posterior.moved_origin import mixture_of_middle, mixture_of_origin, move_origin


def test_what_is_known_of_a_far_origin_is_what_poses_of_the_middle_make_of_it() -> None:
    """Against draws: 0.4 m away, turns of ten degrees move the origin along an arc, not a straight line."""
    generator, p_OC = np.random.default_rng(0), np.array([0.3, -0.1, 0.25])
    X_PC = make_poses(random_rotations(generator, 1), np.array([[0.02, 0.0, 0.1]]))
    sigmas = np.repeat([np.radians(10.0), 0.004], 3)
    root = np.diag(sigmas) @ (np.eye(6) + 0.3 * np.tril(generator.normal(size=(6, 6)), -1))
    found = mixture_of_origin(GaussianMixture(X_PC, np.ones(1), (root @ root.T)[None]), p_OC)
    drawn = move_origin(retract(np.repeat(X_PC, 200000, axis=0), generator.normal(size=(200000, 6)) @ root.T), -p_OC)
    increments = increments_between(np.repeat(found.X_PO, len(drawn), axis=0), drawn)
    second_moments = increments.T @ increments / len(drawn)
    scale = np.sqrt(np.diag(second_moments))
    np.testing.assert_allclose((found.covariance[0] - second_moments) / np.outer(scale, scale), 0.0, atol=0.08)
    # The arc is what it takes: a straight line alone would fall short of what there is.
    line = np.linalg.eigvalsh(second_moments[3:, 3:])[0]
    R = X_PC[0, :, :3]
    cross = np.array([[0, -p_OC[2], p_OC[1]], [p_OC[2], 0, -p_OC[0]], [-p_OC[1], p_OC[0], 0]])
    J = np.hstack([R @ cross, np.eye(3)])
    assert np.linalg.eigvalsh(J @ root @ root.T @ J.T)[0] < 0.7 * line


def test_what_is_known_of_the_middle_comes_back_from_the_origin() -> None:
    generator, p_OC = np.random.default_rng(0), np.array([1.3, -0.4, 0.6])
    X_PC = make_poses(random_rotations(generator, 3), 0.1 * generator.normal(size=(3, 3)))
    root = np.diag(np.repeat([np.radians(5.0), 0.002], 3)) @ (np.eye(6) + 0.2 * generator.normal(size=(3, 6, 6)))
    middle = GaussianMixture(X_PC, np.full(3, 1.0 / 3.0), root @ np.swapaxes(root, 1, 2))
    again = mixture_of_middle(mixture_of_origin(middle, p_OC), p_OC)
    np.testing.assert_allclose(again.X_PO, middle.X_PO, atol=1e-12)
    np.testing.assert_allclose(again.covariance, middle.covariance, atol=1e-10)
    # A belief of the origin that leaves the arc out is one of the middle still.
    without = GaussianMixture(X_PC, middle.weights, np.tile(np.diag(np.repeat([0.1, 1e-4], 3) ** 2), (3, 1, 1)))
    assert np.linalg.eigvalsh(mixture_of_middle(without, p_OC).covariance).min() > -1e-12


def test_a_turn_that_is_known_for_certain_does_not_move_the_origin() -> None:
    p_OC, variances = np.array([0.5, 0.0, 0.0]), np.array([0.01, 0.0, 0.0, 1e-6, 1e-6, 1e-6])
    middle = GaussianMixture(np.eye(3, 4)[None], np.ones(1), np.diag(variances)[None])
    origin = mixture_of_origin(middle, p_OC)
    np.testing.assert_allclose(origin.covariance[0], np.diag(variances), atol=1e-15)
    np.testing.assert_allclose(mixture_of_middle(origin, p_OC).covariance[0], np.diag(variances), atol=1e-15)
