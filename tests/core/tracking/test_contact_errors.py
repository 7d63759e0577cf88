import math

import numpy as np
import pytest

from tactopose_drake.core.evidence.contact_reading import ErrorScales
from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.evidence.evidence import Evidence
from tactopose_drake.core.poses import make_poses, random_rotations
from tactopose_drake.core.tracking.contact_errors import (
    as_doubted,
    averaged_variances,
    calibration_excess,
    follow_doubt,
    read_contacts,
    surest_position,
    with_errors,
)
from tactopose_drake.core.tracking.frame import Frame
from tactopose_drake.core.tracking.tracker_params import PoseTrackerParams
from tests.core.tracking.boxes import SIGMA_NORMAL, SIGMA_POSITION, n_OC, p_OC, read, touch

PARAMS = PoseTrackerParams()
TOLD = PARAMS.calibration_position, math.radians(PARAMS.calibration_normal_deg)
X_PO = make_poses(random_rotations(np.random.default_rng(0), 1), np.array([[0.02, 0.0, 0.1]]))[0]


def test_of_a_mean_of_frames_only_what_is_new_averages_out() -> None:
    contacts = Contacts(p_OC, n_OC, sigma_position=SIGMA_POSITION, sigma_normal=SIGMA_NORMAL)
    one, many = (averaged_variances(contacts, PARAMS, frames) for frames in (1, 10**6))
    np.testing.assert_allclose(one, np.tile([SIGMA_POSITION**2, SIGMA_NORMAL**2], (6, 1)))
    lasting = PARAMS.calibration_position**2 + PARAMS.surface_position**2
    np.testing.assert_allclose(many[:, 0], lasting, rtol=1e-5)


@pytest.mark.parametrize("halvings", [0, 1, 3])
def test_a_point_is_known_at_best_by_a_mean_of_frames_and_the_best_calibration_that_may_be_found(halvings: int) -> None:
    """Variances add up; that of the calibration may be found to be halved so many times."""
    params = PoseTrackerParams()
    params.calibration_scale.halvings = halvings
    frames = params.window.max_frames
    expected = TOLD[0] ** 2 / 2**halvings + params.surface_position**2 + params.frame_position**2 / frames
    assert surest_position(params) == pytest.approx(math.sqrt(expected), rel=1e-12)


def test_a_calibration_that_seems_worse_adds_what_it_errs_beyond_what_is_told() -> None:
    """Of independent errors the variances add up: of the calibration, so many times as told, and of all else."""
    contacts = Contacts(p_OC, n_OC, sigma_position=SIGMA_POSITION, sigma_normal=SIGMA_NORMAL)
    of_all, of_hand = np.square([SIGMA_POSITION, SIGMA_NORMAL]), np.square(TOLD)
    factors = np.array([4.0, 2.25])
    added = calibration_excess(contacts, PARAMS, factors)
    np.testing.assert_allclose(added, np.tile(factors * of_hand - of_hand, (6, 1)))
    np.testing.assert_array_equal(calibration_excess(contacts, PARAMS, np.ones(2)), 0.0)
    reading = with_errors(read(contacts), ErrorScales(calibration=factors), PARAMS)
    np.testing.assert_allclose(reading.parts.new, np.tile(of_all - of_hand, (6, 1)))
    seeming = as_doubted(reading).evidence.contacts
    np.testing.assert_allclose(np.square(seeming.sigma_position), of_all[0] + 3.0 * of_hand[0])
    np.testing.assert_allclose(np.square(seeming.sigma_normal), of_all[1] + 1.25 * of_hand[1])
    # Where contacts are told to be surer than the calibration is, a share of them is new all the same.
    surer = Contacts(p_OC, n_OC, sigma_position=0.5 * TOLD[0], sigma_normal=SIGMA_NORMAL)
    least = PARAMS.contact_update.least_noise_share * 0.5 * TOLD[0]
    np.testing.assert_allclose(read(surer).parts.new[:, 0], least**2)


def test_what_a_hand_declares_beside_its_sensors_and_calibration_lasts() -> None:
    """The variances are those of all parts; where less is told than the calibration's, nothing is beside it."""
    frame = PARAMS.frame_position, math.radians(PARAMS.frame_normal_deg)
    beside, bias = np.array([0.001, 0.05]), np.square([PARAMS.surface_position, math.radians(1.0)])
    told = np.square(frame) + np.square(TOLD) + np.square(beside)
    covariance = np.tile(np.diag(np.repeat(told, 3)), (6, 1, 1))
    reading = read(Contacts(p_OC, n_OC, covariance=covariance))
    np.testing.assert_allclose(reading.parts.told, np.tile(told, (6, 1)))
    np.testing.assert_allclose(reading.parts.declared, np.tile(np.square(beside), (6, 1)))
    np.testing.assert_allclose(reading.parts.new, np.tile(np.square(frame), (6, 1)))
    many = averaged_variances(reading.contacts, PARAMS, 10**9)
    np.testing.assert_allclose(many, np.tile(np.square(beside) + np.square(TOLD) + bias, (6, 1)), rtol=1e-6)
    sure = read(Contacts(p_OC, n_OC, covariance=1e-3 * covariance))
    np.testing.assert_array_equal(sure.parts.declared, 0.0)
    # However sure they are told to be, a mean of them is no less sure.
    np.testing.assert_allclose(averaged_variances(sure.contacts, PARAMS, 8), sure.parts.told)


def test_a_doubted_contact_is_less_sure_by_what_lasts_of_its_mean() -> None:
    contacts = Contacts(p_OC, n_OC, covariance=np.tile(np.diag(np.repeat([0.002**2, 0.2**2], 3)), (6, 1, 1)))
    doubt = np.array([9.0, 1.0, 1.0, 2.0, 1.0, 1.0])
    errors = ErrorScales(doubt=dict(zip("abcdef", doubt, strict=True)))
    reading = with_errors(read(contacts), errors, PARAMS)
    lasts = averaged_variances(contacts, PARAMS, PARAMS.window.max_frames)
    more = (doubt - 1.0)[:, None] * lasts
    np.testing.assert_allclose(reading.parts.excess, reading.parts.declared + more)
    # What was declared is told already.
    seeming = as_doubted(reading).evidence.contacts
    np.testing.assert_allclose(np.square(seeming.sigma_position), reading.parts.told[:, 0] + more[:, 0])
    np.testing.assert_allclose(np.square(seeming.sigma_normal), reading.parts.told[:, 1] + more[:, 1])


@pytest.mark.parametrize(
    ("errors", "is_noticed"),
    [
        (ErrorScales(doubt={"b": 1.05}), False),
        (ErrorScales(calibration=np.array([1.0, 1.05])), False),
        (ErrorScales(doubt={"b": 1.2}), True),
        (ErrorScales(calibration=np.array([1.0, 1.2])), True),
    ],
)
def test_a_doubt_of_a_few_per_cent_is_none(errors: ErrorScales, is_noticed: bool) -> None:
    reading, nothing = (with_errors(read(each), errors, PARAMS) for each in (Contacts(p_OC, n_OC), Contacts.empty()))
    assert (as_doubted(reading) is not reading) == is_noticed
    assert as_doubted(nothing) is nothing


def test_a_source_whose_contacts_seem_false_is_doubted_from_then_on() -> None:
    names = tuple("abcdef")
    doubt = follow_doubt({}, np.array([0.05, 1, 1, 1, 1, 1]), 2.0, names, 1.0)
    assert doubt == pytest.approx({"a": 80.0, **dict.fromkeys(names[1:], 4.0)})
    again = follow_doubt(doubt, np.ones(6), 1.0, names, 0.5)
    assert again["a"] == pytest.approx(80.0**0.5)


def test_a_reading_is_repeated_where_points_and_normals_are() -> None:
    felt = touch(X_PO, np.random.default_rng(0))
    assert felt.n_PC is not None
    others = felt.with_arrays(n_PC=felt.n_PC[::-1].copy())
    for contacts, before, is_new in (
        (felt, Contacts.empty(), True),
        (felt, felt.with_arrays(p_PC=felt.p_PC.copy(), n_PC=felt.n_PC.copy()), False),
        (others, felt, True),
        (felt.with_arrays(p_PC=felt.p_PC + 1e-9), felt, True),
        (Contacts(felt.p_PC), felt, True),
        (Contacts(felt.p_PC), Contacts(felt.p_PC), False),
        (Contacts.empty(), felt, False),
    ):
        names = tuple("abcdef")[: len(contacts)]
        frame = Frame(0.0, Evidence(contacts), names)
        assert read_contacts(frame, (), before, ErrorScales(), PARAMS).is_new == is_new


def test_a_source_keeps_its_place_and_what_touches_anew_comes_behind() -> None:
    contacts = touch(X_PO, np.random.default_rng(0))[:3]
    frame = Frame(0.0, Evidence(contacts), ("ring", "thumb", "first"))
    reading = read_contacts(frame, ("thumb", "little", "ring"), Contacts.empty(), ErrorScales(), PARAMS)
    assert reading.sources == ("thumb", "little", "ring", "first")
    np.testing.assert_array_equal(reading.source, [2, 0, 3])
