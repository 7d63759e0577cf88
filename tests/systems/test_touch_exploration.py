import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.estimation.prior import PosePrior
from tactopose_drake.hand.hand_config import load_hand_config
from tactopose_drake.resources import model_path
from tactopose_drake.systems.pose_estimator import PoseEstimatorParams
from tactopose_drake.systems.touch_exploration import AddTouchExploration, TouchExplorationParams


def test_the_diagram_has_the_ports_that_it_says() -> None:
    builder = DiagramBuilder()
    model = ObjectModel.from_mesh(model_path("objects", "cube.obj"))
    added = AddTouchExploration(builder, load_hand_config("shadow_like"), model, name="feel_on")
    assert builder.GetSubsystemByName("feel_on") is added
    names = [added.get_input_port(i).get_name() for i in range(added.num_input_ports())]
    assert names == ["contacts", "fingers_in_contact", "joint_positions", "holding", "prior"]
    for name in ("object_pose", "hypotheses", "status", "next_touch", "resolved", "touch_status"):
        assert added.HasOutputPort(name)
    for name in ("rest_positions", "touches", "phase", "count"):
        assert added.HasOutputPort(name)
    assert added.GetOutputPort("rest_positions").size() == 24


def test_an_object_that_was_let_go_resolves_no_later_grasp() -> None:
    model = ObjectModel.from_mesh(model_path("objects", "bust.obj"))
    builder = DiagramBuilder()
    added = AddTouchExploration(builder, load_hand_config("shadow_like"), model)
    simulator = Simulator(builder.Build())
    context = added.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    fingers, rows = ("first", "middle", "ring", "little"), [100, 700, 1300, 1900]
    X_PO = RigidTransform(RollPitchYaw(0.5 * np.pi, 0.0, 0.5 * np.pi), [-0.05, -0.05, 0.065])
    points, normals = model.samples.points[rows], model.samples.normals[rows]
    felt = Contacts(X_PO.multiply(points.T).T, X_PO.rotation().multiply(normals.T).T)
    added.GetInputPort("joint_positions").FixValue(context, np.zeros(24))
    added.GetInputPort("prior").FixValue(context, AbstractValue.Make(PosePrior(X_PO, 0.01, 0.1)))

    def until(time: float, count: int, holding: float) -> tuple[float, str]:
        """Feels so many contacts until a time, s; returns how far the pose is resolved, and the choice's status."""
        added.GetInputPort("contacts").FixValue(context, AbstractValue.Make(felt[np.arange(count)]))
        added.GetInputPort("fingers_in_contact").FixValue(context, AbstractValue.Make(fingers[:count]))
        added.GetInputPort("holding").FixValue(context, [holding])
        simulator.AdvanceTo(time)
        return added.GetOutputPort("resolved").Eval(context)[0], added.GetOutputPort("touch_status").Eval(context)

    assert until(1.0, 4, holding=1.0)[1] == "resolved"
    until(1.5, 0, holding=0.0)
    share, status = until(2.5, 1, holding=1.0)
    assert share == 0.0
    assert status == "held: 1 touch; 2 are needed"


def test_touches_of_several_instants_do_not_balance() -> None:
    params = TouchExplorationParams(estimator=PoseEstimatorParams(balance=True))
    with pytest.raises(InvalidInputError, match="balance must be False, not True"):
        params.validate()
