"""Other people's hands on an arm: what their files leave out is given to them as it is without one."""

from pathlib import Path

import numpy as np
import pytest
from pydrake.common.schema import Transform
from pydrake.common.value import AbstractValue
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder, OutputPort
from pydrake.systems.primitives import ConstantValueSource, ConstantVectorSource

from tactopose_drake.estimation.prior import PosePrior
from tactopose_drake.station.arms.station import ArmParts, ArmSetup, make_arm_station
from tactopose_drake.station.grasp_planning import plan_scenario
from tactopose_drake.station.own_hand import scenario_for
from tests.hand.grippers import write_gripper


def stay(builder: DiagramBuilder, parts: ArmParts) -> OutputPort:
    prior = builder.AddSystem(ConstantValueSource(AbstractValue.Make(PosePrior(np.eye(3, 4)))))
    builder.Connect(prior.get_output_port(), parts.estimation.GetInputPort("prior"))
    q = np.array(ArmSetup().q_start)
    return builder.AddSystem(ConstantVectorSource(np.concatenate([q, 0.0 * q]))).get_output_port()


def test_a_gripper_whose_file_says_nothing_of_contact_holds_an_object(tmp_path: Path) -> None:
    scenario = scenario_for(str(write_gripper(tmp_path)), "cube")
    model = scenario.object_model()
    plan = plan_scenario(scenario, model)[0]
    station = make_arm_station(scenario, plan, ArmSetup(X_FBase=Transform()), stay, model=model)
    simulator = Simulator(station.diagram)
    context = simulator.get_mutable_context()
    station.start(context)
    simulator.set_monitor(station.release_when_held)
    simulator.Initialize()
    simulator.AdvanceTo(1.5)
    assert station.diagram.GetOutputPort("holding").Eval(context)[0] == pytest.approx(1.0)
