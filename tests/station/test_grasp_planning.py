"""What a scenario's grasps are planned with."""

from typing import Any

import numpy as np
import pytest
from pydrake.common.schema import Rotation, Transform

from tactopose_drake.errors import InvalidInputError
from tactopose_drake.hand.hand_config import load_hand_config
from tactopose_drake.hand.hand_in_plant import make_hand_plant
from tactopose_drake.resources import fixed_pose
from tactopose_drake.station import grasp_planning
from tactopose_drake.station.scenario import load_scenario


def test_the_objects_weight_is_that_in_the_palm(monkeypatch: pytest.MonkeyPatch) -> None:
    scenario = load_scenario("shadow_like")
    scenario.X_WBase = Transform(translation=[0.3, 0.2, 1.0], rotation=Rotation(value=Rotation.Rpy(deg=[50, 20, 70])))
    loads: list[np.ndarray] = []

    def plan(*told: Any) -> list[Any]:
        loads.append(told[2])
        return []

    monkeypatch.setattr(grasp_planning, "plan_grasps", plan)
    with pytest.raises(InvalidInputError, match="finds no way to hold"):
        grasp_planning.plan_scenario(scenario)
    plant, hand = make_hand_plant(load_hand_config(scenario.hand))
    base = plant.GetFrameByName(hand.config.base_link, hand.model_instance)
    X_BaseP = plant.CalcRelativeTransform(plant.CreateDefaultContext(), base, hand.palm_frame)
    R_WP = (fixed_pose("X_WBase", scenario.X_WBase) @ X_BaseP).rotation()
    ((x, y, weight),) = [R_WP @ load for load in loads]
    assert (x, y) == pytest.approx((0.0, 0.0), abs=1e-9)
    assert -5.0 < weight < -0.1  # N
