import dataclasses
import math

import numpy as np
import pytest

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.poses import make_poses, random_rotations, retract
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.tracking.contact_errors import (
    as_doubted,
    averaged_variances,
    calibration_excess,
    estimate_scale,
    follow_doubt,
    follow_scale,
    with_errors,
)
from tactopose_drake.core.tracking.frame import ContactReading, SeemingErrors
from tactopose_drake.core.tracking.motion_prediction import MotionNoise, move_with_palm
from tactopose_drake.core.tracking.slip_by_surface import PoseChange, SlipTest, detect_slip
from tactopose_drake.core.tracking.tracker_params import PoseTrackerParams
from tests.core.tracking.boxes import SIGMA_NORMAL, SIGMA_POSITION, draw_biases, make_box, n_OC, p_OC, read, touch

PARAMS = PoseTrackerParams()
TOLD = PARAMS.calibration_position, math.radians(PARAMS.calibration_normal_deg)
X_PO = make_poses(random_rotations(np.random.default_rng(0), 1), np.array([[0.02, 0.0, 0.1]]))[0]
ALL = np.ones(6)
REST = move_with_palm(MotionNoise(), 0.01, slips=False)


@pytest.fixture(scope="module")
def box() -> ObjectModel:
    return make_box()


def feel(
    box: ObjectModel, seed: int, scale: float, X_hat: np.ndarray = X_PO, frames: int = 20
) -> tuple[ContactReading, SlipTest]:
    """The last reading of a box that is held still, and the residuals of all at a pose; the hand errs by the scale."""
    generator, test = np.random.default_rng(seed), SlipTest()
    bias, still = scale * draw_biases(generator, *TOLD), PoseChange(X_hat, np.zeros((6, 2)), REST)
    for _ in range(frames):
        reading = read(touch(X_PO, generator, bias, TOLD))
        test, _ = detect_slip(box, PARAMS.slip, test, reading, still)
    return reading, test


def scales(box: ObjectModel, scale: float) -> np.ndarray:
    """Of some hands, the root of the factors' geometric mean."""
    found = [estimate_scale(box, PARAMS, *feel(box, seed, scale), X_PO, ALL) for seed in range(8)]
    return np.array([math.sqrt(math.sqrt(factors[0] * factors[1])) for factors in found if factors is not None])


def test_of_a_mean_of_frames_only_what_is_new_averages_out() -> None:
    contacts = Contacts(p_OC, n_OC, sigma_position=SIGMA_POSITION, sigma_normal=SIGMA_NORMAL)
    one, many = (averaged_variances(contacts, PARAMS, frames) for frames in (1, 10**6))
    np.testing.assert_allclose(one, np.tile([SIGMA_POSITION**2, SIGMA_NORMAL**2], (6, 1)))
    lasting = PARAMS.calibration_position**2 + PARAMS.surface_position**2
    np.testing.assert_allclose(many[:, 0], lasting, rtol=1e-5)


def test_a_calibration_that_seems_worse_adds_what_it_errs_beyond_what_is_told() -> None:
    """Of independent errors the variances add up: of the calibration, so many times as told, and of all else."""
    contacts = Contacts(p_OC, n_OC, sigma_position=SIGMA_POSITION, sigma_normal=SIGMA_NORMAL)
    of_all, of_hand = np.square([SIGMA_POSITION, SIGMA_NORMAL]), np.square(TOLD)
    factors = np.array([4.0, 2.25])
    added = calibration_excess(contacts, PARAMS, factors)
    np.testing.assert_allclose(added, np.tile(factors * of_hand - of_hand, (6, 1)))
    np.testing.assert_array_equal(calibration_excess(contacts, PARAMS, np.ones(2)), 0.0)
    reading = with_errors(read(contacts), ALL, factors, PARAMS)
    np.testing.assert_allclose(reading.parts.new, np.tile(of_all - of_hand, (6, 1)))
    seeming = as_doubted(reading).evidence.contacts
    np.testing.assert_allclose(np.square(seeming.sigma_position), of_all[0] + 3.0 * of_hand[0])
    np.testing.assert_allclose(np.square(seeming.sigma_normal), of_all[1] + 1.25 * of_hand[1])
    # Where contacts are told to be surer than the calibration is, a share of them is new all the same.
    surer = Contacts(p_OC, n_OC, sigma_position=0.5 * TOLD[0], sigma_normal=SIGMA_NORMAL)
    least = PARAMS.contact_update.least_noise_share * 0.5 * TOLD[0]
    np.testing.assert_allclose(read(surer).parts.new[:, 0], least**2)


def test_a_source_whose_contacts_seem_false_is_doubted_from_then_on() -> None:
    names = tuple("abcdef")
    doubt = follow_doubt({}, np.array([0.05, 1, 1, 1, 1, 1]), 2.0, names, 1.0)
    assert doubt == pytest.approx({"a": 80.0, **dict.fromkeys(names[1:], 4.0)})
    again = follow_doubt(doubt, np.ones(6), 1.0, names, 0.5)
    assert again["a"] == pytest.approx(80.0**0.5)


@pytest.mark.parametrize("scale", [1.0, 2.0, 4.0])
def test_the_scale_is_found_up_to_a_factor(box: ObjectModel, scale: float) -> None:
    found = scales(box, scale)
    assert len(found) == 8
    assert 0.75 * scale < np.median(found) < 1.5 * scale
    assert np.all((found > 0.4 * scale) & (found < 2.5 * scale))


def test_where_the_pose_is_believed_to_be_has_no_part_in_it(box: ObjectModel) -> None:
    X_near = retract(X_PO, np.array([0.02, -0.01, 0.02, 0.002, -0.002, 0.001]))
    at_truth, beside = (estimate_scale(box, PARAMS, *feel(box, 3, 2.0, X), X, ALL) for X in (X_PO, X_near))
    assert at_truth is not None
    np.testing.assert_allclose(beside, at_truth, rtol=0.1)


def test_a_contact_that_seems_false_tells_nothing_of_the_calibration(box: ObjectModel) -> None:
    generator, test, still = np.random.default_rng(1), SlipTest(), PoseChange(X_PO, np.zeros((6, 2)), REST)
    bias = draw_biases(generator, *TOLD)
    bias[2, :3] += [0.0, 0.0, 0.02]
    bias[3, :3] -= 0.02 * X_PO[:, 1]
    for _ in range(20):
        reading = read(touch(X_PO, generator, bias, TOLD))
        test, _ = detect_slip(box, PARAMS.slip, test, reading, still)
    believed = estimate_scale(box, PARAMS, reading, test, X_PO, ALL)
    without = estimate_scale(box, PARAMS, reading, test, X_PO, np.array([0.9, 0.8, 0.01, 0.02, 0.9, 0.9]))
    assert believed is not None
    assert without is not None
    assert believed[0] > 10.0
    assert without[0] < 3.0


def test_too_few_contacts_or_frames_and_touch_without_normals_tell_nothing(box: ObjectModel) -> None:
    reading, test = feel(box, 0, 4.0)
    two = read(reading.contacts[:2], np.arange(2))
    bare = Contacts(reading.contacts.p_PC, None, sigma_position=reading.contacts.sigma_position)
    once = feel(box, 0, 4.0, frames=1)
    for little in ((two, test), (read(bare), test), once, (reading, test.restarted())):
        assert estimate_scale(box, PARAMS, *little, X_PO, ALL[: len(little[0].contacts)]) is None
    kept = SeemingErrors(calibration=np.array([2.0, 3.0]), estimates=4)
    assert follow_scale(kept, None, PARAMS.calibration_scale) is kept


def test_the_factors_are_a_mean_in_which_later_estimates_count_at_least_as_told(box: ObjectModel) -> None:
    settings = dataclasses.replace(PARAMS.calibration_scale, least_share=0.5)
    errors = SeemingErrors()
    for now, expected in ((4.0, 4.0), (16.0, 8.0), (0.5, 2.0)):
        errors = follow_scale(errors, np.full(2, now), settings)
        np.testing.assert_allclose(errors.calibration, expected)
    assert errors.estimates == 3
