import math

import numpy as np
import pytest

from tactopose_drake.core.kernels.matrix_kernels import inverses
from tactopose_drake.core.poses import (
    exp_so3,
    identity_poses,
    make_poses,
    retract,
)
from tactopose_drake.core.posterior.modes import determined_part, determined_variance, find_modes, free_directions

SIZE = 0.2
INFORMATION = np.diag([1e4] * 3 + [1e6] * 3)  # 0.01 rad and 1 mm


def modes(X_PO: np.ndarray, cost: list[float], symmetries: np.ndarray | None = None, information=INFORMATION, limit=64):  # type: ignore[no-untyped-def]
    touch = np.tile(information, (len(X_PO), 1, 1))
    symmetries = identity_poses(1) if symmetries is None else symmetries
    return find_modes(X_PO, np.array(cost), touch, np.eye(6), symmetries, SIZE, limit)


def test_the_variance_that_is_determined_is_that_of_what_is_left_of_increments() -> None:
    generator, units = np.random.default_rng(0), np.repeat([2.0 / SIZE, 1.0], 3)
    root = generator.normal(size=(6, 6)) * np.repeat([0.05, 0.002], 3)[:, None]
    drawn = generator.normal(size=(200_000, 6)) @ root.T
    for free in (np.zeros((0, 6)), generator.normal(size=(1, 6)), generator.normal(size=(3, 6))):
        left = determined_part(drawn, free, SIZE) / units
        found = determined_variance(root @ root.T, free, SIZE)
        assert found == pytest.approx(np.mean(np.sum(left**2, axis=1)), rel=0.02)


def test_poses_within_three_sigma_are_one_mode() -> None:
    X_PO = retract(np.eye(3, 4), np.array([[0.0] * 6, [0, 0, 0, 0.002, 0, 0], [0, 0, 0, 0.004, 0, 0]]))
    assert len(modes(X_PO, [1.0, 1.1, 1.2]).cost) == 2
    assert len(modes(X_PO, [1.0, 1.1, 1.2], limit=1).cost) == 1


@pytest.mark.parametrize("order", [[0, 1, 2], [1, 0, 2], [2, 1, 0]])
def test_a_wide_mode_takes_in_no_minimum_that_is_deeper(order: list[int]) -> None:
    X_PO = retract(np.eye(3, 4), np.array([[0.0] * 6, [0, 0, 0, 0.02, 0, 0], [0, 0, 0, 0.1, 0, 0]]))[order]
    cost, touch = np.array([1.0, 6.0, 2.0])[order], np.stack([INFORMATION, 1e-3 * INFORMATION, INFORMATION])[order]
    told = find_modes(X_PO, cost, touch, np.zeros((6, 6)), identity_poses(1), SIZE, 64)
    np.testing.assert_array_equal(np.sort(told.cost), [1.0, 2.0, 6.0])


def test_poses_that_a_symmetry_joins_are_one_mode() -> None:
    flip = make_poses(exp_so3(np.array([[0, 0, 0], [0, 0, math.pi]])), np.zeros((2, 3)))
    X_PO = np.stack([np.eye(3, 4), flip[1]])
    assert len(modes(X_PO, [1.0, 1.0]).cost) == 2
    assert len(modes(X_PO, [1.0, 1.0], flip).cost) == 1


def test_probabilities_follow_cost_and_volume() -> None:
    X_PO = retract(np.eye(3, 4), np.array([[0.0] * 6, [0, 0, 0, 0.05, 0, 0]]))
    equal = modes(X_PO, [1.0, 1.0])
    np.testing.assert_allclose(equal.mixture.weights, [0.5, 0.5])
    one_better = modes(X_PO, [1.0, 2.0])
    np.testing.assert_allclose(one_better.mixture.weights[0] / one_better.mixture.weights[1], math.e)
    # Four times the information halves a standard deviation, and with it the volume under the peak.
    touch = np.stack([INFORMATION, INFORMATION])
    touch[1, 0, 0] *= 4.0
    narrow = find_modes(X_PO, np.ones(2), touch, np.zeros((6, 6)), identity_poses(1), SIZE, 64)
    np.testing.assert_allclose(narrow.mixture.weights, [2 / 3, 1 / 3])
    np.testing.assert_allclose(narrow.mixture.covariance[0], np.linalg.inv(INFORMATION))


def test_a_far_worse_pose_has_no_weight_and_no_overflow() -> None:
    X_PO = retract(np.eye(3, 4), np.array([[0.0] * 6, [0, 0, 0, 0.05, 0, 0]]))
    np.testing.assert_array_equal(modes(X_PO, [1e5, 2e5]).mixture.weights, [1.0, 0.0])


@pytest.mark.parametrize("axis", range(6))
def test_a_direction_without_information_is_free(axis: int) -> None:
    information = INFORMATION.copy()
    information[axis, axis] = 0.0
    (free,) = free_directions(information[None], SIZE)
    assert free.shape == (1, 6)
    np.testing.assert_allclose(np.abs(free[0]), np.eye(6)[axis], atol=1e-12)


def test_free_means_worse_than_a_tenth_of_the_size() -> None:
    # 10 % of the size is 20 mm, or 0.2 rad at half the size.
    for sigma, count in ((0.019, 0), (0.021, 1)):
        information = INFORMATION.copy()
        information[5, 5] = 1.0 / sigma**2
        assert len(free_directions(information[None], SIZE)[0]) == count
    for sigma, count in ((0.19, 0), (0.21, 1)):
        information = INFORMATION.copy()
        information[2, 2] = 1.0 / sigma**2
        assert len(free_directions(information[None], SIZE)[0]) == count


def test_known_free_directions_stay_and_those_across_them_join() -> None:
    limit = 1.0 / (0.1 * SIZE) ** 2
    units = np.repeat([2.0 / SIZE, 1.0], 3)
    slide = np.array([[0.0, 0.0, 0.0, 0.6, 0.8, 0.0]])
    # Half of what it takes along z, and twice that elsewhere, along the slide too.
    information = np.diag(limit * np.array([2, 2, 2, 2, 2, 0.5]) / units**2)
    stay, join = free_directions(np.stack([4.0 * information, information]), SIZE, [slide, slide])
    np.testing.assert_allclose(stay, slide)
    assert join.shape == (2, 6)
    np.testing.assert_allclose(join @ join.T, np.eye(2), atol=1e-12)
    for direction in (slide[0], np.eye(6)[5]):
        np.testing.assert_allclose(determined_part(direction, join, SIZE), 0.0, atol=1e-12)


def test_the_determined_part_leaves_out_the_free_one() -> None:
    free = np.stack([np.eye(6)[2], np.array([0, 0, 0, 0.6, 0.8, 0])])
    increment = np.array([0.1, 0.2, 0.3, 0.01, 0.02, 0.03])
    along = increment[3:5] @ np.array([0.6, 0.8])
    expected = [0.1, 0.2, 0.0, 0.01 - 0.6 * along, 0.02 - 0.8 * along, 0.03]
    np.testing.assert_allclose(determined_part(increment, free, SIZE), expected, atol=1e-12)
    np.testing.assert_allclose(determined_part(increment, np.zeros((0, 6)), SIZE), increment)
    screw = np.array([[0.0, 0.0, 1.0, 0.05, 0.0, 0.0]]) / np.linalg.norm([1.0, 0.05])
    np.testing.assert_allclose(determined_part(3.0 * screw[0], screw, SIZE), 0.0, atol=1e-12)


def test_what_doubles_cannot_hold_side_by_side_is_finite() -> None:
    X_PO = retract(np.eye(3, 4), np.random.default_rng(1).normal(size=(20, 6)))
    along = np.linalg.qr(np.random.default_rng(2).normal(size=(20, 6, 6)))[0][:, :, :5]
    touch = 1e16 * along @ np.swapaxes(along, 1, 2)
    prior = 1e-6 * np.eye(6)
    assert not np.isfinite(inverses(touch + prior)[1]).all()
    far_apart = find_modes(X_PO, np.ones(20), touch, prior, identity_poses(1), SIZE, 64)
    assert np.isfinite(far_apart.mixture.covariance).all()
    assert np.isfinite(far_apart.mixture.weights).all()
    assert math.isfinite(far_apart.log_mass)
    values = np.linalg.eigvalsh(far_apart.mixture.covariance)
    assert (values[:, 0] > -1e-12 * values[:, -1]).all()
    assert (values[:, -1] > 1e6 * values[:, -2]).all()  # What the touch leaves free is still much less certain.
