"""What a hand's file leaves open of its contact is filled in; what it says stays."""

from pathlib import Path

import pytest
import trimesh
from pydrake.geometry import AddRigidHydroelasticProperties, Convex, Mesh, ProximityProperties, Role, Sphere
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder

from tactopose_drake.errors import InvalidInputError
from tactopose_drake.hand import let_overlap, make_compliant
from tactopose_drake.hand.contact_properties import (
    leave_friction_out,
    make_meshes_rigid,
    rigid_shapes,
    self_collisions,
    unsaid_shapes,
)
from tactopose_drake.hand.hand_config import load_hand_config
from tactopose_drake.hand.hand_in_plant import add_hand
from tactopose_drake.resources import add_model, make_parser
from tests.hand.grippers import write_gripper

SOFT = """<drake:proximity_properties><drake:compliant_hydroelastic/>
<drake:hydroelastic_modulus value="2e5"/><drake:mesh_resolution_hint value="0.003"/>
<drake:mu_static value="0.3"/></drake:proximity_properties>"""


def test_what_is_not_said_becomes_compliant_and_what_is_said_stays(tmp_path: Path) -> None:
    path = write_gripper(tmp_path, property=SOFT)
    trimesh.creation.box((0.02, 0.02, 0.02)).export(tmp_path / "block.obj")
    model = tmp_path / "two_finger.urdf"
    model.write_text(model.read_text().replace('<box size="0.12 0.04 0.02"/>', '<mesh filename="block.obj"/>'))
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.001)
    hand = add_hand(plant, load_hand_config(path), RigidTransform())
    inspector = scene_graph.model_inspector()
    assert unsaid_shapes(plant, inspector, hand.model_instance) == ["base"]
    make_compliant(plant, scene_graph, hand.model_instance)
    plant.Finalize()

    shapes = {}
    for index in plant.GetBodyIndices(hand.model_instance):
        for geometry in inspector.GetGeometries(plant.GetBodyFrameIdOrThrow(index), Role.kProximity):
            properties = inspector.GetProximityProperties(geometry)
            modulus = properties.GetProperty("hydroelastic", "hydroelastic_modulus")
            friction = properties.GetProperty("material", "coulomb_friction").static_friction()
            shapes[plant.get_body(index).name()] = type(inspector.GetShape(geometry)), modulus, friction
    assert shapes["base"] == (Convex, pytest.approx(3e7), pytest.approx(1.0))  # Drake's own friction
    assert shapes["left_tip"][1:] == (pytest.approx(2e5), pytest.approx(0.3))
    assert Mesh not in [kind for kind, _, _ in shapes.values()]
    builder.Build()


def test_a_context_adds_nothing_to_what_is_said_of_measured_shapes() -> None:
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.001)
    leave_friction_out(scene_graph)
    rigid = ProximityProperties()
    AddRigidHydroelasticProperties(0.01, rigid)
    ball = plant.RegisterCollisionGeometry(plant.world_body(), RigidTransform(), Sphere(0.01), "ball", rigid)
    plant.Finalize()
    context = builder.Build().CreateDefaultContext()
    inspector = scene_graph.get_query_output_port().Eval(scene_graph.GetMyContextFromRoot(context)).inspector()
    # For what is added the shape would be faceted anew.
    assert str(inspector.GetProximityProperties(ball)) == str(rigid)


def test_what_overlaps_at_rest_passes_through_itself(tmp_path: Path) -> None:
    path = write_gripper(tmp_path)
    model = tmp_path / "two_finger.urdf"
    model.write_text(model.read_text().replace('xyz="0.06 0 0.1"', 'xyz="-0.05 0 0.1"'))
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.001)
    hand = add_hand(plant, load_hand_config(path), RigidTransform())
    plant.Finalize()
    diagram = builder.Build()

    def overlaps() -> list[tuple[str, str]]:
        return self_collisions(plant, plant.GetMyContextFromRoot(diagram.CreateDefaultContext()), hand.model_instance)

    assert overlaps() == [("left_tip", "right_tip")]
    root = diagram.CreateDefaultContext()
    with pytest.raises(InvalidInputError, match=r"^context must be the plant's, as plant\.GetMyContextFromRoot"):
        let_overlap(plant, scene_graph, root, hand.model_instance)
    with pytest.raises(InvalidInputError, match=r"^instance must be a ModelInstanceIndex, not a Hand"):
        let_overlap(plant, scene_graph, plant.GetMyContextFromRoot(root), hand)  # type: ignore[arg-type]
    let_overlap(plant, scene_graph, plant.GetMyContextFromRoot(diagram.CreateDefaultContext()), hand.model_instance)
    assert overlaps() == []


def test_an_object_s_mesh_becomes_rigid_unless_its_file_says_otherwise(tmp_path: Path) -> None:
    trimesh.creation.box((0.02, 0.02, 0.02)).export(tmp_path / "block.obj")
    mesh = "<geometry><mesh><uri>block.obj</uri></mesh></geometry>"
    ball = "<geometry><sphere><radius>0.01</radius></sphere></geometry>"
    shapes = f'<collision name="mesh">{mesh}</collision><collision name="ball">{ball}</collision>'
    (tmp_path / "block.sdf").write_text(
        f'<sdf version="1.9"><model name="block"><link name="block">{shapes}</link></model></sdf>'
    )
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.001)
    instance = add_model(make_parser(plant), tmp_path / "block.sdf")
    make_meshes_rigid(plant, scene_graph, instance)
    plant.Finalize()
    inspector = scene_graph.model_inspector()
    assert rigid_shapes(plant, inspector, instance) == ["'mesh' of link 'block'"]
    assert unsaid_shapes(plant, inspector, instance) == ["block"]  # the ball, which the station makes compliant
    builder.Build()
