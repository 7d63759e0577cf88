"""Other people's hands on an arm: what their files leave out is given to them as it is without one."""

from pathlib import Path

import numpy as np
import pytest
from pydrake.common.schema import Transform
from pydrake.common.value import AbstractValue
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder, OutputPort
from pydrake.systems.primitives import ConstantValueSource, ConstantVectorSource

from tactopose_drake.core.grasping.grasp_plan import GraspPlan
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.estimation.prior import PosePrior
from tactopose_drake.hand.contact_properties import self_collisions
from tactopose_drake.station.arms.arm_station import ArmParts, ArmSetup, ArmStation, make_arm_station
from tactopose_drake.station.automatic_scenario import scenario_for
from tactopose_drake.station.grasp_planning import plan_scenario
from tactopose_drake.station.scenario import Grip, Scenario
from tactopose_drake.station.simulated import make_station
from tactopose_drake.systems.pose_tracking import PoseTrackingParams
from tactopose_drake.systems.touch_exploration import TouchExplorationParams
from tests.hand.grippers import write_gripper


def stay(builder: DiagramBuilder, parts: ArmParts) -> OutputPort:
    prior = builder.AddSystem(ConstantValueSource(AbstractValue.Make(PosePrior(np.eye(3, 4)))))
    builder.Connect(prior.get_output_port(), parts.estimation.GetInputPort("prior"))
    q = np.array(ArmSetup().q_start)
    return builder.AddSystem(ConstantVectorSource(np.concatenate([q, 0.0 * q]))).get_output_port()


def on_arm(scenario: Scenario, plan: GraspPlan, model: ObjectModel) -> ArmStation:
    return make_arm_station(scenario, plan, ArmSetup(X_FBase=Transform()), stay, model=model)


def test_a_gripper_whose_file_says_nothing_of_contact_holds_an_object(tmp_path: Path) -> None:
    scenario = scenario_for(str(write_gripper(tmp_path)), "cube")
    model = scenario.object_model()
    plan = plan_scenario(scenario, model)[0]
    station = on_arm(scenario, plan, model)
    simulator = Simulator(station.diagram)
    context = simulator.get_mutable_context()
    station.start(context)
    simulator.set_monitor(station.release_when_held)
    simulator.Initialize()
    simulator.AdvanceTo(1.5)
    assert station.diagram.GetOutputPort("holding").Eval(context)[0] == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("name", "part"), [("grip", Grip(X_PO={"cube": Transform()})), ("exploration", TouchExplorationParams())]
)
def test_what_an_arm_s_station_does_not_do_is_refused(name: str, part: object) -> None:
    scenario = Scenario(object="cube", **{name: part})
    with pytest.raises(InvalidInputError, match=rf"^Scenario\.{name} must be None on an arm"):
        make_arm_station(scenario, GraspPlan(np.eye(3, 4), {}, 0.0), ArmSetup(), stay)


def test_a_scenario_s_belief_over_time_is_kept_on_an_arm_too() -> None:
    scenario = Scenario(object="cube", tracking=PoseTrackingParams())
    station = make_arm_station(scenario, GraspPlan(np.eye(3, 4), {}, 0.0), ArmSetup(), stay)
    assert station.diagram.HasSubsystemNamed("pose_tracking")
    assert not station.diagram.HasSubsystemNamed("pose_estimation")


def test_links_that_overlap_at_rest_pass_through_each_other_with_an_arm_and_without(tmp_path: Path) -> None:
    path = write_gripper(tmp_path)
    urdf = tmp_path / "two_finger.urdf"
    pin = '<collision><origin xyz="-0.06 0 0.1"/><geometry><sphere radius="0.004"/></geometry></collision>'
    urdf.write_text(urdf.read_text().replace('<link name="base">', f'<link name="base">{pin}'))
    scenario = scenario_for(str(path), "cube")
    model = scenario.object_model()
    plan = plan_scenario(scenario, model)[0]
    for station in (make_station(scenario, plan, model=model), on_arm(scenario, plan, model)):
        context = station.plant.GetMyContextFromRoot(station.diagram.CreateDefaultContext())
        assert self_collisions(station.plant, context, station.hand.model_instance) == []
