from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import trimesh
from pydrake.math import RigidTransform

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.poses import inverse, transform_points
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.synthetic.synthetic_patch import PadTouchParams, flat_pad, touch_with_pads
from tactopose_drake.core.synthetic.synthetic_touch import touch_surface
from tactopose_drake.errors import InvalidInputError
from tests.displaced_poses import random_pose


def test_without_noise_active_cells_lie_on_the_surface_and_others_outside() -> None:
    box = ObjectModel.from_mesh(trimesh.creation.box((0.05, 0.06, 0.07)))
    X_PO = random_pose(1)
    exact = {"sigma_position": 0.0, "sigma_rotation": 0.0, "sigma_depth": 0.0}
    patches = touch_with_pads(box, X_PO, 6, np.random.default_rng(1), **exact)
    for patch in patches:
        assert patch.active.sum() >= 3
        phi = box.grid.distance(transform_points(inverse(X_PO), patch.points))
        np.testing.assert_allclose(phi[patch.active], 0.0, atol=2e-5)
        assert phi[~patch.active].min(initial=0.0) >= 0.0
        # The pads face the object.
        _, n_O = box.grid.distance_and_normal(transform_points(inverse(X_PO), patch.centroid[None]))
        assert (X_PO[:, :3] @ n_O[0]) @ patch.n_PT[0] < -0.5
    # They are spread over the object.
    assert np.ptp([patch.centroid for patch in patches], axis=0).max() > 0.04


def test_the_noise_moves_pads_as_a_whole_and_depths_one_by_one() -> None:
    half = np.array([0.25, 0.3, 0.35])
    box = ObjectModel.from_mesh(trimesh.creation.box(2.0 * half))
    X_PO = np.eye(3, 4)
    offsets, depths = [], []
    for seed in range(100):
        generator = np.random.default_rng(seed)
        (patch,) = touch_with_pads(
            box, X_PO, 1, generator, lean=0.0, sigma_position=0.002, sigma_rotation=0.0, sigma_depth=0.0003
        )
        depth = patch.alpha * patch.pressure
        if patch.active.all():
            beyond = patch.p_PT @ -patch.n_PT[0] - np.abs(patch.n_PT[0]) @ half
            np.testing.assert_allclose(beyond, beyond[0], atol=1e-12)
            offsets.append(beyond[0] + 0.0012)
            depths.append(depth - 0.0012)
    assert len(offsets) > 80
    assert np.std(offsets) == pytest.approx(0.002, rel=0.3)
    assert np.std(depths) == pytest.approx(0.0003, rel=0.1)


def test_an_object_too_small_for_a_pad_is_named() -> None:
    needle = ObjectModel.from_mesh(trimesh.creation.icosphere(subdivisions=2, radius=0.001))
    with pytest.raises(InvalidInputError, match="must have 10 places for pads, not 0, in 40 tries"):
        touch_with_pads(needle, np.eye(3, 4), 1, np.random.default_rng(0))


@pytest.mark.parametrize("make", [touch_surface, touch_with_pads])
@pytest.mark.parametrize("count", [0, -1, 2.0])
def test_a_touch_of_no_contacts_is_refused_by_name(make: Callable[..., object], count: float) -> None:
    model = ObjectModel.from_mesh(trimesh.creation.box((0.05, 0.06, 0.07)), cache=False)
    with pytest.raises(InvalidInputError, match=f"count must be an integer >= 1, not {count}"):
        make(model, np.eye(3, 4), count, np.random.default_rng(0))


def test_a_flat_pad_is_a_grid_about_its_middle() -> None:
    cells = flat_pad(4, 2, 0.003)
    np.testing.assert_allclose(cells.mean(axis=0), 0.0, atol=1e-18)
    np.testing.assert_allclose(np.ptp(cells, axis=0), [0.009, 0.003, 0.0])


def test_softer_pads_feel_less_pressure_at_the_same_depths() -> None:
    box = ObjectModel.from_mesh(trimesh.creation.box((0.05, 0.06, 0.07)))
    hard = touch_with_pads(box, np.eye(3, 4), 2, np.random.default_rng(4))
    soft = touch_with_pads(box, np.eye(3, 4), 2, np.random.default_rng(4), params=PadTouchParams(alpha=4e-7))
    for one, other in zip(hard, soft, strict=True):
        np.testing.assert_allclose(other.pressure, one.pressure / 4.0)
        np.testing.assert_allclose(other.points, one.points, atol=1e-12)


@pytest.mark.parametrize("make", [touch_surface, touch_with_pads])
def test_a_pose_may_be_drakes_or_a_4x4_matrix(make: Callable[..., Any]) -> None:
    model = ObjectModel.from_mesh(trimesh.creation.box((0.05, 0.06, 0.07)), cache=False)
    X_PO = RigidTransform([0.1, 0.2, 0.3])
    poses = X_PO, X_PO.GetAsMatrix4(), X_PO.GetAsMatrix34()
    drawn = [make(model, pose, 1, np.random.default_rng(0)) for pose in poses]
    points = [touch.p_PC if isinstance(touch, Contacts) else touch[0].points for touch in drawn]
    np.testing.assert_array_equal(points[0], points[2])
    np.testing.assert_array_equal(points[1], points[2])
