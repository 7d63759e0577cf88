"""How uncertain contacts and surfaces are of hands whose calibration tells it in part."""

import dataclasses
import math

import numpy as np
import pytest

from tactopose_drake.hand.calibration_file import FingerCalibration, HandCalibration, MeasuredNumber
from tactopose_drake.hand.contact_uncertainty import ContactUncertainty
from tactopose_drake.hand.encoder_offsets import encoder_gains
from tactopose_drake.hand.hand_config import HandUncertainty, load_hand_config
from tactopose_drake.hand.hand_errors import calibration_of
from tactopose_drake.hand.hand_in_plant import make_hand_plant
from tactopose_drake.hand.kinematics import HandKinematics
from tests.hand.calibrated_shadow import WrongHand
from tests.hand.test_contact_uncertainty import NONE, touch


def test_what_is_left_of_single_contacts_widens_a_calibrated_one_every_way() -> None:
    wrong = WrongHand(0, HandUncertainty(**NONE))
    plant, hand, finger = wrong.plant, wrong.hand, wrong.hand.fingers[0]
    found = calibration_of(wrong.errors, np.zeros(len(wrong.truth)), np.zeros((len(wrong.truth),) * 2), 0.0)
    found.noise.force = found.noise.moment = 1e-12
    found.noise.position, found.noise.normal_deg = 0.0004, 2.0
    kinematics = HandKinematics(plant, hand.palm_frame)
    X_PS, solution = kinematics.poses(hand.sensor_frames)[finger], touch(hand, finger)[1]
    uncertainty = ContactUncertainty(plant, dataclasses.replace(hand, calibration=found), HandUncertainty(**NONE))
    said = uncertainty.covariance(finger, solution, X_PS, kinematics)
    expected = np.diag(np.repeat([0.0004**2, math.radians(2.0) ** 2], 3))
    np.testing.assert_allclose(said, expected, atol=1e-12)
    # The surfaces are off by what differs from finger to finger, root mean square.
    found.fingers[finger].radius.sigma = 0.002
    uncertainty = ContactUncertainty(plant, dataclasses.replace(hand, calibration=found), HandUncertainty(**NONE))
    assert uncertainty.surface_sigma(kinematics) == pytest.approx(0.002 / math.sqrt(len(hand.sensor_frames)))


@pytest.mark.parametrize("left", [None, 0.2], ids=["declared", "left"])
def test_joints_that_a_finger_s_calibration_does_not_list_are_as_uncertain_as_they_are(left: float | None) -> None:
    """As of a file written by hand, which says how thick a fingertip was found to be, and of joints what is left."""
    plant, hand = make_hand_plant(load_hand_config("shadow_like"))
    told, finger = HandUncertainty(**NONE | {"encoder_offset_deg": 1.0}), hand.fingers[0]
    found = HandCalibration(fingers={finger: FingerCalibration()})
    found.noise.position = found.noise.normal_deg = found.noise.moment = found.noise.force = 1e-12
    if left is not None:
        found.joint_offsets = {joint: MeasuredNumber(sigma=left) for joint in encoder_gains(plant, hand).joints}
    kinematics = HandKinematics(plant, hand.palm_frame)
    X_PS, solution = kinematics.poses(hand.sensor_frames)[finger], touch(hand, finger)[1]
    without, said = (
        ContactUncertainty(plant, each, told).covariance(finger, solution, X_PS, kinematics)
        for each in (hand, dataclasses.replace(hand, calibration=found))
    )
    np.testing.assert_allclose(said, without * (1.0 if left is None else left**2), atol=1e-12)


def test_the_surface_of_a_hand_without_fingertips_is_off_by_what_is_told() -> None:
    plant, hand = make_hand_plant(load_hand_config("barrett_like"))
    told = HandUncertainty(**NONE | {"mounting": 0.003, "fingertip_radius": 0.004})
    sigma = ContactUncertainty(plant, hand, told).surface_sigma(HandKinematics(plant, hand.palm_frame))
    assert sigma == pytest.approx(0.005)
