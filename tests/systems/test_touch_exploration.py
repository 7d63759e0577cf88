import pytest
from pydrake.systems.framework import DiagramBuilder

from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.errors import InvalidInputError
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


def test_touches_of_several_instants_do_not_balance() -> None:
    params = TouchExplorationParams(estimator=PoseEstimatorParams(balance=True))
    with pytest.raises(InvalidInputError, match="balance must be False, not True"):
        params.validate()
