"""The belief over time in a station with simulated or real senses."""

from collections.abc import Mapping

from pydrake.systems.framework import Diagram, DiagramBuilder, OutputPort

from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.hand.hand_config import HandConfig
from tactopose_drake.systems.pose_tracking import AddPoseTracking, PoseTrackingParams

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
    for name, port in known.items():
        if tracking.HasInputPort(name):
            builder.Connect(port, tracking.GetInputPort(name))
    for name in (*_SHOWN, *(("object_pose_in_world",) if "palm_pose" in known else ())):
        builder.ExportOutput(tracking.GetOutputPort(name), f"tracked_{name}")
    return tracking
