"""How a hand gets into a plant whose model has a place in the world of its own, and beside another of its kind."""

from pathlib import Path

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant

from tactopose_drake.errors import InvalidFileError, InvalidInputError
from tactopose_drake.hand.fingertip_weights import FingertipWeights
from tactopose_drake.hand.geometry import BodySpheres
from tactopose_drake.hand.hand_check import check_hand
from tactopose_drake.hand.hand_config import HandConfig, load_hand_config
from tactopose_drake.hand.hand_in_plant import add_hand, make_hand_plant, pose_by_model
from tactopose_drake.hand.kinematics import HandKinematics
from tactopose_drake.resources import fixed_pose
from tactopose_drake.station.arms.arm import add_arm, load_arm_config, mount_hand
from tactopose_drake.station.automatic_scenario import scenario_for
from tactopose_drake.station.simulated import check_bodies
from tests.hand.grippers import YAML, write_gripper

X_WBASE = RigidTransform(RollPitchYaw(0.4, -0.3, 0.8), [0.1, 0.2, 0.3])
FIXED = (
    '<link name="world"/><joint name="stand" type="fixed"><parent link="world"/><child link="base"/>'
    '<origin xyz="0.1 0.2 0.3" rpy="0.4 -0.3 0.8"/></joint></robot>'
)


def write_standing(folder: Path, joint: str = FIXED) -> Path:
    """The gripper, whose model itself places it in the world by a joint."""
    folder.mkdir()
    path = write_gripper(folder)
    model = folder / "two_finger.urdf"
    model.write_text(model.read_text().replace("</robot>", joint))
    return path


@pytest.fixture
def standing(tmp_path: Path) -> HandConfig:
    return load_hand_config(write_standing(tmp_path / "standing"))


def test_what_is_seen_from_the_palm_is_that_of_a_hand_without_a_place(standing: HandConfig, tmp_path: Path) -> None:
    free = load_hand_config(write_gripper(tmp_path))
    q, found = np.array([0.01, 0.02]), []
    for config in (standing, free):
        plant, hand = make_hand_plant(config)
        kinematics = HandKinematics(plant, hand.palm_frame)
        kinematics.move(q)
        weights = FingertipWeights(plant, hand, RotationMatrix(RollPitchYaw(1.0, 0.2, 0.0))).wrenches(q)
        found.append((kinematics.positions(BodySpheres.of_hand(config)), weights["left"], weights["right"]))
    for here, there in zip(*found, strict=True):
        np.testing.assert_allclose(here, there, atol=1e-12)


def test_it_stands_where_its_model_places_it_and_nowhere_else(standing: HandConfig, tmp_path: Path) -> None:
    found = pose_by_model(standing)
    assert found is not None
    assert found.IsNearlyEqualTo(X_WBASE, 1e-9)
    assert pose_by_model(load_hand_config(write_gripper(tmp_path))) is None
    for X_WBase in (None, X_WBASE):
        plant = MultibodyPlant(0.001)
        hand = add_hand(plant, standing, X_WBase)
        plant.Finalize()
        X_WP = hand.palm_frame.CalcPoseInWorld(plant.CreateDefaultContext())
        assert X_WP.IsNearlyEqualTo(X_WBASE, 1e-9)
    with pytest.raises(
        InvalidInputError, match=r"^X_WBase must be None, .* the joint 'stand' of .*\.urdf fixes 'base'"
    ):
        add_hand(MultibodyPlant(0.001), standing, RigidTransform())


def test_a_joint_that_moves_the_base_in_the_world_is_refused(tmp_path: Path) -> None:
    config = load_hand_config(write_standing(tmp_path / "sliding", FIXED.replace('"fixed"', '"prismatic"')))
    with pytest.raises(InvalidInputError, match="'base', which the joint 'stand' moves in the world"):
        make_hand_plant(config)


def test_a_finalized_plant_receives_no_hand() -> None:
    plant, hand = make_hand_plant(load_hand_config("shadow_like"))
    with pytest.raises(InvalidInputError, match=r"^plant must not be finalized yet, but is\.$"):
        add_hand(plant, hand.config)


def test_what_is_no_hand_plant_or_pose_is_named() -> None:
    plant, config = MultibodyPlant(0.001), load_hand_config("shadow_like")
    for arguments, message in (
        ((None, config), "plant must be a MultibodyPlant, not None"),
        ((plant, "shadow_like"), "config must be a HandConfig, not a str"),
        ((plant, config, np.eye(4)), "X_WBase must be a RigidTransform, not an ndarray"),
    ):
        with pytest.raises(InvalidInputError, match=f"^{message}"):
            add_hand(*arguments)
    assert plant.num_model_instances() == 2  # of the world, and the default one: nothing was added


def test_two_of_a_kind_are_in_one_plant(tmp_path: Path) -> None:
    config = load_hand_config(write_gripper(tmp_path))
    plant = MultibodyPlant(0.001)
    hands = [add_hand(plant, config, RigidTransform([place, 0.0, 0.0])) for place in (0.0, 1.0)]
    plant.Finalize()
    names = [plant.GetModelInstanceName(hand.model_instance) for hand in hands]
    assert names == ["two_finger", "two_finger_1"]
    assert plant.num_actuators(hands[1].model_instance) == 2
    p_WP = [hand.palm_frame.CalcPoseInWorld(plant.CreateDefaultContext()).translation() for hand in hands]
    np.testing.assert_allclose(p_WP, [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]], atol=1e-12)


def test_the_offset_of_a_joint_that_slides_is_told_in_metres(tmp_path: Path) -> None:
    path = write_gripper(tmp_path, yaml=YAML + "calibration: own.calibration.yaml\n")
    (tmp_path / "own.calibration.yaml").write_text("joint_offsets: {left_slide: {value: 0.01, sigma: 0.001}}\n")
    make_hand_plant(load_hand_config(path))
    (tmp_path / "own.calibration.yaml").write_text("joint_offsets: {left_slide: {value: 3.0, sigma: 0.1}}\n")
    with pytest.raises(
        InvalidFileError,
        match=r"left_slide\.value must be from -0.1 to 0.1 m for a prismatic joint, not 3 m",
    ):
        make_hand_plant(load_hand_config(path))


def test_it_is_checked_simulated_where_it_stands_and_on_no_arm(tmp_path: Path) -> None:
    path = write_standing(tmp_path / "standing")
    check = check_hand(path)
    assert not check.faults
    assert any("fixes 'base' to the world" in finding.text for finding in check.findings)
    scenario = scenario_for(str(path), "cube")
    assert fixed_pose("X_WBase", scenario.X_WBase).IsNearlyEqualTo(X_WBASE, 1e-3)
    check_bodies(scenario)
    plant = MultibodyPlant(0.001)
    arm = add_arm(plant, load_arm_config("seven_axis"), RigidTransform())
    with pytest.raises(
        InvalidInputError, match="must be a model without the joint 'stand' on an arm, as it fixes 'base' to the world"
    ):
        mount_hand(plant, arm, add_hand(plant, load_hand_config(path)), RigidTransform())
