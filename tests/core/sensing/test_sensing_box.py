import numpy as np
import pytest

from tactopose_drake.core.poses import inverse, make_poses, random_rotations, transform_points
from tactopose_drake.core.sensing.patches import Patch, describe_patch
from tactopose_drake.core.sensing.sensing_range import sensing_box
from tactopose_drake.core.synthetic.synthetic_patch import flat_pad
from tactopose_drake.errors import InvalidInputError


def pad(p_PT: np.ndarray, n_PT: np.ndarray) -> Patch:
    return describe_patch(p_PT, np.zeros(len(p_PT)), alpha=1e-7, n_PT=n_PT)


def test_the_box_over_a_flat_pad() -> None:
    X_PT = make_poses(random_rotations(np.random.default_rng(1), 1), np.array([[0.1, 0.2, 0.3]]))[0]
    patch = pad(transform_points(X_PT, flat_pad(8, 3, 0.002)), np.tile(X_PT[:, 2], (24, 1)))
    box = sensing_box(patch, thickness=0.003, height=0.005)
    # Half a pitch beyond the cells; the core 3 mm below them.
    np.testing.assert_allclose(box.lower, [-0.008, -0.003, -0.005], atol=1e-12)
    np.testing.assert_allclose(box.upper, [0.008, 0.003, 0.008], atol=1e-12)
    np.testing.assert_allclose(box.X_PB[:, 2], X_PT[:, 2], atol=1e-12)
    np.testing.assert_allclose(box.X_PB[:, 3], X_PT[:, 3] - 0.003 * X_PT[:, 2], atol=1e-12)
    np.testing.assert_allclose(np.abs(box.X_PB[:, :3].T @ X_PT[:, :3]), np.eye(3), atol=1e-9)
    assert np.linalg.det(box.X_PB[:, :3]) == pytest.approx(1.0)


def test_the_box_reaches_to_the_ends_of_long_cells() -> None:
    cells = np.array([[0.002 * i, 0.006 * j, 0.0] for i in range(12) for j in range(2)])
    box = sensing_box(pad(cells, np.tile([0.0, 0.0, 1.0], (24, 1))), thickness=0.003, height=0.005)
    np.testing.assert_allclose(box.upper - box.lower, [0.024, 0.012, 0.013], atol=1e-12)


def test_the_core_of_a_bent_pad_is_below_its_lowest_cell() -> None:
    angle = np.repeat(np.linspace(-0.8, 0.8, 9), 4)
    n_PT = np.stack([np.sin(angle), np.zeros(36), np.cos(angle)], axis=1)
    p_PT = 0.008 * n_PT + np.tile([[0.0, 0.002 * j, 0.0] for j in range(4)], (9, 1))
    box = sensing_box(pad(p_PT, n_PT), thickness=0.001, height=0.004)
    cells = transform_points(inverse(box.X_PB), p_PT)
    assert cells[:, 2].min() == pytest.approx(0.001)
    assert box.lower[2] == pytest.approx(-0.004)
    assert box.upper[2] == pytest.approx(cells[:, 2].max() + 0.004)
    assert np.all(cells > box.lower)
    assert np.all(cells < box.upper)


def test_what_has_no_box_is_named() -> None:
    cells, out = flat_pad(), np.tile([0.0, 0.0, 1.0], (24, 1))
    with pytest.raises(InvalidInputError, match=r"p_PT must have at least 2 cells .*, not 1"):
        sensing_box(pad(cells[:1], out[:1]), thickness=0.0, height=0.005)
    with pytest.raises(InvalidInputError, match=r"n_PT must face a side .*, but the normals cancel"):
        sensing_box(pad(cells[:2], out[:2] * [[1.0], [-1.0]]), thickness=0.0, height=0.005)
    with pytest.raises(InvalidInputError, match=r"height must be .*, not 0"):
        sensing_box(pad(cells, out), thickness=0.0, height=0.0)
    with pytest.raises(InvalidInputError, match=r"thickness must be .*, not -1"):
        sensing_box(pad(cells, out), thickness=-1.0, height=0.005)
