import numpy as np
import pytest
import scipy.spatial
import trimesh

from tactopose_drake.core.evidence.plane_contact import PlaneContact
from tactopose_drake.core.objectives.plane_support import PlaneSupport
from tactopose_drake.core.poses import compose, exp_so3, make_poses, random_rotations, transform_points
from tactopose_drake.core.shape.object_model import ObjectModel
from tests.core.objectives.laws import check_derivatives

SIGMA = 0.002


@pytest.fixture(scope="module")
def rod() -> ObjectModel:
    """A cone of 20 mm radius on a table, its tip 100 mm up."""
    return ObjectModel.from_mesh(
        trimesh.creation.cone(radius=0.02, height=0.1, sections=48), symmetry="none", samples=200
    )


def table(height: float = 0.0, sigma: float = SIGMA) -> PlaneContact:
    return PlaneContact(np.array([0.3, -0.2, height]), np.array([0.0, 0.0, 1.0]), sigma)


def test_the_residual_is_how_far_the_lowest_point_is_from_the_plane(rod: ObjectModel) -> None:
    upside_down = make_poses(exp_so3(np.array([np.pi, 0.0, 0.0])), np.array([0.0, 0.0, 0.1]))
    leaning = make_poses(exp_so3(np.array([0.3, 0.0, 0.0])), np.zeros(3))
    X_PO = np.stack([np.eye(3, 4), upside_down, leaning])
    support = PlaneSupport(rod, [table(0.01), table(-0.03, 0.001)])
    lowest = np.array([0.0, 0.0, -0.02 * np.sin(0.3)])
    np.testing.assert_allclose(support.residuals(X_PO)[:, 0], (lowest - 0.01) / SIGMA, atol=0.05)
    np.testing.assert_allclose(support.residuals(X_PO)[:, 1], (lowest + 0.03) / 0.001, atol=0.1)
    np.testing.assert_allclose(support.cost(X_PO), 0.5 * np.square(support.residuals(X_PO)).sum(axis=1))


def test_the_hull_is_found_once_for_an_object(monkeypatch: pytest.MonkeyPatch) -> None:
    model = ObjectModel.from_box([0.03, 0.04, 0.05], samples=200)
    first = PlaneSupport(model, [table()]).residuals(np.eye(3, 4)[None])
    monkeypatch.setattr(scipy.spatial, "ConvexHull", None)
    assert PlaneSupport(model, [table()]).residuals(np.eye(3, 4)[None]) == first == pytest.approx(-0.025 / SIGMA)


def test_derivatives(rod: ObjectModel) -> None:
    generator = np.random.default_rng(0)
    X_PO = make_poses(random_rotations(generator, 12), generator.uniform(-0.1, 0.1, (12, 3)))
    wall = PlaneContact(np.array([0.2, 0.0, 0.0]), np.array([-0.6, 0.8, 0.0]), 0.001)
    check_derivatives(PlaneSupport(rod, [table(0.05), wall]), X_PO)


def test_the_frame_does_not_matter(rod: ObjectModel) -> None:
    generator = np.random.default_rng(1)
    X_PO = make_poses(random_rotations(generator, 5), generator.uniform(-0.1, 0.1, (5, 3)))
    X_QP = make_poses(random_rotations(generator, 1), generator.uniform(-0.1, 0.1, (1, 3)))
    plane = table(0.02)
    moved = PlaneContact(transform_points(X_QP, plane.p_PQ[None])[0, 0], X_QP[0, :, :3] @ plane.n_P, SIGMA)
    np.testing.assert_allclose(
        PlaneSupport(rod, [moved]).residuals(compose(X_QP, X_PO)), PlaneSupport(rod, [plane]).residuals(X_PO), atol=1e-9
    )
