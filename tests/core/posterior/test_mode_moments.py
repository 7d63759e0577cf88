"""What samples say of a mode's spread, by how many they are worth."""

from typing import Any, cast

import numpy as np
import pytest

from tactopose_drake.core.poses import identity_poses
from tactopose_drake.core.posterior.mode_moments import spread
from tactopose_drake.core.posterior.posterior import Posterior
from tactopose_drake.core.posterior.posterior_params import MomentParams


def posterior(axes: np.ndarray, moments: np.ndarray) -> Posterior:
    """One of which nothing is asked but its turns, known to a radian without the touch."""
    nothing = cast("Any", None)
    return Posterior(nothing, nothing, nothing, None, axes, moments, np.eye(6), identity_poses(1), 0.1, 0.001)


@pytest.mark.parametrize("count", [7, 20])
def test_of_few_samples_it_is_that_of_the_next_one_as_far_as_these_and_laplace_know(count: int) -> None:
    """Of normal samples whose covariance has an inverse Wishart distribution about Laplace's, before they are drawn."""
    generator, known = np.random.default_rng(0), int(MomentParams().pseudo_samples)
    laplace, nothing = np.diag([4.0, 1.0, 1.0, 0.25, 1.0, 9.0]), np.zeros((0, 3))
    root = np.linalg.cholesky(np.linalg.inv(known * laplace))
    ratios = []
    for _ in range(2000):
        rows = generator.normal(size=(known, 6)) @ root.T
        drawn = generator.normal(size=(count + 1, 6)) @ np.linalg.cholesky(np.linalg.inv(rows.T @ rows)).T
        second = drawn[:-1].T @ drawn[:-1] / count
        told = second[None], laplace[None], np.array([float(count)])
        said = np.diag(spread(identity_poses(1), *told, posterior(nothing, nothing))[0])
        ratios.append(drawn[-1] ** 2 / said)
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.1)


def test_a_turn_that_changes_nothing_has_the_spread_that_is_known_without_the_touch() -> None:
    axis, moment = np.array([[0.0, 0.6, 0.8]]), np.array([[0.02, -0.04, 0.03]])
    laplace = 1e-8 * np.eye(6)
    told = np.zeros((1, 6, 6)), laplace[None], np.array([1e12])
    direction = np.concatenate([axis[0], moment[0]])
    found = spread(identity_poses(1), *told, posterior(axis, moment))[0]
    np.testing.assert_allclose(found, np.outer(direction, direction), atol=1e-12)
