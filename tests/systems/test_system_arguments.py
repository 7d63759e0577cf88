"""What systems are made of is checked when they are made: one clear line, and not an error of what is inside."""

from collections.abc import Callable

import pytest
from pydrake.math import RotationMatrix
from pydrake.multibody.plant import MultibodyPlant

from tactopose_drake.errors import InvalidInputError
from tactopose_drake.hand.fingertip_weights import FingertipWeights
from tactopose_drake.hand.hand_config import load_hand_config
from tactopose_drake.hand.hand_in_plant import find_hand, make_hand_plant
from tactopose_drake.hand.tactile_pads import load_tactile_pad
from tactopose_drake.systems.contact_solver import ContactSolver
from tactopose_drake.systems.contacts_in_palm import ContactsInPalm
from tactopose_drake.systems.fingertip_velocities import FingertipVelocities
from tactopose_drake.systems.fingertip_weight import FingertipWeight
from tactopose_drake.systems.force_torque_sensor import ForceTorqueSensor, load_force_torque_model
from tactopose_drake.systems.grip_controller import GripController
from tactopose_drake.systems.measured_joints import MeasuredJoints
from tactopose_drake.systems.next_touch_chooser import NextTouchChooser
from tactopose_drake.systems.palm_pose import PalmPose
from tactopose_drake.systems.played_signal import PlayedValue, PlayedVector
from tactopose_drake.systems.pose_belief_estimator import PoseBeliefParams
from tactopose_drake.systems.pose_estimation import PoseEstimationParams
from tactopose_drake.systems.pose_estimator import PoseEstimatorParams
from tactopose_drake.systems.pose_tracking import PoseTrackingParams
from tactopose_drake.systems.simulated_array import TactileArray
from tactopose_drake.systems.touch_exploration import TouchExplorationParams
from tactopose_drake.systems.touch_explorer import TouchExplorer


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: ContactSolver(3), "surfaces must be a Mapping, not an int"),
        (lambda: FingertipWeight({}, ("thumb",), 22), "weights must be a FingertipWeights, not a dict"),
        (lambda: MeasuredJoints([1, 2]), r"matrix must have the shape .*, not \(2,\)"),
        (lambda: NextTouchChooser("shadow_like", None), "hand must be a HandConfig, not a str"),
        (
            lambda: NextTouchChooser(load_hand_config("shadow_like"), "mug.obj"),
            "model must be an ObjectModel, not a str",
        ),
        (lambda: PalmPose("palm"), "palm_frame must be a Frame, not a str"),
        (lambda: PlayedValue(3), "signal must be a Signal, not an int"),
        (lambda: PlayedVector(3), "signal must be a Signal, not an int"),
        (lambda: TouchExplorer("shadow_like"), "hand must be a HandConfig, not a str"),
    ],
)
def test_arguments_of_another_type_are_named(make: Callable[[], object], message: str) -> None:
    with pytest.raises(InvalidInputError, match=f"^{message}"):
        make()


def test_a_hand_of_another_plant_is_refused() -> None:
    """Drake would end the process by a failed assertion if the plant has fewer models."""
    (plant, _), (_, other) = (make_hand_plant(load_hand_config("shadow_like")) for _ in range(2))
    for empty in (plant, MultibodyPlant(time_step=0.001)):
        with pytest.raises(InvalidInputError, match=r"^hand must be in this plant, but is in another\."):
            GripController(empty, other)


@pytest.mark.parametrize("wrong", [None, "shadow_like"])
@pytest.mark.parametrize(
    ("make", "names"),
    [
        (ContactsInPalm, {"plant": "plant", "sensor_frames": "sensor_frames", "palm_frame": "palm_frame"}),
        (FingertipVelocities, {"plant": "plant", "tip_frames": "sensor_frames", "palm_frame": "palm_frame"}),
        (FingertipWeights, {"plant": "plant", "hand": "hand", "R_WBase": "rotation"}),
        (ForceTorqueSensor, {"plant": "plant", "weld": "weld", "sensor_frame": "palm_frame", "model": "sensor"}),
        (GripController, {"plant": "plant", "hand": "hand"}),
        (TactileArray, {"plant": "plant", "pad_frame": "palm_frame", "pad": "pad"}),
        (find_hand, {"plant": "plant", "config": "config", "model_instance": "instance"}),
    ],
)
def test_parts_of_a_plant_of_another_type_are_named(
    make: Callable[..., object], names: dict[str, str], wrong: object
) -> None:
    config = load_hand_config("shadow_like")
    plant, hand = make_hand_plant(config)
    right = {
        "plant": plant, "hand": hand, "config": config, "palm_frame": hand.palm_frame, "rotation": RotationMatrix(),
        "sensor_frames": hand.sensor_frames, "weld": hand.welds["thumb"], "instance": hand.model_instance,
        "sensor": load_force_torque_model(), "pad": load_tactile_pad("bh280_palm"),
    }  # fmt: skip
    for name in names:
        arguments = {argument: right[part] for argument, part in names.items()} | {name: wrong}
        with pytest.raises(InvalidInputError, match=rf"^{name} must be an? \w+, not "):
            make(**arguments)
        with pytest.raises(InvalidInputError, match=rf"^{name} must be an? \w+, not "):
            make(*arguments.values())


@pytest.mark.parametrize(
    ("params", "name"),
    [
        (PoseEstimationParams(use_uncertainty="no"), "PoseEstimationParams.use_uncertainty"),
        (PoseEstimationParams(check_collisions=1), "PoseEstimationParams.check_collisions"),
        (PoseEstimatorParams(balance="yes"), "PoseEstimatorParams.balance"),
        (PoseTrackingParams(live=0.0), "PoseTrackingParams.live"),
        (PoseTrackingParams(use_hand_volume=None), "PoseTrackingParams.use_hand_volume"),
    ],
)
def test_what_is_on_or_off_is_neither_text_nor_a_number(
    params: PoseEstimationParams | PoseEstimatorParams | PoseTrackingParams, name: str
) -> None:
    with pytest.raises(InvalidInputError, match=f"^{name} must be True or False, not .*"):
        params.validate()


@pytest.mark.parametrize(
    ("params", "message"),
    [
        (
            PoseEstimationParams(estimator=PoseTrackingParams()),
            "PoseEstimationParams.estimator must be a PoseEstimatorParams, not a PoseTrackingParams",
        ),
        (
            PoseEstimationParams(solver={"min_force": 0.1}),
            "PoseEstimationParams.solver must be a ContactSolverParams, not a dict",
        ),
        (
            PoseTrackingParams(belief={"period": 0.1}),
            "PoseTrackingParams.belief must be a PoseBeliefParams, not a dict",
        ),
        (
            PoseTrackingParams(refinement=True),
            "PoseTrackingParams.refinement must be an OffsetRefinementParams, not a bool",
        ),
        (PoseBeliefParams(tracker=None), "PoseBeliefParams.tracker must be a PoseTrackerParams, not None"),
        (TouchExplorationParams(chooser=3), "TouchExplorationParams.chooser must be a NextTouchParams, not an int"),
    ],
)
def test_a_part_of_another_type_is_named(
    params: PoseEstimationParams | PoseTrackingParams | PoseBeliefParams | TouchExplorationParams, message: str
) -> None:
    with pytest.raises(InvalidInputError, match=f"^{message}"):
        params.validate()
