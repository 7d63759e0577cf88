import numpy as np
import pytest
import trimesh
from pydrake.math import RigidTransform, RollPitchYaw

from tactopose_drake.core.poses import retract
from tactopose_drake.core.posterior.gaussian_mixture import GaussianMixture
from tactopose_drake.core.posterior.moved_origin import mixture_of_origin
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.estimation.far_origins import directions_of_origin
from tactopose_drake.visualization.scene import ShownHypothesis
from tactopose_drake.visualization.uncertainty import POINTS, ellipsoids, free_arrows, shown_points
from tests.core.models import brick

X_PO = RigidTransform(RollPitchYaw(0.4, -0.7, 1.9), [0.02, -0.03, 0.09])


@pytest.fixture(scope="module")
def model() -> ObjectModel:
    return brick(0.06, 0.08, 0.1)


def test_an_ellipsoid_holds_its_point_in_95_of_100_poses(model: ObjectModel) -> None:
    generator = np.random.default_rng(0)
    root = generator.normal(size=(6, 6)) * np.repeat([0.01, 0.002], 3)[:, None]
    shown = ShownHypothesis(X_PO, 1.0, root @ root.T)
    points = shown_points(model)
    assert points.shape == (POINTS, 3)
    X_drawn = retract(X_PO.GetAsMatrix34(), generator.normal(size=(4000, 6)) @ root.T)
    for ellipsoid, point in zip(ellipsoids(model, shown, points), points, strict=True):
        p_P = X_drawn[:, :, :3] @ point + X_drawn[:, :, 3]
        p_E = (X_PO @ ellipsoid.X_OE).inverse().multiply(p_P.T).T
        inside = np.sum((p_E / ellipsoid.radii) ** 2, axis=1) < 1.0
        assert np.mean(inside) == pytest.approx(0.95, abs=0.015)


def test_what_is_free_makes_no_ellipsoid_longer(model: ObjectModel) -> None:
    slide = np.array([[0.0, 0.0, 0.0, 1.0, 0.0, 0.0]])
    wide = np.diag(np.square([1e-4, 1e-4, 1e-4, 1.0, 0.001, 0.001]))
    points = shown_points(model)
    narrow = ellipsoids(model, ShownHypothesis(X_PO, 1.0, wide, slide), points)
    assert max(ellipsoid.radii.max() for ellipsoid in narrow) < 0.004
    cut = ellipsoids(model, ShownHypothesis(X_PO, 1.0, wide), points)
    assert max(ellipsoid.radii.max() for ellipsoid in cut) == 0.25 * model.size > 0.02
    assert (any(e.is_cut for e in narrow), all(e.is_cut for e in cut)) == (False, True)
    assert ellipsoids(model, ShownHypothesis(X_PO), points) == []


def test_a_turn_is_drawn_about_its_axis_and_outside_of_the_object(model: ObjectModel) -> None:
    # About a line along the object's z through (10, 5) mm.
    through, axis = np.array([0.01, 0.005, 0.0]), np.array([0.0, 0.0, 1.0])
    v_P = X_PO.rotation() @ np.cross(through, axis)
    (arrow,) = free_arrows(model, ShownHypothesis(X_PO, free_directions=np.concatenate([axis, v_P])[None]))
    assert arrow.is_turn
    assert arrow.name == "turn about the object's z"
    X_OA = X_PO.inverse() @ arrow.X_PA
    np.testing.assert_allclose(X_OA.translation()[:2], through[:2], atol=1e-9)
    np.testing.assert_allclose(X_OA.rotation().matrix()[:, 2], axis, atol=1e-9)
    assert arrow.scale > np.hypot(0.04, 0.045)


def test_where_an_object_has_its_origin_changes_nothing_of_what_is_drawn(model: ObjectModel) -> None:
    middle = np.array([2.0, -0.5, 1.0])
    far = ObjectModel.from_mesh(trimesh.creation.box((0.06, 0.08, 0.1)).apply_translation(middle), cache=False)
    R_PO = X_PO.rotation().matrix()
    z, nothing = np.array([0.0, 0.0, 1.0]), np.zeros(3)
    turn, slide = np.concatenate([z, nothing]), np.concatenate([nothing, R_PO @ z])
    covariance = np.diag(np.square([0.02, 0.03, 0.4, 0.001, 0.002, 0.003])) + 1e-3 * np.outer(slide, slide)
    own = GaussianMixture(X_PO.GetAsMatrix34()[None], np.ones(1), covariance[None])
    of_origin = mixture_of_origin(own, middle)
    free = np.stack([turn, slide])
    shown = ShownHypothesis(X_PO, 1.0, covariance, free)
    moved = directions_of_origin(free, R_PO, middle)
    of_far = ShownHypothesis(RigidTransform(of_origin.X_PO[0]), 1.0, of_origin.covariance[0], moved)
    for arrow, other in zip(free_arrows(model, shown), free_arrows(far, of_far), strict=True):
        assert other.name == arrow.name
        assert other.scale == pytest.approx(arrow.scale)
        np.testing.assert_allclose(other.X_PA.translation(), arrow.X_PA.translation(), atol=1e-9)
        axis, other_axis = (X.rotation().matrix()[:, 2] for X in (arrow.X_PA, other.X_PA))
        assert abs(axis @ other_axis) == pytest.approx(1.0)
    points = shown_points(model)
    for ellipsoid, other in zip(
        ellipsoids(model, shown, points), ellipsoids(far, of_far, points + middle), strict=True
    ):
        np.testing.assert_allclose(other.radii, ellipsoid.radii, rtol=1e-5)
        np.testing.assert_allclose(other.X_OE.translation(), ellipsoid.X_OE.translation() + middle, atol=1e-9)


def test_a_slide_is_drawn_along_it_and_sticks_out(model: ObjectModel) -> None:
    direction = np.concatenate([np.zeros(3), X_PO.rotation() @ np.array([0.0, 1.0, 0.0])])
    (arrow,) = free_arrows(model, ShownHypothesis(X_PO, free_directions=direction[None]))
    assert not arrow.is_turn
    ends = X_PO.inverse().multiply(arrow.p_PQ.T).T
    np.testing.assert_allclose(np.sort(ends[:, 1]), [-arrow.scale / 2, arrow.scale / 2], atol=1e-9)
    assert arrow.scale > 0.085


def test_where_next_to_all_is_free_no_arrow_is_drawn(model: ObjectModel) -> None:
    assert len(free_arrows(model, ShownHypothesis(X_PO, free_directions=np.eye(6)[:3]))) == 3
    assert free_arrows(model, ShownHypothesis(X_PO, free_directions=np.eye(6)[:4])) == []
