"""From what is measured to the positions of a hand's plant."""

import dataclasses
from pathlib import Path

import numpy as np

from tactopose_drake.hand.calibration_file import HandCalibration, MeasuredNumber
from tactopose_drake.hand.hand_config import load_hand_config
from tactopose_drake.hand.hand_in_plant import make_hand_plant
from tactopose_drake.hand.joint_matrices import joint_matrix, joint_offsets, reading_offsets
from tests.hand.grippers import YAML, write_bending_gripper, write_gripper

COUPLED = YAML.replace(
    "joints: [right_slide]",
    "joints: [left_slide]\n  couplings: [{joint: right_slide, follows: left_slide, ratio: 0.5, offset: 0.01}]",
)


def test_what_follows_is_off_by_its_share_of_its_leader_s_offset(tmp_path: Path) -> None:
    mimic = '<mimic joint="left_slide" multiplier="0.5" offset="0.01"/>'
    plant, hand = make_hand_plant(load_hand_config(write_gripper(tmp_path, mimic=mimic, yaml=COUPLED)))
    place = [plant.GetJointByName(name).position_start() for name in ("left_slide", "right_slide")]
    matrix, offsets = joint_matrix(plant, hand, ["left_slide"]), joint_offsets(plant, hand, ["left_slide"])
    np.testing.assert_allclose((matrix @ [0.04] + offsets)[place], [0.04, 0.03])
    found = HandCalibration(joint_offsets={"left_slide": MeasuredNumber(value=0.002)})  # m
    off = reading_offsets(plant, dataclasses.replace(hand, calibration=found))
    np.testing.assert_allclose(off[place], [0.002, 0.001])


def test_offsets_of_what_turns_are_in_degrees_and_of_joints_that_were_not_found_nothing(tmp_path: Path) -> None:
    plant, hand = make_hand_plant(load_hand_config(write_bending_gripper(tmp_path, 2)))
    found = HandCalibration(joint_offsets={"f1_j0": MeasuredNumber(value=3.0)})
    off, expected = (
        reading_offsets(plant, dataclasses.replace(hand, calibration=found)),
        np.zeros(plant.num_positions()),
    )
    expected[plant.GetJointByName("f1_j0").position_start()] = np.radians(3.0)
    np.testing.assert_allclose(off, expected)
    np.testing.assert_array_equal(reading_offsets(plant, hand), 0.0)
