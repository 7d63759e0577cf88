"""What a scenario's grasps are planned with."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydrake.common.schema import Rotation, Transform
from pydrake.systems.framework import DiagramBuilder

from tactopose_drake.errors import InvalidInputError
from tactopose_drake.hand.hand_config import load_hand_config
from tactopose_drake.hand.hand_in_plant import make_hand_plant
from tactopose_drake.resources import fixed_pose
from tactopose_drake.station import grasp_planning
from tactopose_drake.station.grasp import add_grip
from tactopose_drake.station.scenario import Scenario, load_scenario
from tactopose_drake.systems.touch_explorer import TouchExplorer
from tests.hand.grippers import YAML, write_gripper


def test_the_objects_weight_is_that_in_the_palm(monkeypatch: pytest.MonkeyPatch) -> None:
    scenario = load_scenario("shadow_like")
    scenario.X_WBase = Transform(translation=[0.3, 0.2, 1.0], rotation=Rotation(value=Rotation.Rpy(deg=[50, 20, 70])))
    loads: list[np.ndarray] = []

    def plan(*told: Any) -> list[Any]:
        loads.append(told[2])
        return []

    monkeypatch.setattr(grasp_planning, "plan_grasps", plan)
    with pytest.raises(
        InvalidInputError, match=r"finds no way to hold .* At least 4 fingers must touch it; `planner: "
    ):
        grasp_planning.plan_scenario(scenario)
    plant, hand = make_hand_plant(load_hand_config(scenario.hand))
    base = plant.GetFrameByName(hand.config.base_link, hand.model_instance)
    X_BaseP = plant.CalcRelativeTransform(plant.CreateDefaultContext(), base, hand.palm_frame)
    R_WP = (fixed_pose("X_WBase", scenario.X_WBase) @ X_BaseP).rotation()
    ((x, y, weight),) = [R_WP @ load for load in loads]
    assert (x, y) == pytest.approx((0.0, 0.0), abs=1e-9)
    assert -5.0 < weight < -0.1  # N


def test_what_lets_fewer_fingers_hold_is_said_unless_two_are_enough(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(grasp_planning, "plan_grasps", lambda *told: [])
    scenario = Scenario(hand=str(write_gripper(tmp_path)), object="cube")
    with pytest.raises(InvalidInputError, match="finds no way to hold") as two:
        grasp_planning.plan_scenario(scenario)
    assert "least_fingers" not in str(two.value)
    scenario = load_scenario("shadow_like")
    scenario.planner.least_fingers = 3
    with pytest.raises(
        InvalidInputError,
        match=r"At least 3 fingers must touch it; `planner: \{least_fingers: 2\}` in a scenario lets two hold it\.",
    ):
        grasp_planning.plan_scenario(scenario)


def test_a_joint_that_is_to_rest_beyond_its_limits_is_refused(tmp_path: Path) -> None:
    """The simulated hand would begin there, and be thrown back."""
    path = write_gripper(tmp_path, yaml=YAML + "rest_positions: {left_slide: 0.08}\n")
    said = r"HandConfig\.rest_positions\[left_slide\] must be within the joint's limits, 0 to 0\.045, not 0\.08\.$"
    with pytest.raises(InvalidInputError, match=said):
        grasp_planning.plan_scenario(Scenario(hand=str(path), object="cube"))
    with pytest.raises(InvalidInputError, match=said):
        TouchExplorer(load_hand_config(path))


def test_so_is_one_before_a_grip() -> None:
    scenario = load_scenario("barrett_like")
    assert scenario.grip is not None
    config, joint = scenario.hand_config(), "finger_1_spread_joint"
    scenario.grip.controller.fixed[joint] = 9.0
    said = rf"GripControllerParams\.fixed\[{joint}\] must be within the joint's limits, 0 to 3\.14, not 9\.$"
    with pytest.raises(InvalidInputError, match=said):
        add_grip(DiagramBuilder(), scenario, *make_hand_plant(config))
    config.rest_positions[joint] = -1.0
    with pytest.raises(
        InvalidInputError, match=rf"rest_positions\[{joint}\] must be within the joint's limits, .*, not -1"
    ):
        add_grip(DiagramBuilder(), scenario, *make_hand_plant(config))
