"""The exploration by touch in a simulated station."""

from pydrake.systems.framework import Diagram, DiagramBuilder, OutputPort

from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.hand.hand_config import HandConfig
from tactopose_drake.systems.ports import export_outputs
from tactopose_drake.systems.touch_exploration import AddTouchExploration, TouchExplorationParams


def add_exploration(
    builder: DiagramBuilder,
    params: TouchExplorationParams,
    hand: HandConfig,
    model: ObjectModel,
    joint_positions: OutputPort,
) -> Diagram:
    """Adds the exploration, and exports its outputs as `explored_object_pose` and so on.

    Args:
        builder: the station's builder, which has "pose_estimation", "vision" and "grasp_controller".
        params: parameters of each part.
        hand: the hand.
        model: the object.
        joint_positions: port of the measured joint positions.

    Returns:
        The exploration's diagram.
    """
    exploration = AddTouchExploration(builder, hand, model, params)
    estimation, vision, controller = (
        builder.GetSubsystemByName(name) for name in ("pose_estimation", "vision", "grasp_controller")
    )
    for name, port in (
        *((name, estimation.GetOutputPort(name)) for name in ("contacts", "fingers_in_contact")),
        ("joint_positions", joint_positions),
        ("holding", controller.GetOutputPort("holding")),
        ("prior", vision.GetOutputPort("prior")),
    ):
        builder.Connect(port, exploration.GetInputPort(name))
    builder.Connect(exploration.GetOutputPort("rest_positions"), controller.GetInputPort("rest_positions"))
    export_outputs(builder, exploration, "explored_")
    return exploration
