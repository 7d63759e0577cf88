"""A hand that this project did not write, from the package that brings it."""

from importlib.metadata import PackageNotFoundError, distribution

import numpy as np
import pytest
from pydrake.math import RigidTransform

import tactopose_drake as tp
from tactopose_drake.core.poses import increments_between
from tactopose_drake.core.posterior.modes import determined_part
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.hand.hand_check import check_hand
from tactopose_drake.hand.hand_config import HandConfig, load_hand_config
from tactopose_drake.hand.hand_in_plant import make_hand_plant
from tactopose_drake.resources import ModelPackage, model_path
from tactopose_drake.runs.grasp_simulation import simulate_grasp
from tactopose_drake.station.automatic_scenario import scenario_for
from tactopose_drake.systems.pose_estimation import MakePoseEstimation

RADIUS = 0.012


def is_installed(name: str) -> bool:
    try:
        distribution(name)
    except PackageNotFoundError:
        return False
    return True


@pytest.fixture
def config() -> HandConfig:
    if not is_installed("example-robot-data"):
        pytest.skip("example-robot-data is not installed; it brings the Allegro hand's model")
    return load_hand_config("allegro")


def test_fingertips_are_where_the_kinematics_say_and_feel_what_touches_them(config: HandConfig) -> None:
    model = tp.ObjectModel.from_mesh(model_path("objects", "cube.obj"))
    plant, hand = make_hand_plant(config)
    assert plant.num_positions() == plant.num_actuators() == 16
    q = np.tile([0.1, 0.7, 0.6, 0.5], 4)
    plant_context = plant.CreateDefaultContext()
    plant.SetPositions(plant_context, q)

    estimation = MakePoseEstimation(config, model)
    context = estimation.CreateDefaultContext()
    estimation.GetInputPort("joint_positions").FixValue(context, q)
    outward_S = np.array([0.6, 0.0, 0.8])  # where each fingertip is touched, seen from its centre
    for finger in hand.fingers:
        p_SC, f_S = RADIUS * outward_S, -2.0 * outward_S
        F_S = np.append(np.cross(p_SC, f_S), f_S)
        estimation.GetInputPort(f"wrench_{finger}").FixValue(context, F_S)

    contacts = estimation.GetOutputPort("contacts").Eval(context)
    for i, finger in enumerate(hand.fingers):
        X_PS: RigidTransform = plant.CalcRelativeTransform(plant_context, hand.palm_frame, hand.sensor_frames[finger])
        np.testing.assert_allclose(contacts.p_PC[i], X_PS @ (RADIUS * outward_S), atol=1e-6)
        # The object's normal points into the finger.
        np.testing.assert_allclose(contacts.n_PC[i], -(X_PS.rotation() @ outward_S), atol=1e-6)


def test_its_files_have_no_fault(config: HandConfig) -> None:
    check = check_hand("allegro")
    assert not check.faults
    assert any("up to 10 N m s/rad" in finding.text for finding in check.findings)


def test_it_holds_a_cube_and_feels_where_it_is(config: HandConfig) -> None:
    result = simulate_grasp(scenario_for("allegro", "cube"))
    assert result.stable, result.reason
    estimate = result.station.diagram.GetOutputPort("hypotheses").Eval(result.context)
    off = increments_between(estimate.best.X_PO.GetAsMatrix34(), result.X_PO.GetAsMatrix34())
    determined = determined_part(off, estimate.best.free_directions, result.station.model.size)
    assert np.linalg.norm(determined[3:]) < 0.005


def test_a_distribution_that_is_missing_is_named() -> None:
    package = ModelPackage(name="hands", distribution="no-such-distribution", folder="share/hands")
    with pytest.raises(InvalidInputError, match="'no-such-distribution' is not installed; `pip install"):
        package.path()


def test_a_folder_that_is_missing_is_named() -> None:
    package = ModelPackage(name="hands", distribution="numpy", folder="no/such/folder")
    with pytest.raises(InvalidInputError, match="'numpy' has no folder 'no/such/folder'"):
        package.path()
