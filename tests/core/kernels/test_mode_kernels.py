import numpy as np
import pytest

from tactopose_drake.core.kernels.mode_kernels import one_of_each
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
    np.testing.assert_array_equal(one_of_each(X_PO, information, symmetries, 3.0, most=4), found[:4])
    np.testing.assert_array_equal(one_of_each(X_PO, information, symmetries, 3.0, most=100), found)
