"""How far a hand's errors move its arrays, against the same errors drawn at random."""

import dataclasses
import math

import numpy as np
import pytest

from tactopose_drake.core.poses import log_so3
from tactopose_drake.hand.calibration_file import HandCalibration, MeasuredNumber
from tactopose_drake.hand.contact_uncertainty import PadUncertainty
from tactopose_drake.hand.encoder_offsets import encoder_gains
from tactopose_drake.hand.hand_config import HandUncertainty, load_hand_config
from tactopose_drake.hand.hand_in_plant import make_hand_plant
from tactopose_drake.hand.kinematics import HandKinematics
from tactopose_drake.hand.tactile_pads import load_tactile_pad


def test_joint_offsets_move_arrays_as_drawn_offsets_do() -> None:
    plant, hand = make_hand_plant(load_hand_config("barrett_like"))
    kinematics, generator = HandKinematics(plant, hand.palm_frame), np.random.default_rng(0)
    uncertainty = PadUncertainty(plant, hand, HandUncertainty(encoder_offset_deg=0.5, mounting=0.0, mounting_deg=0.0))
    layout = load_tactile_pad("bh280_finger").layout
    start = {plant.get_joint(i).name(): plant.get_joint(i).position_start() for i in plant.GetJointIndices()}
    q = np.full(plant.num_positions(), 0.4)
    kinematics.move(q)
    said, X_PT = uncertainty.covariance("finger_2", layout, kinematics), kinematics.poses(hand.pad_frames)["finger_2"]
    drawn = []
    for _ in range(3000):
        spread, proximal = math.radians(0.5) * generator.normal(size=2)
        offset = np.zeros(len(q))
        offset[[start["finger_1_spread_joint"], start["finger_2_spread_joint"]]] = spread
        offset[start["finger_2_proximal_joint"]] = proximal
        offset[start["finger_2_distal_joint"]] = proximal / 3.0
        kinematics.move(q + offset)
        moved = kinematics.poses(hand.pad_frames)["finger_2"]
        middle = layout.p_TC.mean(axis=0)
        turn = log_so3(moved.rotation().matrix() @ X_PT.rotation().matrix().T)
        drawn.append(np.concatenate([moved @ middle - X_PT @ middle, turn]))
    scale = np.sqrt(np.outer(np.diag(said), np.diag(said))) + 1e-12
    np.testing.assert_allclose(np.cov(np.transpose(drawn)) / scale, said / scale, atol=0.1)
    assert np.sqrt(np.trace(said[:3, :3])) > 5e-4


def test_a_calibrated_joint_misplaces_arrays_by_what_is_left_of_its_offset() -> None:
    plant, hand = make_hand_plant(load_hand_config("barrett_like"))
    kinematics, layout = HandKinematics(plant, hand.palm_frame), load_tactile_pad("bh280_finger").layout
    errors = HandUncertainty(encoder_offset_deg=2.0, mounting=0.0, mounting_deg=0.0)
    found = HandCalibration(
        joint_offsets={name: MeasuredNumber(sigma=0.5) for name in encoder_gains(plant, hand).joints}
    )
    wide, narrow = (
        PadUncertainty(plant, each, errors).covariance("finger_2", layout, kinematics)
        for each in (hand, dataclasses.replace(hand, calibration=found))
    )
    assert np.trace(wide) > 1e-4
    np.testing.assert_allclose(narrow, wide / 16.0, atol=1e-12)


def test_a_palm_array_is_off_by_its_mounting_alone() -> None:
    plant, hand = make_hand_plant(load_hand_config("barrett_like"))
    errors = HandUncertainty(encoder_offset_deg=2.0, mounting=0.001, mounting_deg=1.5)
    uncertainty, kinematics = PadUncertainty(plant, hand, errors), HandKinematics(plant, hand.palm_frame)
    covariance = uncertainty.covariance("palm", load_tactile_pad("bh280_palm").layout, kinematics)
    expected = np.diag(np.repeat([0.001**2, math.radians(1.5) ** 2], 3))
    assert covariance == pytest.approx(expected, abs=1e-12)
