import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from tactopose_drake.core.objects import ObjectModel
from tactopose_drake.core.prior import PosePrior
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.hand import load_hand_config
from tactopose_drake.systems.pose_belief import PoseBeliefParams
from tactopose_drake.systems.pose_tracking import AddPoseTracking, PoseTrackingParams
from tests.core.tracking.boxes import make_box


@pytest.fixture(scope="module")
def box() -> ObjectModel:
    return make_box()


@pytest.mark.parametrize("hand", ["shadow_like", "barrett_like"])
def test_a_hand_that_feels_nothing_knows_what_vision_says(box: ObjectModel, hand: str) -> None:
    config, builder = load_hand_config(hand), DiagramBuilder()
    tracking = AddPoseTracking(builder, config, box)
    diagram = builder.Build()
    simulator = Simulator(diagram)
    context = tracking.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    for index in range(tracking.num_input_ports()):
        port = tracking.get_input_port(index)
        name = port.get_name()
        if name.startswith(("wrench_", "joint_", "pressures_")):
            port.FixValue(context, np.zeros(port.size()))
    # Out of the hand's reach, so that its volume does not move it.
    X_PO, X_WP = RigidTransform([0.0, -0.5, 0.0]), RigidTransform([1.0, 0.0, 0.0])
    tracking.GetInputPort("palm_pose").FixValue(context, AbstractValue.Make(X_WP))
    simulator.AdvanceTo(0.02)
    assert tracking.GetOutputPort("status").Eval(context) == "lost: nothing is touched"
    tracking.GetInputPort("vision").FixValue(context, AbstractValue.Make(PosePrior(X_PO)))
    simulator.AdvanceTo(0.05)
    assert tracking.GetOutputPort("status").Eval(context) == "no_contact"
    assert tracking.GetOutputPort("object_pose").Eval(context).IsNearlyEqualTo(X_PO, 1e-9)
    assert tracking.GetOutputPort("object_pose_in_world").Eval(context).IsNearlyEqualTo(X_WP @ X_PO, 1e-9)


def test_parameters_out_of_range_are_refused(box: ObjectModel) -> None:
    with pytest.raises(InvalidInputError, match="latency"):
        AddPoseTracking(
            DiagramBuilder(),
            load_hand_config("shadow_like"),
            box,
            PoseTrackingParams(belief=PoseBeliefParams(latency=-1.0)),
        )
