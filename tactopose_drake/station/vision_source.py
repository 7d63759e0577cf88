"""The vision source of a simulated station."""

from pydrake.geometry import SceneGraph
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import RigidBody
from pydrake.systems.framework import DiagramBuilder, OutputPort

from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.hand.hand_in_plant import Hand
from tactopose_drake.resources import fixed_pose
from tactopose_drake.station.scenario import Scenario
from tactopose_drake.systems.camera_view import CameraView
from tactopose_drake.systems.depth_camera import AddDepthCamera
from tactopose_drake.systems.depth_tracker import DepthTracker, DepthTrackerParams
from tactopose_drake.systems.simulated_vision import SimulatedVision


def add_vision(
    builder: DiagramBuilder,
    scenario: Scenario,
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    hand: Hand,
    object_body: RigidBody,
    model: ObjectModel,
) -> OutputPort:
    """Adds the scenario's vision source as the system `vision`, and exports its outputs.

    Args:
        builder: the station's builder.
        scenario: the scenario.
        plant: finalized plant with hand and object.
        scene_graph: its SceneGraph.
        hand: the hand in the plant.
        object_body: the object in the plant.
        model: the object's model for estimation.

    Returns:
        The port for the input `vision` of the tracking.
    """
    view = CameraView(
        plant=plant,
        inspector=scene_graph.model_inspector(),
        object_body=object_body,
        object_model=model,
        palm_frame=hand.palm_frame,
        X_WC=fixed_pose("Scenario.X_WC", scenario.X_WC),
    )
    if isinstance(scenario.vision, DepthTrackerParams):
        vision = builder.AddNamedSystem("vision", DepthTracker(view, params=scenario.vision))
        image = AddDepthCamera(builder, scene_graph, view.X_WC, scenario.vision.camera)
        builder.Connect(image, vision.GetInputPort("depth_image"))
        seen = vision.GetOutputPort("vision")
    else:
        tails = None if scenario.errors is None else scenario.errors.vision_degrees_of_freedom
        vision = builder.AddNamedSystem("vision", SimulatedVision(view, scenario.vision, tails))
        seen = vision.GetOutputPort("prior")
    builder.Connect(plant.get_body_poses_output_port(), vision.GetInputPort("body_poses"))
    for name in ("prior", "hidden_share"):
        builder.ExportOutput(vision.GetOutputPort(name), name)
    return seen
