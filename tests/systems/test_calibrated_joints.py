"""A hand whose calibration has found its encoders to be off: all that takes joint positions takes the true ones."""

import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlantConfig
from pydrake.systems.framework import Context, Diagram, DiagramBuilder

from tactopose_drake.core.calibration.offset_refinement import OffsetRefinementParams
from tactopose_drake.hand.calibration_file import HandCalibration, MeasuredNumber, save_calibration
from tactopose_drake.hand.encoder_offsets import encoder_gains
from tactopose_drake.hand.hand_config import HandConfig, load_hand_config
from tactopose_drake.hand.hand_in_plant import add_hand, make_hand_plant
from tactopose_drake.hand.joint_matrices import reading_offsets
from tactopose_drake.systems.pose_estimation import AddPoseEstimation, PoseEstimationParams
from tactopose_drake.systems.pose_tracking import AddPoseTracking, MakePoseTracking, PoseTrackingParams
from tactopose_drake.systems.touch_exploration import AddTouchExploration
from tests.core.tracking.boxes import make_box


@pytest.fixture(scope="module")
def hand(tmp_path_factory: pytest.TempPathFactory) -> HandConfig:
    config = load_hand_config("shadow_like")
    plant, parts = make_hand_plant(config)
    names = encoder_gains(plant, parts).joints
    offsets = {name: MeasuredNumber(value=1.0 + 0.1 * k, sigma=0.1) for k, name in enumerate(names)}
    path = Path(tmp_path_factory.mktemp("calibrated") / "calibration.yaml")
    save_calibration(path, HandCalibration(grasps=5, joint_offsets=offsets))
    return dataclasses.replace(config, calibration=str(path))


@pytest.fixture(scope="module")
def offsets(hand: HandConfig) -> np.ndarray:
    found = reading_offsets(*make_hand_plant(hand))
    assert np.degrees(found).min() >= 1.0 - 1e-9
    return found


def taken(diagram: Diagram, context: Context) -> dict[str, np.ndarray]:
    """The joint positions that each system takes."""
    systems = [system for system in diagram.GetSystems() if system.HasInputPort("joint_positions")]
    return {
        system.get_name(): system.GetInputPort("joint_positions").Eval(system.GetMyContextFromRoot(context))
        for system in systems
    }


@pytest.mark.parametrize("refinement", [None, OffsetRefinementParams()])
def test_a_belief_and_its_fingertips_velocities_take_the_true_positions(
    hand: HandConfig, offsets: np.ndarray, refinement: OffsetRefinementParams | None
) -> None:
    diagram = MakePoseTracking(hand, make_box(), PoseTrackingParams(refinement=refinement))
    context, q = diagram.CreateDefaultContext(), np.full(len(offsets), 0.3)
    diagram.GetInputPort("joint_positions").FixValue(context, q)
    found = taken(diagram, context)
    assert {"contacts_in_palm", "hand_volume", "fingertip_velocities", "pose_belief"} <= found.keys()
    assert ("offset_refiner" in found) == (refinement is not None)
    for positions in found.values():
        np.testing.assert_allclose(positions, q - offsets, atol=1e-12)


def test_an_exploration_takes_the_true_positions_and_commands_what_encoders_will_read(
    hand: HandConfig, offsets: np.ndarray
) -> None:
    builder = DiagramBuilder()
    exploration = AddTouchExploration(builder, hand, make_box())
    plain = AddTouchExploration(builder, dataclasses.replace(hand, calibration=""), make_box(), name="plain")
    context, q = exploration.CreateDefaultContext(), np.full(len(offsets), 0.3)
    exploration.GetInputPort("joint_positions").FixValue(context, q)
    found = taken(exploration, context)
    assert found.keys() == {"next_touch_chooser", "touch_explorer", "hand_volume"}
    for positions in found.values():
        np.testing.assert_allclose(positions, q - offsets, atol=1e-12)
    truly = plain.GetOutputPort("rest_positions").Eval(plain.CreateDefaultContext())
    commanded = exploration.GetOutputPort("rest_positions").Eval(context)
    np.testing.assert_allclose(commanded, truly + offsets, atol=1e-12)
    builder.Build()


@pytest.mark.parametrize("simulated", [True, False])
@pytest.mark.parametrize(
    ("add", "params"), [(AddPoseEstimation, PoseEstimationParams), (AddPoseTracking, PoseTrackingParams)]
)
def test_a_simulated_hand_is_as_its_model_whatever_a_calibration_has_found(
    hand: HandConfig, offsets: np.ndarray, add: Callable[..., Diagram], params: Callable[..., object], simulated: bool
) -> None:
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlant(MultibodyPlantConfig(time_step=0.004), builder)
    in_plant = add_hand(plant, hand, RigidTransform())
    plant.Finalize()
    bare = params(use_hand_volume=False, check_collisions=False)
    estimation = add(builder, hand, make_box(), bare, plant=in_plant, simulated_senses=simulated)
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    q = np.full(len(offsets), 0.3)
    plant.SetPositions(plant.GetMyMutableContextFromRoot(context), in_plant.model_instance, q)
    found = taken(estimation, context)
    assert "contacts_in_palm" in found
    for positions in found.values():
        np.testing.assert_allclose(positions, q if simulated else q - offsets, atol=1e-12)
