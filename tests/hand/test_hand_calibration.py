"""A hand's errors from grasps of a known object in unknown poses."""

import contextlib
import dataclasses
import functools
import math
from collections.abc import Collection
from pathlib import Path

import numpy as np
import pytest

from tactopose_drake.core.calibration.annealed_fit import ContactNoise, anneal, start_noise
from tactopose_drake.core.calibration.shared_least_squares import SharedProblem
from tactopose_drake.core.poses import increments_between
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.errors import InvalidInputError, UnknownNameError
from tactopose_drake.hand.calibration_file import load_calibration
from tactopose_drake.hand.closed_grasps import ClosedGrasp, ClosedGraspParams
from tactopose_drake.hand.felt_grasps import FeltGrasps
from tactopose_drake.hand.hand_calibration import CalibrationParams, CalibrationResult, calibrate_hand
from tactopose_drake.hand.hand_config import HandUncertainty
from tactopose_drake.hand.recorded_grasps import RecordedGrasp, check_silence
from tests.hand.calibrated_shadow import SOFT, UNCERTAINTY, WrongHand, shifted

NOISE = ClosedGraspParams(noise_surface=0.0003, noise_normal_deg=1.5, noise_moment=0.00002, noise_force=0.004)
NONE = {field.name: 0.0 for field in dataclasses.fields(HandUncertainty)}
THICKNESS = HandUncertainty(**NONE | {"fingertip_radius": 0.001})
EXACT = CalibrationParams(sigma_position=0.00005, sigma_normal_deg=0.2)


@pytest.fixture(scope="module")
def wrong_hand() -> WrongHand:
    return WrongHand(3)


@pytest.fixture(scope="module")
def grasps(wrong_hand: WrongHand, blob: ObjectModel) -> list[ClosedGrasp]:
    """Without any noise."""
    return wrong_hand.close(blob, 14)


@pytest.fixture(scope="module")
def result(wrong_hand: WrongHand, grasps: list[ClosedGrasp]) -> CalibrationResult:
    return calibrate_hand(wrong_hand.config, [grasp.recorded for grasp in grasps], EXACT)


def test_grasps_without_noise_give_the_truth(
    result: CalibrationResult, wrong_hand: WrongHand, grasps: list[ClosedGrasp]
) -> None:
    assert result.converged
    assert result.grasp_weights.min() > 0.99
    true_X_PO = np.array([grasp.X_PO for grasp in grasps])
    moved = np.linalg.norm(increments_between(result.X_PO, true_X_PO)[:, 3:], axis=1)
    assert moved.max() < 0.001
    assert result.pose_probability.min() > 0.99
    for finger, residuals in result.after.items():
        # One contact in ten may be beside what the others agree on, at a fold of the distance field.
        assert np.quantile(np.abs(residuals.distance), 0.9) < 0.00003, finger
        assert np.degrees(np.quantile(residuals.angle, 0.9)) < 0.5, finger
        assert np.median(np.abs(result.before[finger].distance)) > 0.0003, finger


def test_from_the_true_poses_exact_readings_give_the_true_errors(
    wrong_hand: WrongHand, grasps: list[ClosedGrasp], blob: ObjectModel
) -> None:
    recorded, errors = [grasp.recorded for grasp in grasps], wrong_hand.errors
    felt = FeltGrasps(wrong_hand.plant, wrong_hand.hand, errors, recorded)
    problem = SharedProblem(felt.touches, [blob.grid] * len(recorded), *felt.readings(recorded))
    noise = ContactNoise(felt.wrench_noise(), 0.00005, math.radians(0.2))
    X_PO, none = np.array([grasp.X_PO for grasp in grasps]), np.zeros(len(errors.free))
    solution = anneal(problem, none, X_PO, noise, start_noise(felt.touches(none), noise)).solution
    off = solution.shared - wrong_hand.truth[errors.free] / errors.sigma[errors.free]
    variances, directions = np.linalg.eigh(solution.covariance)
    well = variances < 0.05**2
    assert well.sum() > 20
    assert np.abs(directions[:, well].T @ off).max() < 0.1
    assert np.abs(directions[:, well].T @ off / np.sqrt(variances[well])).max() < 4.0
    moved = np.linalg.norm(increments_between(solution.X_PO, X_PO)[:, 3:], axis=1)
    assert np.median(moved) < 0.0005


def test_a_grasp_that_is_wrong_is_left_out(
    result: CalibrationResult, wrong_hand: WrongHand, grasps: list[ClosedGrasp]
) -> None:
    recorded = [grasp.recorded for grasp in grasps]
    recorded[5] = shifted(recorded[5], 0.35)
    found = calibrate_hand(wrong_hand.config, recorded, EXACT)
    assert found.grasp_weights[5] < 0.5
    assert found.pose_probability[5] < 0.01
    assert np.sum(found.grasp_weights > 0.5) == len(grasps) - 1
    assert np.abs((found.values - result.values) / np.maximum(found.sigma, result.sigma)).max() < 2.0


def test_contacts_of_soft_fingertips_with_the_true_errors_are_on_the_object(blob: ObjectModel) -> None:
    hand = WrongHand(3, layer=SOFT)
    closed = hand.close(blob, 4)
    felt = FeltGrasps(hand.plant, hand.hand, hand.errors, [grasp.recorded for grasp in closed])
    touches = felt.touches(hand.truth[hand.errors.free] / hand.errors.sigma[hand.errors.free])
    assert touches.valid.all()
    X_PO = np.array([closed[g].X_PO for g in touches.grasp])
    p_O = np.einsum("nji,nj->ni", X_PO[:, :, :3], touches.p_PC - X_PO[:, :, 3])
    assert np.abs(blob.grid.distance(p_O)).max() < 1e-6
    # Of the fingers' noise, the skin has a part: a turn of the normal by what it gives way.
    rigid = FeltGrasps(hand.plant, WrongHand(3).hand, hand.errors, [grasp.recorded for grasp in closed])
    assert np.all(felt.wrench_noise().normal != rigid.wrench_noise().normal)


@functools.cache
def coverage(seed: int, model: ObjectModel) -> np.ndarray:
    """Deviations of a calibration's values over its standard deviations; it begins at the true poses."""
    wrong_hand = WrongHand(seed)
    closed = wrong_hand.close(model, 12, NOISE)
    recorded = [grasp.recorded for grasp in closed]
    felt = FeltGrasps(wrong_hand.plant, wrong_hand.hand, wrong_hand.errors, recorded)
    problem = SharedProblem(felt.touches, [model.grid] * len(recorded), *felt.readings(recorded))
    noise = ContactNoise(felt.wrench_noise(), 0.0003, math.radians(1.5))
    X_PO, none = np.array([grasp.X_PO for grasp in closed]), np.zeros(len(wrong_hand.errors.free))
    solution = anneal(problem, none, X_PO, noise, start_noise(felt.touches(none), noise)).solution
    off = felt.vector(solution.shared) - wrong_hand.truth
    free = wrong_hand.errors.free
    return off[free] / wrong_hand.errors.sigma[free] / np.sqrt(np.diag(solution.covariance))


def test_the_intervals_hold_the_truth_as_often_as_they_say(blob: ObjectModel) -> None:
    scaled = np.concatenate([coverage(seed, blob) for seed in (10, 11, 12)])
    assert len(scaled) == 3 * 53
    assert 0.88 < np.mean(np.abs(scaled) < 1.96) <= 0.99
    assert 0.75 < np.sqrt(np.mean(scaled**2)) < 1.25


def test_what_grasps_cannot_tell_is_named(blob: ObjectModel) -> None:
    # Where the sensors sit to 0.1 mm is nothing that contacts known to 0.3 mm can tell.
    hand = WrongHand(4, dataclasses.replace(UNCERTAINTY, mounting=0.00002))
    recorded = [grasp.recorded for grasp in hand.close(blob, 6, NOISE)]
    found = calibrate_hand(hand.config, recorded)
    texts = [combination.text for combination in found.undetermined]
    assert sum("mounting translation" in text for text in texts) >= 12
    assert list(found.calibration.undetermined) == texts
    determined = [name for name in found.names if name.endswith("radius")]
    assert not [text for text in texts if any(text == name for name in determined)]


def test_readings_out_of_touch_give_the_biases_and_their_drift(blob: ObjectModel) -> None:
    times = [100.0 * k for k in range(8)]
    hand = WrongHand(5, span=times[-1])
    middle = 0.5 * times[-1]
    closed = hand.close(blob, 8, NOISE, [time - middle for time in times])
    recorded = []
    for grasp, time in zip(closed, times, strict=True):
        silent = {}
        for finger in hand.errors.fingers:
            own = hand.errors.of_finger(hand.truth, finger)
            silent[finger] = own.bias + (time - middle) * own.drift
        recorded.append(dataclasses.replace(grasp.recorded, time=time, out_of_touch=silent))
    found = calibrate_hand(hand.config, recorded)
    for finger, calibration in found.calibration.fingers.items():
        own = hand.errors.of_finger(hand.truth, finger)
        # That of the last recording.
        np.testing.assert_allclose(calibration.bias, own.bias + middle * own.drift, atol=0.005)
        assert max(calibration.force_bias.sigma) < 0.01
    drifts = [name for name in found.names if "drift" in name]
    assert len(drifts) == 30


def test_a_touch_that_is_told_for_silence_is_refused(blob: ObjectModel) -> None:
    hand = WrongHand(6)
    recorded = [grasp.recorded for grasp in hand.close(blob, 3, NOISE)]
    pressed = dataclasses.replace(recorded[1], out_of_touch={"little": [0.0, 0.0, 0.0, 0.0, 2.0, 0.0]}, name="one.yaml")
    said = r"^one\.yaml: out_of_touch\.little must be a force up to 0\.6 N, 6 times .*, not \[0\.0, 2\.0, 0\.0\] N\. "
    with pytest.raises(InvalidInputError, match=said):
        calibrate_hand(hand.config, [recorded[0], pressed, recorded[2]])


@pytest.mark.parametrize(
    ("reading", "uncertainty", "said"),
    [
        ([0.004, -0.004, 0.004, 0.5, -0.5, 0.5], {}, None),
        ([0.0, 0.0, 0.0, 0.0, 0.0, -0.9], {}, "a force up to 0.6 N"),
        ([0.0, 0.0, -0.02, 0.0, 0.0, 0.0], {}, "a moment up to 0.00"),
        ([0.02, 0.0, 0.0, 0.0, 0.0, 0.0], {}, "a moment up to 0.00"),
        # Of a bias that is told to be none nothing is found, and so it spoils nothing.
        ([0.02, 0.0, 0.0, 0.0, 0.0, 0.0], {"sensor_moment": 0.0}, None),
        ([0.0, 0.0, 0.0, 2.0, 0.0, 0.0], {"sensor_force": 0.0}, None),
    ],
)
def test_what_touches_nothing_reads_no_more_than_its_bias_may_be(
    blob: ObjectModel, reading: list[float], uncertainty: dict[str, float], said: str | None
) -> None:
    hand = WrongHand(0, dataclasses.replace(UNCERTAINTY, **uncertainty))
    silent = RecordedGrasp(blob, {}, {}, {"ring": reading})
    refused = contextlib.nullcontext() if said is None else pytest.raises(InvalidInputError, match=said)
    with refused:
        check_silence(hand.errors, [silent])


@pytest.mark.parametrize("drifts", [False, True])
def test_readings_out_of_touch_that_differ_count_for_what_they_agree_on(blob: ObjectModel, drifts: bool) -> None:
    hand = WrongHand(6, span=100.0 if drifts else 0.0)
    generator, count, spread = np.random.default_rng(0), 30, np.repeat([0.0005, 0.05], 3)
    grasp = hand.close(blob, 1)[0].recorded
    recorded = [
        dataclasses.replace(
            grasp, time=100.0 * k / (count - 1), out_of_touch={"thumb": spread * generator.normal(size=6)}
        )
        for k in range(count)
    ]
    rows, _ = FeltGrasps(hand.plant, hand.hand, hand.errors, recorded).readings(recorded)
    place = hand.errors.place("thumb", "bias")
    of_bias = rows[:, np.searchsorted(hand.errors.free, np.arange(place.start, place.stop))]
    sigma = hand.errors.sigma[place] / np.sqrt(np.sum(of_bias**2, axis=0))
    np.testing.assert_allclose(sigma, spread / math.sqrt(count), rtol=0.2)


def test_errors_of_zero_are_not_looked_for(blob: ObjectModel) -> None:
    hand = WrongHand(6, THICKNESS)
    found = calibrate_hand(hand.config, [grasp.recorded for grasp in hand.close(blob, 5, NOISE)])
    assert set(found.names) == {f"{finger} radius" for finger in hand.errors.fingers}
    for finger in hand.errors.fingers:
        assert found.calibration.fingers[finger].radius.value == pytest.approx(
            hand.error(f"{finger} radius"), abs=5.0 * found.calibration.fingers[finger].radius.sigma
        )
    assert all(offset.value == 0.0 and offset.sigma == 0.0 for offset in found.calibration.joint_offsets.values())


def in_newton_millimetres(grasp: RecordedGrasp, fingers: Collection[str]) -> RecordedGrasp:
    """The same grasp with the moments of some fingers in another unit."""
    scale = np.repeat([1000.0, 1.0], 3)
    wrenches = {f: w * scale if f in fingers else w for f, w in grasp.wrenches.items()}
    return dataclasses.replace(grasp, wrenches=wrenches)


def test_a_finger_without_any_contact_is_named(blob: ObjectModel) -> None:
    hand = WrongHand(6, THICKNESS)
    recorded = [in_newton_millimetres(grasp.recorded, ["first"]) for grasp in hand.close(blob, 5, NOISE)]
    found = calibrate_hand(hand.config, recorded)
    assert set(found.without_contact) == {"first"}
    assert found.without_contact["first"] == "no single contact explains the wrench: the force passes the surface by"
    assert found.contact_weights["first"].max() < 0.5
    others = np.concatenate([weights for finger, weights in found.contact_weights.items() if finger != "first"])
    assert len(others) >= 15
    assert np.median(others) > 0.9
    assert found.calibration.fingers["first"].radius.sigma == pytest.approx(THICKNESS.fingertip_radius, rel=1e-6)


def test_grasps_that_are_no_evidence_give_no_calibration(blob: ObjectModel) -> None:
    hand = WrongHand(6, THICKNESS)
    recorded = [grasp.recorded for grasp in hand.close(blob, 4, NOISE)]
    every = [in_newton_millimetres(grasp, hand.errors.fingers) for grasp in recorded]
    with pytest.raises(
        InvalidInputError,
        match=r"^grasps must have a contact in at least 3, not in 0 of 4\. No wrench of first gives one: no sin",
    ):
        calibrate_hand(hand.config, every)
    with pytest.raises(InvalidInputError, match=r"^grasps must have a contact in at least 3, not in 2 of 4\."):
        calibrate_hand(hand.config, [*recorded[:2], *every[2:]])
    wrong = [*recorded[:2], *(shifted(grasp, 0.35) for grasp in recorded[2:])]
    with pytest.raises(
        InvalidInputError, match=r"^grasps must be explained together in at least 3, .*, not in \d of 4"
    ):
        calibrate_hand(hand.config, wrong)


def test_progress_is_told(blob: ObjectModel) -> None:
    told: list[tuple[float, str]] = []
    hand = WrongHand(6, THICKNESS)
    grasps = [grasp.recorded for grasp in hand.close(blob, 3, NOISE)]
    calibrate_hand(hand.config, grasps, on_progress=lambda share, doing: told.append((share, doing)))
    shares = [share for share, _ in told]
    assert shares == sorted(shares)
    assert shares[0] == 0.0
    assert all(share < 1.0 for share in shares)
    assert "fitting the hand" in [doing for _, doing in told]


def test_unusable_grasps_are_refused_by_name(wrong_hand: WrongHand, grasps: list[ClosedGrasp]) -> None:
    recorded = [grasp.recorded for grasp in grasps[:4]]
    config = wrong_hand.config
    with pytest.raises(InvalidInputError, match="grasps must be at least 3, not 2"):
        calibrate_hand(config, recorded[:2])
    stranger = dataclasses.replace(recorded[0], wrenches={"sixth": np.zeros(6)}, name="one.yaml")
    with pytest.raises(UnknownNameError, match=r"one\.yaml: each name in wrenches must be one of first.*, not 'sixth'"):
        calibrate_hand(config, [*recorded, stranger])
    lacking = {name: value for name, value in recorded[0].joint_positions.items() if name != "THJ5"}
    with pytest.raises(
        InvalidInputError, match=r"grasps\[4\]: joint_positions must have a number for each joint, but lack THJ5"
    ):
        calibrate_hand(config, [*recorded, dataclasses.replace(recorded[0], joint_positions=lacking)])
    weights = {"first": [0.0, 0.0, 0.0, 0.0, 0.0, 1200.0]}
    with pytest.raises(InvalidInputError, match=r"grasps\[4\]: wrenches\.first must be moments up to 100 N m, .*, not"):
        calibrate_hand(config, [*recorded, dataclasses.replace(recorded[0], wrenches=weights)])
    with pytest.raises(InvalidInputError, match=r"wrenches\.first"):
        calibrate_hand(config, [*recorded, dataclasses.replace(recorded[0], wrenches={"first": [1.0, 2.0]})])
    frozen = {"first": np.array(recorded[0].wrenches["first"])}
    with pytest.raises(
        InvalidInputError, match=r"^grasps\[4\]: wrenches\.first must differ from that of grasps\[0\], not be identical"
    ):
        calibrate_hand(config, [*recorded, dataclasses.replace(recorded[1], wrenches=frozen)])
    with pytest.raises(InvalidInputError, match="uncertainty must have at least one error above 0"):
        calibrate_hand(dataclasses.replace(config, uncertainty=HandUncertainty(**NONE)), recorded)


def test_a_hand_without_force_torque_sensors_is_refused_in_words(blob: ObjectModel) -> None:
    for wrenches in ({}, {"finger_1": np.ones(6)}):
        grasps = [RecordedGrasp(blob, {}, wrenches, time=float(k)) for k in range(4)]
        with pytest.raises(InvalidInputError, match=r"^hand must have fingers with a force-torque sensor, but has"):
            calibrate_hand("barrett_like", grasps)


def test_what_is_no_hand_no_grasps_and_no_parameters_is_named(wrong_hand: WrongHand, grasps: list[ClosedGrasp]) -> None:
    recorded = [grasp.recorded for grasp in grasps[:4]]
    with pytest.raises(InvalidInputError, match=r"^hand must be a HandConfig, a hand's name .*, not None"):
        calibrate_hand(None, recorded)
    for value, kind in ((3, "an int"), ("grasps", "a str"), (Path("grasps"), "a .*Path")):
        with pytest.raises(
            InvalidInputError, match=f"^grasps must be a sequence .* `load_grasps` of .* from a folder, not {kind}"
        ):
            calibrate_hand(wrong_hand.config, value)
    with pytest.raises(InvalidInputError, match=r"^params must be a CalibrationParams, not an int"):
        calibrate_hand(wrong_hand.config, recorded, 5)


def test_what_is_saved_is_what_was_found(result: CalibrationResult, tmp_path: Path) -> None:
    result.save(tmp_path / "calibration.yaml")
    assert load_calibration(tmp_path / "calibration.yaml") == result.calibration
