"""A simulated hand that holds a bust by three fingers, and feels on with the others."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from tactopose_drake.errors import InvalidInputError, UnknownNameError
from tactopose_drake.station.grasp_planning import plan_scenario
from tactopose_drake.station.scenario import Grip, load_scenario
from tactopose_drake.station.simulated import make_station
from tactopose_drake.systems.touch_exploration import TouchExplorationParams
from tests.examples.scripts import share_script


def test_a_free_finger_touches_and_the_belief_gathers() -> None:
    study = share_script("thesis/physical_touches.py")
    scenario = study.scenario_of("bust", 1001, "information")
    # So much is never reached: it goes on touching.
    scenario.exploration.chooser.enough = 1.0
    scenario.exploration.chooser.moves = 150
    model = scenario.object_model()
    station = make_station(scenario, model=model)
    assert station.plan is not None
    assert sorted(station.plan.fingers) == sorted(scenario.planner.fingers)
    simulator = Simulator(station.diagram)
    context = simulator.get_mutable_context()
    station.start(context)
    simulator.set_monitor(station.release_when_held)
    port = station.diagram.GetOutputPort
    while context.get_time() < 6.0 and len(port("explored_touches").Eval(context)) < 4:
        simulator.AdvanceTo(context.get_time() + 0.1)
        in_hand = port("explored_phase").Eval(context) in ("wait", "settle", "decide")
        held = port("contacts").Eval(context)
        assert not in_hand or len(held) <= 4
    felt = port("explored_touches").Eval(context)
    assert len(felt) == 4, "three fingers hold, and one has felt more"
    # The finger has met the object where it is.
    X_PO = station.object_pose(context).GetAsMatrix34()
    off = model.grid.distance((felt.p_PC[-1:] - X_PO[:, 3]) @ X_PO[:, :3])
    assert np.abs(off).max() < 0.003
    assert 0.0 < port("explored_resolved").Eval(context)[0] <= 1.0


def test_a_grip_has_no_finger_to_spare() -> None:
    scenario = load_scenario("shadow_like")
    scenario.grip = Grip()
    scenario.exploration = TouchExplorationParams()
    with pytest.raises(InvalidInputError, match=r"Scenario\.exploration must be None with a grip"):
        scenario.validate()


def test_a_plan_is_not_asked_of_fingers_that_there_are_not() -> None:
    scenario = load_scenario("shadow_like")
    scenario.planner.fingers = ["thumb", "paw"]
    with pytest.raises(UnknownNameError, match=r"PlannerParams\.fingers must .*'paw'"):
        plan_scenario(scenario)
