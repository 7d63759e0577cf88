"""Stations are freed when nobody uses them, so that a program may make as many as it likes."""

import gc
import weakref
from collections.abc import Callable

import pytest
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Diagram, DiagramBuilder

from tactopose_drake.drivers.device_bus import DeviceBus
from tactopose_drake.hand.geometry import BodySpheres
from tactopose_drake.hand.hand_config import load_hand_config
from tactopose_drake.station.can_devices import CanDevices
from tactopose_drake.station.grasp_planning import plan_scenario
from tactopose_drake.station.hardware import make_hardware_station
from tactopose_drake.station.scenario import Scenario, load_scenario
from tactopose_drake.station.simulated import check_bodies, make_station
from tactopose_drake.systems.pose_tracking import PoseTrackingParams
from tests import held_can, held_cube


def count() -> int:
    """How many plants and builders there are."""
    gc.collect()
    return sum(issubclass(type(found), MultibodyPlant | DiagramBuilder) for found in gc.get_objects())


def on_devices(scenario: Scenario) -> Diagram:
    scenario.tracking = PoseTrackingParams()
    devices = CanDevices(scenario.senses, {"main": DeviceBus.open("virtual", "freed")})
    return make_hardware_station(scenario, devices).diagram


def simulated(name: str) -> Diagram:
    scenario = load_scenario(name)
    scenario.planner.grasps = 1
    return make_station(scenario).diagram


@pytest.mark.parametrize(
    "make",
    [
        lambda: on_devices(held_cube.scenario()),
        lambda: on_devices(held_can.scenario()),
        lambda: simulated("barrett_like"),
        lambda: simulated("shadow_like"),
    ],
    ids=["force-torque boards", "Barrett's hand", "simulated pads", "simulated fingertips"],
)
def test_a_station_is_freed_with_all_that_it_was_made_of(make: Callable[[], Diagram]) -> None:
    make()  # What is kept between stations is made once.
    before = count()
    diagram = weakref.ref(make())
    after = count()
    assert diagram() is None
    assert after <= before


def test_a_new_station_frees_those_before_it_though_python_does_not_look_for_garbage() -> None:
    scenario = load_scenario("shadow_like")
    scenario.planner.grasps = 1
    model = scenario.object_model()
    plan = plan_scenario(scenario, model)[0]
    enabled = gc.isenabled()
    gc.disable()
    try:
        made = [weakref.ref(make_station(scenario, plan, model=model).diagram) for _ in range(3)]
        freed = [diagram() is None for diagram in made[:2]]
    finally:
        if enabled:
            gc.enable()
    assert freed == [True, True]


@pytest.mark.parametrize(
    "look",
    [
        lambda: load_scenario("shadow_like").validate(),
        lambda: check_bodies(load_scenario("barrett_like")),
        lambda: BodySpheres.of_hand(load_hand_config("shadow_like")),
    ],
    ids=["validate", "check_bodies", "of_hand"],
)
def test_bodies_that_are_only_looked_at_are_freed(look: Callable[[], object]) -> None:
    before = count()
    look()
    assert count() <= before
