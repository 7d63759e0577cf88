import math

import numpy as np
import pytest
import trimesh

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.objectives.friction_cone import FrictionCone
from tactopose_drake.core.poses import exp_so3, make_poses, retract
from tactopose_drake.core.shape.object_model import ObjectModel
from tests.core.objectives.laws import check_derivatives

RADIUS = 0.04
IDENTITY = np.eye(3, 4)[None]


@pytest.fixture(scope="module")
def ball() -> ObjectModel:
    return ObjectModel.from_mesh(trimesh.creation.icosphere(subdivisions=4, radius=RADIUS))


def leaning(degrees: float) -> np.ndarray:
    """A force of 2 N that leans from x."""
    return 2.0 * np.array([math.cos(math.radians(degrees)), 0.6 * math.sin(math.radians(degrees)), 0.0]) + np.array(
        [0.0, 0.0, 1.6 * math.sin(math.radians(degrees))]
    )


def test_a_force_costs_what_it_leans_beyond_the_cone(ball: ObjectModel) -> None:
    degrees = [0.0, 20.0, 44.0, 50.0, 90.0, 135.0]
    contacts = Contacts(
        np.tile([RADIUS, 0.0, 0.0], (6, 1)), f_PC=[leaning(a) for a in degrees], sigma_normal=0.1, sigma_force=0.2
    )
    residuals = FrictionCone(ball.grid, contacts, friction=1.0).residuals(IDENTITY)[0]
    # Noise of the normal, and of a force of 2 N: 0.1 rad each.
    expected = np.radians(np.maximum(np.array(degrees) - 45.0, 0.0)) / math.hypot(0.1, 0.1)
    np.testing.assert_allclose(residuals, expected, rtol=0.03)


def test_a_pull_costs_most(ball: ObjectModel) -> None:
    degrees = np.linspace(50.0, 180.0, 14)
    contacts = Contacts(np.tile([RADIUS, 0.0, 0.0], (14, 1)), f_PC=[leaning(a) for a in degrees])
    assert np.all(np.diff(FrictionCone(ball.grid, contacts, 0.5).residuals(IDENTITY)[0]) > 0.0)


def test_without_friction_every_force_is_along_the_normal(ball: ObjectModel) -> None:
    contacts = Contacts([[RADIUS, 0.0, 0.0]], f_PC=[leaning(30.0)])
    assert FrictionCone(ball.grid, contacts, 0.0).cost(IDENTITY)[0] > 5.0


def test_a_force_that_is_noise_says_nothing(ball: ObjectModel) -> None:
    contacts = Contacts(
        np.tile([RADIUS, 0.0, 0.0], (3, 1)), f_PC=[[0.0, 0.0, 0.0], [-0.04, 0.0, 0.0], [-1.0, 0.0, 0.0]]
    )
    residuals = FrictionCone(ball.grid, contacts, 0.5).residuals(IDENTITY)
    assert residuals.shape == (1, 1)
    assert residuals[0, 0] > 10.0


def test_an_edge_allows_more_forces_than_a_face() -> None:
    box = ObjectModel.from_mesh(trimesh.creation.box((0.08, 0.08, 0.08)).subdivide().subdivide())
    f_PC = np.tile([1.0, 0.0, 2.0], (2, 1))
    contacts = Contacts([[0.04, 0.0, 0.0], [0.04, 0.0, 0.04]], f_PC=f_PC)
    face, edge = FrictionCone(box.grid, contacts, 0.1).residuals(IDENTITY)[0]
    assert face > 10.0
    assert edge < 1.0


@pytest.mark.parametrize("angle", [0.0, 1e-8, 1.0, np.pi])
def test_the_derivatives_are_exact(blob: ObjectModel, angle: float) -> None:
    generator = np.random.default_rng(3)
    p_PC, f_PC = generator.normal(size=(2, 8, 3))
    contacts = Contacts(0.04 * p_PC, f_PC=f_PC)
    turned = make_poses(exp_so3(angle * np.array([[0.36, -0.48, 0.8]])), generator.normal(size=(1, 3)) * 0.01)
    cone = FrictionCone(blob.grid, contacts, 0.3)
    X_PO = retract(turned, generator.normal(size=(20, 6)) * 0.02)
    assert np.all(np.count_nonzero(cone.residuals(X_PO), axis=1) >= 2)
    check_derivatives(cone, X_PO)
