"""A station whose vision is a depth camera and its tracker, as a scenario selects it."""

import numpy as np
from pydrake.systems.analysis import Simulator

from tactopose_drake.core.poses import increments_between
from tactopose_drake.station.scenario import load_scenario
from tactopose_drake.station.simulated import make_station
from tactopose_drake.systems.depth_tracker import DepthTracker, DepthTrackerParams


def test_a_scenario_selects_a_depth_camera_and_its_tracker_finds_the_object() -> None:
    scenario = load_scenario("shadow_like_depth")
    assert isinstance(scenario.vision, DepthTrackerParams)
    assert scenario.vision.camera.width == 160
    station = make_station(scenario)
    assert isinstance(station.diagram.GetSubsystemByName("vision"), DepthTracker)
    simulator = Simulator(station.diagram)
    station.start(simulator.get_mutable_context())
    simulator.Initialize()
    simulator.AdvanceTo(0.004)
    prior = station.diagram.GetOutputPort("prior").Eval(simulator.get_context())
    error = increments_between(prior.mean, station.object_pose(simulator.get_context()).GetAsMatrix34())
    assert np.linalg.norm(error[3:]) < 0.01
    assert np.linalg.norm(error[:3]) < 0.15
    assert 0.1 < station.diagram.GetOutputPort("hidden_share").Eval(simulator.get_context())[0] < 0.7
