"""The shipped objects in Drake: their SDF models parse, are touched where their surface is, and stand."""

import numpy as np
import pytest
from numpy.typing import NDArray
from pydrake.geometry import (
    AddCompliantHydroelasticProperties,
    GeometryInstance,
    HydroelasticContactRepresentation,
    ProximityProperties,
    Sphere,
)
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, ContactModel, MultibodyPlant
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Diagram, DiagramBuilder
from scipy.spatial import cKDTree

from tactopose_drake.resources import resource_root

from .object_files import CATALOGUE, shipped

# Points that only a true, not a convexified, surface offers to a finger (m), with the outward normal there.
CONCAVE_TOUCHES = {
    "mug": {
        "handle from outside": ((0.0755, 0.0, 0.05), (1, 0, 0)),
        "handle from the side": ((0.07, 0.0055, 0.05), (0, 1, 0)),
        "inner wall": ((-0.0365, 0.0, 0.05), (1, 0, 0)),
        "inner floor": ((0.0, 0.0, 0.006), (0, 0, 1)),
    },
    "wine_glass": {"stem": ((0.0043, 0.0, 0.055), (1, 0, 0)), "inside the bowl": ((0.0, 0.0, 0.0845), (0, 0, 1))},
    "soda_can": {"lid below the rim": ((0.0, 0.0, 0.111), (0, 0, 1))},
    "spray_bottle": {"collar under the head": ((0.0, -0.0165, 0.178), (0, -1, 0))},
}


def plant_with(name: str, time_step: float = 0.002, ground: bool = False) -> tuple[Diagram, MultibodyPlant]:
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, time_step)
    parser = Parser(plant)
    parser.package_map().Add("tactopose_drake", str(resource_root()))
    parser.AddModels(url=f"package://tactopose_drake/models/objects/{name}.sdf")
    if ground:
        parser.AddModelsFromString(
            """<sdf version="1.9"><model name="ground"><static>true</static><link name="ground">
            <collision name="top"><pose>0 0 -0.05 0 0 0</pose><geometry><box><size>1 1 0.1</size></box></geometry>
            <drake:proximity_properties><drake:compliant_hydroelastic/>
            <drake:hydroelastic_modulus>1e7</drake:hydroelastic_modulus>
            <drake:mu_dynamic>0.9</drake:mu_dynamic><drake:mu_static>0.9</drake:mu_static>
            </drake:proximity_properties></collision></link></model></sdf>""",
            "sdf",
        )
        plant.set_contact_model(ContactModel.kHydroelastic)
    plant.Finalize()
    return builder.Build(), plant


@pytest.mark.parametrize("name", CATALOGUE)
def test_sdf_parses_with_the_mass_properties_of_the_mesh(name: str) -> None:
    _, plant = plant_with(name)
    body = plant.GetBodyByName(name)
    assert plant.num_bodies() == 2
    assert plant.num_positions() == 7
    inertia = body.default_spatial_inertia()
    mesh = shipped(name)
    assert inertia.IsPhysicallyValid()
    assert inertia.get_mass() == pytest.approx(CATALOGUE[name].mass)
    assert 0.004 < inertia.get_mass() < 1.0
    assert 0.05 < inertia.get_mass() / (1000 * mesh.volume) < 3, "between a paper box and stone"
    assert inertia.get_com() == pytest.approx(mesh.center_mass, abs=2e-6)
    expected = mesh.moment_inertia * inertia.get_mass() / mesh.volume
    about_com = inertia.Shift(inertia.get_com()).CalcRotationalInertia().CopyToFullMatrix3()
    assert about_com == pytest.approx(expected, abs=2e-5 * np.abs(expected).max())


def touch(name: str, point: NDArray[np.float64], normal: NDArray[np.float64]) -> tuple[float, float, float]:
    """Presses a soft sphere of 4 mm radius 0.3 mm deep onto a point of the surface.

    Returns:
        Area of the contact surface (m^2), its distance from the point (m), and the cosine of the angle between its
        normal, out of the object, and the surface's.
    """
    diagram, plant = plant_with(name)
    context = diagram.CreateDefaultContext()
    scene_graph = diagram.GetSubsystemByName("scene_graph")
    scene_context = scene_graph.GetMyMutableContextFromRoot(context)
    instance = GeometryInstance(RigidTransform(point + (4e-3 - 3e-4) * normal), Sphere(4e-3), "finger")
    properties = ProximityProperties()
    AddCompliantHydroelasticProperties(1e-3, 1e6, properties)
    instance.set_proximity_properties(properties)
    source = plant.get_source_id()
    finger = scene_graph.RegisterGeometry(
        scene_context, source, scene_graph.model_inspector().world_frame_id(), instance
    )
    query = scene_graph.get_query_output_port().Eval(scene_context)
    surfaces = query.ComputeContactSurfaces(HydroelasticContactRepresentation.kPolygon)
    best = min(surfaces, key=lambda surface: np.linalg.norm(surface.centroid() - point))
    outward = 1.0 if best.id_M() == finger else -1.0  # its normals point out of N, into M
    areas = np.array([best.area(i) for i in range(best.num_faces())])
    mean_normal = sum(a * best.face_normal(i) for i, a in enumerate(areas)) / areas.sum()
    return (
        best.total_area(),
        float(np.linalg.norm(best.centroid() - point)),
        outward * float(mean_normal @ normal),
    )


@pytest.mark.parametrize(
    ("name", "place"), [(name, place) for name in CONCAVE_TOUCHES for place in CONCAVE_TOUCHES[name]]
)
def test_hollows_and_handles_can_be_touched(name: str, place: str) -> None:
    point, normal = map(np.array, CONCAVE_TOUCHES[name][place])
    assert cKDTree(shipped(name).vertices).query(point)[0] < 0.004, "the place is on the surface"
    area, distance, alignment = touch(name, point, normal.astype(float))
    assert area > 1e-6
    assert distance < 1e-3
    assert alignment > 0.9


@pytest.mark.parametrize("name", CATALOGUE)
def test_contact_surface_where_the_object_is_touched(name: str) -> None:
    mesh = shipped(name)
    height = mesh.vertices[:, 2] / mesh.extents[2]
    widest = np.argmax(np.where((height > 0.3) & (height < 0.6), mesh.vertices[:, 1], -np.inf))
    area, distance, alignment = touch(name, mesh.vertices[widest], mesh.vertex_normals[widest])
    assert area > 1e-7
    assert distance < 1e-3
    assert alignment > 0.9


@pytest.mark.parametrize("name", CATALOGUE)
def test_object_dropped_on_the_ground_comes_to_rest_on_it(name: str) -> None:
    diagram, plant = plant_with(name, ground=True)
    simulator = Simulator(diagram)
    context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    body = plant.GetBodyByName(name)
    plant.SetFreeBodyPose(context, body, RigidTransform([0, 0, 0.005]))
    simulator.AdvanceTo(0.4)
    X_WO = plant.EvalBodyPoseInWorld(context, body)
    assert abs(X_WO.translation()[2]) < 1e-3
    assert X_WO.rotation().matrix()[2, 2] > np.cos(0.02)
    results = plant.get_contact_results_output_port().Eval(context)
    assert results.num_point_pair_contacts() == 0
    lift = sum(
        abs(results.hydroelastic_contact_info(i).F_Ac_W().translational()[2])
        for i in range(results.num_hydroelastic_contacts())
    )
    assert lift == pytest.approx(9.81 * CATALOGUE[name].mass, rel=0.03)
