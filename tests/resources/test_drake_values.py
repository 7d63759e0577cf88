"""Dataclasses with values of Drake's schema: equal by value, copied and pickled."""

import copy
import pickle
from collections.abc import Callable
from typing import Any

import pytest
from pydrake.common.schema import Transform

from tactopose_drake.station.arms.arm_station import ArmSetup, SceneModel
from tactopose_drake.station.scenario import Grip, Scenario, load_scenario


def set_plant_period(scenario: Scenario) -> None:
    scenario.plant.time_step += 1e-12


def move_camera(scenario: Scenario) -> None:
    scenario.X_WC.translation = scenario.X_WC.translation + 1e-15


def move_arm(setup: ArmSetup) -> None:
    setup.X_FBase = Transform()


def move_model(model: SceneModel) -> None:
    model.X_WModel.translation = [0.0, 0.0, 1e-15]


def move_object(grip: Grip) -> None:
    grip.X_PO["near"].translation = [0.0, 0.0, 0.1]


@pytest.mark.parametrize(
    ("make", "change"),
    [
        (lambda: load_scenario("shadow_like"), set_plant_period),
        (lambda: load_scenario("barrett_like_can"), move_camera),
        (ArmSetup, move_arm),
        (SceneModel, move_model),
        (lambda: Grip(X_PO={"near": Transform(), "far": Transform()}), move_object),
    ],
)
@pytest.mark.parametrize("copied", [copy.deepcopy, lambda value: pickle.loads(pickle.dumps(value))])
def test_a_copy_is_equal_until_a_value_of_drake_differs(
    make: Callable[[], Any], change: Callable[[Any], None], copied: Callable[[Any], Any]
) -> None:
    value = make()
    other = copied(value)
    assert other == value
    change(other)
    assert other != value
    assert value == make()
