import dataclasses
import math

import numpy as np
import pytest

from tactopose_drake.core.poses import compose, exp_so3, increments_between, make_poses, retract
from tactopose_drake.core.posterior.alike_modes import indistinct_images, join_alike
from tactopose_drake.core.posterior.gaussian_mixture import GaussianMixture
from tactopose_drake.core.posterior.modes import Modes
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.shape.symmetry import RotationalSymmetry
from tests.core.meshes import create, scanned_can

AXIS, POINT = np.array([0.0, 0.6, 0.8]), np.array([0.01, 0.02, -0.03])
COVARIANCE = np.diag([0.02**2] * 3 + [0.001**2] * 3)
X_FIRST = retract(np.eye(3, 4)[None], np.array([[0.3, -0.2, 0.5, 0.02, 0.1, 0.0]]))[0]


@pytest.fixture(scope="module")
def can() -> ObjectModel:
    """Of which an axis anywhere is taken for one of near symmetry: nothing here looks at the surface."""
    model = ObjectModel.from_mesh(scanned_can(), samples=200, max_grid_bytes=160_000, symmetry="none", cache=False)
    return dataclasses.replace(model, near_symmetries=(RotationalSymmetry(AXIS, POINT, 0),))


def turned(angles: list[float]) -> np.ndarray:
    """The first pose by turns about the axis, shape (n, 3, 4)."""
    R = exp_so3(np.array(angles)[:, None] * AXIS)
    return np.array([compose_with(X) for X in make_poses(R, POINT - R @ POINT)])


def compose_with(X_OO: np.ndarray) -> np.ndarray:
    return np.column_stack([X_FIRST[:, :3] @ X_OO[:, :3], X_FIRST[:, :3] @ X_OO[:, 3] + X_FIRST[:, 3]])


def modes(X_PO: np.ndarray, weights: list[float]) -> Modes:
    count = len(X_PO)
    return Modes(
        mixture=GaussianMixture(X_PO, np.array(weights), np.tile(COVARIANCE, (count, 1, 1))),
        cost=np.arange(count, dtype=np.float64),
        free_directions=(np.empty((0, 6)),) * count,
        log_mass=0.0,
    )


def test_modes_along_the_turn_are_one_with_the_turn_free(can: ObjectModel) -> None:
    angles, weights = [0.0, 1.0, -2.0, 3.0], [0.4, 0.3, 0.2, 0.1]
    one = join_alike(modes(turned(angles), weights), can)
    assert len(one.mixture) == 1
    assert one.mixture.weights[0] == pytest.approx(1.0)
    np.testing.assert_array_equal(one.mixture.X_PO[0], X_FIRST)
    assert one.cost[0] == 0.0
    (free,) = one.free_directions[0]
    np.testing.assert_allclose(np.abs(free[:3] @ AXIS), np.linalg.norm(free[:3]), rtol=1e-9)
    # Along the free direction a small turn moves no point of the axis.
    small = retract(X_FIRST[None], 1e-6 * free[None])[0]
    for along in (0.0, 0.1):
        p_OQ = POINT + along * AXIS
        np.testing.assert_allclose(small[:, :3] @ p_OQ + small[:, 3], X_FIRST[:, :3] @ p_OQ + X_FIRST[:, 3], atol=1e-11)
    covariance = one.mixture.covariance[0]
    spin = AXIS @ covariance[:3, :3] @ AXIS
    assert spin == pytest.approx(0.02**2 + np.dot(weights, np.square(angles)), rel=1e-6)
    across = np.linalg.svd(AXIS[None])[2][1]
    assert across @ covariance[:3, :3] @ across == pytest.approx(0.02**2, rel=1e-6)
    # The axis does not move by the turns: its points are as sure as they were.
    J = np.hstack([-X_FIRST[:, :3] @ np.cross(np.eye(3), POINT), np.eye(3)])
    assert np.trace(J @ covariance @ J.T) == pytest.approx(np.trace(J @ COVARIANCE @ J.T), rel=1e-6)


def test_what_is_known_of_an_image_is_said_of_the_axes_of_the_one_that_stays() -> None:
    """Two modes that say the same of a square prism off its origin, each about its own axes, say it together."""
    mesh = create.box((0.06, 0.06, 0.11))
    mesh.apply_translation([0.04, 0.0, 0.02])
    prism = ObjectModel.from_mesh(mesh, cache=False)
    root = np.random.default_rng(0).normal(size=(6, 6)) * np.repeat([0.02, 0.001], 3) * np.array([[1, 5, 1, 1, 1, 1]]).T
    covariance, steps = root @ root.T, 1e-6 * np.eye(6)
    assert len(prism.symmetry_poses) == 8
    for image in prism.symmetry_poses:
        X_PO = np.stack([X_FIRST, compose(X_FIRST, image)])
        J = increments_between(X_PO[1], compose(retract(X_FIRST, steps), image)).T / 1e-6
        both = modes(X_PO, [0.5, 0.5])
        mixture = dataclasses.replace(both.mixture, covariance=np.stack([covariance, J @ covariance @ J.T]))
        one = join_alike(dataclasses.replace(both, mixture=mixture), prism)
        assert len(one.mixture) == 1
        np.testing.assert_allclose(one.mixture.covariance[0], covariance, atol=1e-4 * np.abs(covariance).max())


def test_modes_are_alike_within_what_is_known_of_both(can: ObjectModel) -> None:
    (X_FAR,) = retract(turned([1.0]), np.array([[0.0, 0.0, 0.0, 0.01, 0.0, 0.0]]))
    both = modes(np.stack([X_FIRST, X_FAR]), [0.5, 0.5])
    for widths, count in (([1.0, 1.0], 2), ([10.0, 1.0], 1), ([1.0, 10.0], 1)):
        mixture = dataclasses.replace(both.mixture, covariance=np.square(widths)[:, None, None] * COVARIANCE)
        assert len(join_alike(dataclasses.replace(both, mixture=mixture), can).mixture) == count


def test_how_far_modes_lie_beside_the_turn_is_in_their_spread(can: ObjectModel) -> None:
    """Along the axis, and by a turn across it: no turn about the axis leads from one to the other."""
    along, across = X_FIRST[:, :3] @ AXIS, np.linalg.svd(AXIS[None])[2][1]
    for u in (0.0015 * np.append(np.zeros(3), along), 0.03 * np.append(across, np.zeros(3))):
        X_PO = np.stack([X_FIRST, retract(X_FIRST[None], u[None])[0]])
        for weights in ([0.5, 0.5], [0.7, 0.3]):
            one = join_alike(modes(X_PO, weights), can)
            assert len(one.mixture) == 1
            way = u / np.linalg.norm(u)
            spread, own = way @ one.mixture.covariance[0] @ way, way @ COVARIANCE @ way
            assert spread == pytest.approx(own + weights[1] * u @ u, rel=0.02)


def test_what_the_touch_tells_apart_keeps_its_own_probability(can: ObjectModel) -> None:
    apart = modes(turned([0.0, 1.0, -2.0]), [0.95, 0.04, 0.01])
    found = join_alike(apart, can)
    # The two that are left are alike, and neither of them has nearly all of what they share.
    np.testing.assert_allclose(found.mixture.weights, [0.95, 0.05])
    assert [len(free) for free in found.free_directions] == [0, 1]


def test_modes_that_no_turn_explains_stay(can: ObjectModel) -> None:
    X_PO = turned([0.0, 1.0, 2.0])
    X_PO[1] = retract(X_PO[1][None], np.array([[0.0, 0.0, 0.0, 0.02, 0.0, 0.0]]))[0]
    found = join_alike(modes(X_PO, [0.4, 0.35, 0.25]), can)
    np.testing.assert_allclose(found.mixture.weights, [0.65, 0.35])
    assert [len(free) for free in found.free_directions] == [1, 0]


def test_joined_modes_may_overtake(can: ObjectModel) -> None:
    X_PO = turned([0.0, 0.0, 1.0])
    X_PO[0, :, 3] += 0.05
    found = join_alike(modes(X_PO, [0.4, 0.3, 0.3]), can)
    np.testing.assert_allclose(found.mixture.weights, [0.6, 0.4])
    np.testing.assert_allclose(found.cost, [1.0, 0.0])


def test_a_short_turn_is_not_free(can: ObjectModel) -> None:
    found = join_alike(modes(turned([0.0, 0.15]), [0.5, 0.5]), can)
    assert len(found.mixture) == 1
    assert len(found.free_directions[0]) == 0


def test_a_free_direction_beside_the_turn_stays_free(can: ObjectModel) -> None:
    slide = np.array([[0.0, 0.0, 0.0, 1.0, 0.0, 0.0]])
    spin = np.concatenate([AXIS, -X_FIRST[:, :3] @ np.cross(AXIS, POINT)])[None]
    given = modes(turned([0.0, 1.0]), [0.5, 0.5])
    for own, count in ((slide, 2), (spin / np.linalg.norm(spin), 1), (np.empty((0, 6)), 1)):
        free = join_alike(dataclasses.replace(given, free_directions=(own,) * 2), can).free_directions[0]
        assert len(free) == count
        np.testing.assert_allclose(free @ free.T, np.eye(count), atol=1e-12)


def test_any_turn_of_a_ball_is_free(can: ObjectModel) -> None:
    ball = dataclasses.replace(can, near_symmetries=tuple(RotationalSymmetry(a, POINT, 0) for a in np.eye(3)))
    R = exp_so3(np.random.default_rng(0).normal(size=(5, 3)))
    R[0] = np.eye(3)
    X_PO = np.array([compose_with(X) for X in make_poses(R, POINT - R @ POINT)])
    found = join_alike(modes(X_PO, [0.3, 0.2, 0.2, 0.2, 0.1]), ball)
    assert len(found.mixture) == 1
    assert len(found.free_directions[0]) == 3


def test_images_of_an_inexact_symmetry_are_told_apart_by_small_noise() -> None:
    box = create.box((0.05, 0.0503, 0.12))  # a quarter turn leaves it off by some 0.15 mm
    model = ObjectModel.from_mesh(box, samples=1000, cache=False)
    assert len(model.symmetry_poses) == 8
    assert len(indistinct_images(model, 1e-3)) == 8
    distinct = indistinct_images(model, 5e-5)
    assert len(distinct) == 4
    np.testing.assert_allclose(distinct[0], np.eye(3, 4))
    quarter = make_poses(exp_so3(np.array([[0.0, 0.0, 0.0], [0.0, 0.0, math.pi / 2]])), np.zeros((2, 3)))
    for weights, left in (([0.5, 0.5], 1), ([0.97, 0.03], 2)):
        found = join_alike(modes(quarter, weights), model)
        assert len(found.mixture) == left
        assert all(len(free) == 0 for free in found.free_directions)
    told = ObjectModel.from_mesh(box, samples=1000, symmetry=model.symmetries, cache=False)
    assert len(indistinct_images(told, 5e-5)) == 8


def test_modes_without_mass_stay_as_they_are(can: ObjectModel) -> None:
    apart = retract(X_FIRST[None], np.array([[0.0, 0.0, 0.0, 0.5, 0.0, 0.0]]))
    given = modes(np.concatenate([X_FIRST[None], apart]), [1.0, 0.0])
    np.testing.assert_array_equal(join_alike(given, can).mixture.weights, [1.0, 0.0])
