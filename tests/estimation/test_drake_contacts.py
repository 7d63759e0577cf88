"""Contacts that a simulation reports, against what geometry says: balls in a palm of two walls."""

import subprocess
import sys

import numpy as np
import pytest
from pydrake.geometry import AddCompliantHydroelasticProperties, AddContactMaterial, Box, ProximityProperties, Sphere
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import AddMultibodyPlant, CoulombFriction, MultibodyPlant, MultibodyPlantConfig
from pydrake.multibody.tree import RigidBody, SpatialInertia
from pydrake.systems.framework import Context, Diagram, DiagramBuilder

import tactopose_drake as tp
from tactopose_drake.errors import InvalidInputError

RADIUS, DEPTH = 0.03, 0.001
X_WPALM = RigidTransform(RollPitchYaw(0.3, -0.5, 1.0), [1.0, -2.0, 0.5])


def material() -> ProximityProperties:
    properties = ProximityProperties()
    AddCompliantHydroelasticProperties(resolution_hint=0.005, hydroelastic_modulus=1e7, properties=properties)
    AddContactMaterial(dissipation=1.0, friction=CoulombFriction(0.5, 0.5), properties=properties)
    return properties


def pressed(contact_model: str, object_first: bool) -> tuple[Diagram, MultibodyPlant, Context, RigidBody, Context]:
    """A ball between two walls at +-x of the palm, pressed by DEPTH into each; and a floor that is not the hand's."""
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlant(MultibodyPlantConfig(time_step=1e-3, contact_model=contact_model), builder)

    def add_ball() -> RigidBody:
        ball = plant.AddRigidBody(
            "ball", plant.AddModelInstance("ball"), SpatialInertia.SolidSphereWithMass(0.1, RADIUS)
        )
        plant.RegisterCollisionGeometry(ball, RigidTransform(), Sphere(RADIUS), "ball", material())
        return ball

    def add_palm() -> RigidBody:
        palm = plant.AddRigidBody("palm", plant.AddModelInstance("hand"), SpatialInertia.SolidSphereWithMass(0.1, 0.1))
        for name, side in (("left", -1.0), ("right", 1.0)):
            X = RigidTransform([side * (RADIUS + 0.05 - DEPTH), 0.0, 0.0])
            plant.RegisterCollisionGeometry(palm, X, Box(0.1, 0.1, 0.1), name, material())
        plant.WeldFrames(plant.world_frame(), palm.body_frame(), X_WPALM)
        return palm

    ball = add_ball() if object_first else None
    add_palm()
    ball = add_ball() if ball is None else ball
    X_WFloor = X_WPALM @ RigidTransform([0.0, 0.0, -RADIUS - 0.05 + DEPTH])
    plant.RegisterCollisionGeometry(plant.world_body(), X_WFloor, Box(0.02, 0.02, 0.1), "floor", material())
    plant.Finalize()
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    plant_context = plant.GetMyMutableContextFromRoot(context)
    plant.SetFreeBodyPose(plant_context, ball, X_WPALM)
    diagram.ExecuteForcedEvents(context)  # One step's contacts.
    return diagram, plant, plant_context, ball, context


@pytest.mark.parametrize("object_first", [True, False])
@pytest.mark.parametrize("contact_model", ["hydroelastic", "point"])
def test_contacts_are_where_the_walls_are_and_point_out_of_the_object(contact_model: str, object_first: bool) -> None:
    _, plant, plant_context, ball, _ = pressed(contact_model, object_first)
    results = plant.get_contact_results_output_port().Eval(plant_context)
    palm = plant.GetFrameByName("palm")
    touch = tp.Contacts.from_contact_results(results, plant, plant_context, palm, ball, sigma_position=0.002)
    assert isinstance(touch, tp.Contacts)
    order = np.argsort(touch.p_PC[:, 0])
    assert len(touch) == 2  # not the floor's
    sides = np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    np.testing.assert_allclose(touch.p_PC[order], (RADIUS - DEPTH / 2) * sides, atol=2 * DEPTH)
    np.testing.assert_allclose(touch.n_PC[order], sides, atol=1e-2)
    push = np.einsum("ij,ij->i", touch.f_PC[order], sides)
    assert np.all(push > 1.0)  # The object pushes the walls apart.
    np.testing.assert_allclose(push[0], push[1], rtol=0.05)
    np.testing.assert_array_equal(touch.sigma_position, 0.002)


def test_the_centre_of_pressure_of_a_lopsided_patch_is_the_mean_by_pressure() -> None:
    """A ball over the edges of the walls, whose patches are integrated exactly: the field is linear in each face."""
    diagram, plant, plant_context, ball, context = pressed("hydroelastic", True)
    plant.SetFreeBodyPose(plant_context, ball, X_WPALM @ RigidTransform([0.0, 0.048, 0.0]))
    diagram.ExecuteForcedEvents(context)
    results = plant.get_contact_results_output_port().Eval(plant_context)
    palm = plant.GetFrameByName("palm")
    touch = tp.Contacts.from_contact_results(results, plant, plant_context, palm, ball)
    assert len(touch) == results.num_hydroelastic_contacts() == 2
    p_WC = X_WPALM.multiply(touch.p_PC.T).T
    for i in range(2):
        surface = results.hydroelastic_contact_info(i).contact_surface()
        mesh, field = surface.poly_mesh_W(), surface.poly_e_MN()
        total, moment = 0.0, np.zeros(3)
        for face in range(surface.num_faces()):
            element = mesh.element(face)
            corners = np.array([mesh.vertex(element.vertex(k)) for k in range(element.num_vertices())])
            for k in range(1, len(corners) - 1):
                a, b, c = corners[[0, k, k + 1]]
                area = 0.5 * np.linalg.norm(np.cross(b - a, c - a))
                for p in (0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + a)):  # exact for squares
                    weight = area / 3.0 * field.EvaluateCartesian(face, p)
                    total, moment = total + weight, moment + weight * p
        assert np.linalg.norm(p_WC - moment / total, axis=1).min() < 1e-4
        assert np.linalg.norm(surface.centroid() - moment / total) > 4e-4  # by area alone it would be elsewhere


def test_an_object_that_touches_nothing_has_no_contacts() -> None:
    diagram, plant, plant_context, ball, context = pressed("point", True)
    plant.SetFreeBodyPose(plant_context, ball, RigidTransform([9.0, 9.0, 9.0]))
    diagram.ExecuteForcedEvents(context)
    results = plant.get_contact_results_output_port().Eval(plant_context)
    assert len(tp.Contacts.from_contact_results(results, plant, plant_context, plant.GetFrameByName("palm"), ball)) == 0


def test_something_else_is_refused() -> None:
    _, plant, plant_context, ball, _ = pressed("point", True)
    with pytest.raises(InvalidInputError, match="results must be a ContactResults, not a list"):
        tp.Contacts.from_contact_results([], plant, plant_context, plant.GetFrameByName("palm"), ball)


def test_contacts_that_are_given_load_no_simulator() -> None:
    code = "import sys, tactopose_drake as tp; tp.Contacts([[0.0, 0.0, 0.1]]); print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert "tactopose_drake.estimation.drake_contacts" in loaded
    assert not {"pydrake.multibody", "pydrake.geometry", "pydrake.systems"} & set(loaded)
