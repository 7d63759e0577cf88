import numpy as np

from tactopose_drake.core.poses import increments_between, make_poses, random_rotations, retract
from tactopose_drake.core.posterior.gaussian_mixture import GaussianMixture
from tactopose_drake.core.posterior.moved_origin import mixture_of_origin, move_origin


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
