import numpy as np
import pytest

from tactopose_drake.core.kernels.mode_kernels import Minima, best_of_each, one_of_each
from tactopose_drake.core.poses import compose, increments_between, make_poses, random_rotations, retract
from tactopose_drake.core.shape.symmetry import RotationalSymmetry, symmetry_group


@pytest.mark.parametrize("wide", [0.02, 0.3, 3.0])
def test_each_pose_belongs_to_the_first_mode_within_its_distance(wide: float) -> None:
    generator = np.random.default_rng(0)
    symmetries = symmetry_group([RotationalSymmetry(np.array([0.0, 0.0, 1.0]), np.array([0.01, 0.0, 0.0]), 4)])
    places = make_poses(random_rotations(generator, 5), 0.05 * generator.normal(size=(5, 3)))
    X_PO = retract(places[generator.integers(5, size=60)], generator.normal(size=(60, 6)) * np.repeat([wide, 0.003], 3))
    root = generator.normal(size=(60, 6, 6)) / np.repeat([wide, 0.003], 3)[:, None]
    information = root @ np.swapaxes(root, 1, 2)
    found = one_of_each(X_PO, information, symmetries, 3.0)
    expected: list[int] = []
    for b in range(60):
        images = compose(X_PO[b][None], symmetries)
        mine = b
        for a in sorted(set(expected)):
            u = increments_between(X_PO[a][None], images)
            if np.einsum("si,ij,sj->s", u, information[a], u).min() < 9.0:
                mine = a
                break
        expected.append(mine)
    assert found.tolist() == sorted(set(expected))
    assert 5 < len(set(expected)) < 60


def test_of_minima_in_any_order_the_cheapest_count_until_they_are_enough_or_cost_too_much() -> None:
    generator = np.random.default_rng(1)
    X_PO = retract(np.tile(np.eye(3, 4), (60, 1, 1)), 0.3 * generator.normal(size=(60, 6)))
    root, cost = generator.normal(size=(60, 6, 6)), generator.permutation(60) / 10.0
    hessian, known, symmetries = (
        root @ np.swapaxes(root, 1, 2),
        np.diag([1.0, 2.0, 3.0, 1.0, 2.0, 3.0]),
        np.eye(3, 4)[None],
    )
    minima, order = Minima(X_PO, cost, hessian), np.argsort(cost)
    found, covariance, log_determinant = best_of_each(minima, known, symmetries, 2.0)
    expected = order[one_of_each(X_PO[order], (hessian + known)[order], symmetries, 2.0)]
    assert 5 < len(found) < 60
    np.testing.assert_array_equal(found, expected)
    np.testing.assert_allclose(covariance @ (hessian[found] + known), np.tile(np.eye(6), (len(found), 1, 1)), atol=1e-9)
    np.testing.assert_allclose(log_determinant, np.linalg.slogdet(hessian[found] + known)[1])
    np.testing.assert_array_equal(best_of_each(minima, known, symmetries, 2.0, most=4).chosen, found[:4])
    np.testing.assert_array_equal(best_of_each(minima, known, symmetries, 2.0, most=100).chosen, found)
    near = best_of_each(minima, known, symmetries, 2.0, worth=2.05).chosen
    assert 0 < len(near) < len(found)
    np.testing.assert_array_equal(near, found[cost[found] <= 2.05])
