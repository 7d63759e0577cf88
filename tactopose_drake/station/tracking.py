"""The belief over time and the exploration by touch in a station, beside its estimation."""

from collections.abc import Mapping

from pydrake.systems.framework import Diagram, DiagramBuilder, OutputPort

from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.hand.hand_config import HandConfig
from tactopose_drake.systems.ports import connect_known, export_outputs
from tactopose_drake.systems.pose_tracking import AddPoseTracking, PoseTrackingParams
from tactopose_drake.systems.touch_exploration import AddTouchExploration, TouchExplorationParams

_SHOWN = ("object_pose", "covariance", "hypotheses", "status", "belief")


def add_tracking(
    builder: DiagramBuilder,
    params: PoseTrackingParams,
    hand: HandConfig,
    model: ObjectModel,
    known: Mapping[str, OutputPort],
) -> Diagram:
    """Adds the tracking, and exports its outputs as `tracked_object_pose` and so on.

    Args:
        builder: the station's builder.
        params: parameters of each part.
        hand: the hand.
        model: the object.
        known: the station's ports by the names of `AddPoseTracking`'s inputs; others are ignored. With a `palm_pose`,
            `tracked_object_pose_in_world` is exported, too.

    Returns:
        The tracking's diagram.
    """
    tracking = AddPoseTracking(builder, hand, model, params)
    connect_known(builder, known, tracking)
    for name in (*_SHOWN, *(("object_pose_in_world",) if "palm_pose" in known else ())):
        builder.ExportOutput(tracking.GetOutputPort(name), f"tracked_{name}")
    return tracking


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
    known = {name: estimation.GetOutputPort(name) for name in ("contacts", "fingers_in_contact")}
    known |= {"holding": controller.GetOutputPort("holding"), "prior": vision.GetOutputPort("prior")}
    connect_known(builder, {**known, "joint_positions": joint_positions}, exploration)
    builder.Connect(exploration.GetOutputPort("rest_positions"), controller.GetInputPort("rest_positions"))
    export_outputs(builder, exploration, "explored_")
    return exploration
