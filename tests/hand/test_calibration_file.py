"""calibration.yaml: to disk and back, and what a hand does that names one."""

import dataclasses
import math
import re
from pathlib import Path

import numpy as np
import pytest
import yaml

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.errors import InvalidFileError, InvalidInputError
from tactopose_drake.hand.calibration_file import (
    FingerCalibration,
    HandCalibration,
    load_calibration,
    save_calibration,
)
from tactopose_drake.hand.closed_grasps import ClosedGrasp
from tactopose_drake.hand.hand_check import check_hand
from tactopose_drake.hand.hand_config import HandConfig, HandUncertainty, load_hand_config
from tactopose_drake.hand.hand_errors import HandErrors, calibration_of
from tactopose_drake.hand.hand_in_plant import make_hand_plant
from tactopose_drake.hand.joint_matrices import reading_offsets
from tactopose_drake.hand.named_joints import NamedJoints
from tactopose_drake.resources import model_path
from tactopose_drake.systems.pose_estimation import MakePoseEstimation, PoseEstimationParams
from tests.hand.calibrated_shadow import SOFT, UNCERTAINTY, WrongHand

EXAMPLE = """
grasps: 20
joint_offsets:
  FFJ4: {value: 1.5, sigma: 0.2}
  FFJ2: {value: -0.5, sigma: 0.1}
fingers:
  first:
    moment_bias: {value: [0.001, 0, 0], sigma: [1e-4, 1e-4, 1e-4]}
    force_bias: {value: [0, 0.1, 0], sigma: [0.01, 0.01, 0.01]}
    radius: {value: 0.001, sigma: 0.0001}
    rotation_deg: {value: [0, 0, 2.0], sigma: [0.3, 0.3, 0.3]}
    translation: {value: [0, 0, 0.0005], sigma: [1e-4, 1e-4, 1e-4]}
    joints: [FFJ4, FFJ2]
"""


def write(folder: Path, text: str) -> Path:
    path = folder / "calibration.yaml"
    path.write_text(text)
    return path


def hand_with(folder: Path, text: str = EXAMPLE) -> Path:
    """A hand's file that names a calibration by a path from its own folder."""
    write(folder, text)
    path = folder / "mine.hand.yaml"
    shipped = model_path("hands", "shadow_like", "shadow_like.hand.yaml").read_text()
    plain = shipped[: shipped.index("uncertainty:")]
    path.write_text(plain + "\ncalibration: calibration.yaml\nuncertainty: {encoder_offset_deg: 2.0}\n")
    return path


@pytest.fixture(scope="module", params=[None, SOFT], ids=["rigid", "soft"])
def exactly_known(request: pytest.FixtureRequest) -> tuple[WrongHand, HandCalibration]:
    hand = WrongHand(1, dataclasses.replace(UNCERTAINTY, mounting=0.0005, mounting_deg=1.0), layer=request.param)
    return hand, calibration_of(hand.errors, hand.truth, np.zeros((len(hand.truth), len(hand.truth))), 0.0)


def test_it_comes_back_as_it_was_saved(exactly_known: tuple[WrongHand, HandCalibration], tmp_path: Path) -> None:
    hand, _ = exactly_known
    root = np.random.default_rng(0).normal(size=(len(hand.truth), len(hand.truth)))
    covariance = (root @ root.T) * np.outer(hand.errors.sigma, hand.errors.sigma) / len(root)
    calibration = calibration_of(hand.errors, hand.truth, covariance, 0.0)
    save_calibration(tmp_path / "calibration.yaml", calibration)
    assert load_calibration(tmp_path / "calibration.yaml") == calibration


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (
            "grasps: 20",
            "grasp: 20",
            "line 2: the content must have only the keys grasps, joint_offsets, fingers, noise, undetermined, not "
            "'grasp'",
        ),
        ("value: 1.5", "value: 200.0", "joint_offsets.FFJ4.value must be a number from -90 to 90, not 200"),
        ("sigma: 0.0001}", "sigma: -1}", "fingers.first.radius.sigma must be a number >= 0, not -1"),
        ("value: [0, 0.1, 0]", "value: [0, 0.1]", "fingers.first.force_bias.value"),
        (
            "joints: [FFJ4, FFJ2]",
            "joints: [FFJ9]",
            "each name in fingers.first.joints must be one of FFJ4, FFJ2, not 'FFJ9'",
        ),
        ("joints: [FFJ4, FFJ2]", "joints: [FFJ4]\n    correlation: [[1.0]]", "fingers.first.correlation"),
    ],
)
def test_a_fault_is_said_in_one_line(tmp_path: Path, old: str, new: str, said: str) -> None:
    assert old in EXAMPLE
    with pytest.raises(InvalidFileError) as caught:
        load_hand_config(hand_with(tmp_path, EXAMPLE.replace(old, new)))
    assert said in str(caught.value)
    assert str(tmp_path / "calibration.yaml") in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "entries", [{(0, 1): 0.1}, {(2, 2): 0.9}, {(0, 1): 1.2, (1, 0): 1.2}], ids=["one-sided", "diagonal", "beyond 1"]
)
def test_what_is_no_correlation_matrix_is_refused(entries: dict[tuple[int, int], float]) -> None:
    matrix = np.eye(13)
    FingerCalibration(correlation=matrix.tolist()).validate("first")
    FingerCalibration(correlation=np.ones((13, 13)).tolist()).validate("first")  # All are one error.
    for place, value in entries.items():
        matrix[place] = value
    with pytest.raises(InvalidInputError, match=r"^first\.correlation must be a correlation matrix"):
        FingerCalibration(correlation=matrix.tolist()).validate("first")


def test_names_that_the_hand_has_not_are_refused(tmp_path: Path) -> None:
    config = load_hand_config(hand_with(tmp_path, EXAMPLE.replace("first:", "sixth:")))
    with pytest.raises(
        InvalidFileError, match=r"calibration\.yaml: each name in fingers must be one of first.*, not 'sixth'"
    ):
        make_hand_plant(config)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("FFJ4", "FFJ1", "each name in joint_offsets must be one of .*, not 'FFJ1'"),  # It follows FFJ2.
        (
            "FFJ4",
            "first_tip_weld",
            "each name in joint_offsets must be one of .*, not 'first_tip_weld'",
        ),  # It is fixed.
        ("radius: {value: 0.001", "radius: {value: -0.02", "fingers.first.radius: the fingertip's "),
    ],
)
def test_what_does_not_fit_the_hand_is_said_by_all_that_load_it(tmp_path: Path, old: str, new: str, said: str) -> None:
    path = hand_with(tmp_path, EXAMPLE.replace(old, new))
    with pytest.raises(InvalidFileError) as caught:
        make_hand_plant(load_hand_config(path))
    assert re.match(rf"{tmp_path / 'calibration.yaml'}: {said}", str(caught.value))
    (fault,) = check_hand(path).faults
    assert fault.part == "calibration"
    assert re.search(said, fault.text)


def test_a_check_says_that_a_calibration_fits(tmp_path: Path) -> None:
    check = check_hand(hand_with(tmp_path))
    assert not check.faults
    assert "calibration.yaml is of the hand's joints and fingers" in {finding.text for finding in check.findings}


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    path = hand_with(tmp_path)
    (tmp_path / "calibration.yaml").unlink()
    with pytest.raises(InvalidFileError, match=r"calibration\.yaml cannot be read"):
        load_hand_config(path)


def test_followers_are_off_with_what_they_follow(tmp_path: Path) -> None:
    plant, hand = make_hand_plant(load_hand_config(hand_with(tmp_path)))
    offsets = dict(zip(NamedJoints(plant, hand).names, reading_offsets(plant, hand), strict=True))
    assert offsets["FFJ4"] == pytest.approx(math.radians(1.5))
    assert offsets["FFJ2"] == offsets["FFJ1"] == pytest.approx(math.radians(-0.5))
    assert offsets["THJ1"] == 0.0
    plain, bare = make_hand_plant(load_hand_config("shadow_like"))
    assert not reading_offsets(plain, bare).any()


def contacts_of(wrong: WrongHand, config: HandConfig, grasp: ClosedGrasp) -> tuple[Contacts, tuple[str, ...]]:
    """What the diagram of a configuration makes of the readings of a grasp by that hand."""
    params = PoseEstimationParams(check_collisions=False, use_hand_volume=False)
    diagram = MakePoseEstimation(config, grasp.recorded.model, params)
    context = diagram.CreateDefaultContext()
    q = NamedJoints(wrong.plant, wrong.hand).positions("q", dict(grasp.recorded.joint_positions))
    diagram.GetInputPort("joint_positions").FixValue(context, np.nan_to_num(q))
    for finger in wrong.hand.sensor_frames:
        wrench = grasp.recorded.wrenches.get(finger, np.full(6, np.nan))
        diagram.GetInputPort(f"wrench_{finger}").FixValue(context, wrench)
    contacts = diagram.GetOutputPort("contacts").Eval(context)
    return contacts, diagram.GetOutputPort("fingers_in_contact").Eval(context)


def test_a_diagram_that_loads_the_hand_corrects_its_readings(
    exactly_known: tuple[WrongHand, HandCalibration], blob: ObjectModel, tmp_path: Path
) -> None:
    hand, calibration = exactly_known
    save_calibration(tmp_path / "calibration.yaml", calibration)
    (grasp,) = hand.close(blob, 1)
    as_it_is, _ = contacts_of(hand, hand.config, grasp)
    known = dataclasses.replace(hand.config, calibration=str(tmp_path / "calibration.yaml"))
    corrected, fingers = contacts_of(hand, known, grasp)
    assert set(fingers) == set(grasp.recorded.wrenches)

    def distances(contacts: Contacts) -> np.ndarray:
        p_O = (contacts.p_PC - grasp.X_PO[:, 3]) @ grasp.X_PO[:, :3]
        return np.abs(blob.grid.distance(p_O))

    assert distances(corrected).max() < 5e-6
    assert np.median(distances(as_it_is)) > 0.0005
    _, normals = blob.grid.distance_and_normal((corrected.p_PC - grasp.X_PO[:, 3]) @ grasp.X_PO[:, :3])
    assert corrected.n_PC is not None
    np.testing.assert_allclose(corrected.n_PC @ grasp.X_PO[:, :3], normals, atol=1e-4)


def test_the_uncertainty_is_what_the_calibration_left(blob: ObjectModel, tmp_path: Path) -> None:
    """The contacts' covariances, against errors drawn from the calibration's own."""
    hand = WrongHand(2, HandUncertainty())
    (grasp,) = hand.close(blob, 1)
    generator = np.random.default_rng(5)
    root = generator.normal(size=(len(hand.truth), len(hand.truth))) / math.sqrt(len(hand.truth))
    covariance = 0.09 * (root @ root.T) * np.outer(hand.errors.sigma, hand.errors.sigma)
    path = tmp_path / "calibration.yaml"
    calibration = calibration_of(hand.errors, hand.truth, covariance, 0.0)
    calibration.noise.position, calibration.noise.normal_deg = 1e-6, 1e-3
    calibration.noise.force, calibration.noise.moment = 1e-6, 1e-8
    save_calibration(path, calibration)
    config = dataclasses.replace(hand.config, calibration=str(path))
    said, fingers = contacts_of(hand, config, grasp)
    assert said.covariance is not None
    draws = []
    for drawn in generator.multivariate_normal(hand.truth, covariance, 60):
        exact = calibration_of(hand.errors, drawn, np.zeros_like(covariance), 0.0)
        for finger in exact.fingers.values():
            finger.correlation = []  # of nothing, and long to read
        save_calibration(path, exact)
        plain = dataclasses.replace(config, uncertainty=None)
        draws.append(contacts_of(hand, plain, grasp)[0].p_PC)
    spread = np.var(np.array(draws), axis=0)
    expected = np.array([np.diag(matrix)[:3] for matrix in said.covariance])
    assert len(fingers) == len(expected)
    ratio = np.sqrt(spread.sum() / expected.sum())
    assert 0.8 < ratio < 1.25
    wide = contacts_of(hand, hand.config, grasp)[0].covariance
    assert wide is not None
    assert np.trace(said.covariance[0, :3, :3]) < 0.3 * np.trace(wide[0, :3, :3])


def test_a_tare_takes_the_place_of_the_biases_that_were_found(
    exactly_known: tuple[WrongHand, HandCalibration], blob: ObjectModel, tmp_path: Path
) -> None:
    hand, calibration = exactly_known
    (grasp,) = hand.close(blob, 1)
    save_calibration(tmp_path / "calibration.yaml", calibration)
    known = dataclasses.replace(hand.config, calibration=str(tmp_path / "calibration.yaml"))
    tared = dataclasses.replace(known, fingers=[dataclasses.replace(finger, tared=True) for finger in known.fingers])
    unbiased = dataclasses.replace(
        grasp.recorded,
        wrenches={
            finger: wrench - calibration.fingers[finger].bias for finger, wrench in grasp.recorded.wrenches.items()
        },
    )
    before, _ = contacts_of(hand, known, grasp)
    after, _ = contacts_of(hand, tared, dataclasses.replace(grasp, recorded=unbiased))
    np.testing.assert_allclose(after.p_PC, before.p_PC, atol=1e-9)
    assert before.covariance is not None
    assert after.covariance is not None
    wider = [
        np.linalg.eigvalsh(wide - narrow) for wide, narrow in zip(after.covariance, before.covariance, strict=True)
    ]
    assert np.min(wider) > -1e-12
    assert np.max(wider, axis=1).min() > 1e-9


def test_after_a_tare_the_rest_is_known_as_well_as_before() -> None:
    generator = np.random.default_rng(3)
    root = generator.normal(size=(15, 15))
    covariance = root @ root.T
    sigma = np.sqrt(np.diag(covariance))
    correlation = covariance / np.outer(sigma, sigma)
    before = FingerCalibration(joints=["FFJ4", "FFJ2"], correlation=correlation.tolist())
    after = before.after_tare(0.001, 0.1)
    rest = np.r_[:2, 8:15]
    np.testing.assert_allclose(np.array(after.correlation)[np.ix_(rest, rest)], correlation[np.ix_(rest, rest)])
    np.testing.assert_array_equal(np.array(after.correlation)[2:8], np.eye(15)[2:8])
    np.testing.assert_array_equal(after.sigma[:6], np.repeat([0.001, 0.1], 3))
    assert before.correlation == correlation.tolist()
    after.validate("first")


def test_it_is_plain_yaml(exactly_known: tuple[WrongHand, HandCalibration], tmp_path: Path) -> None:
    save_calibration(tmp_path / "calibration.yaml", exactly_known[1])
    read = yaml.safe_load((tmp_path / "calibration.yaml").read_text())
    assert read["joint_offsets"]["FFJ4"].keys() == {"value", "sigma"}
    assert len(read["fingers"]["thumb"]["correlation"]) == 5 + 13


def test_biases_that_drift_are_those_of_the_time_that_is_asked_for() -> None:
    plant, hand = make_hand_plant(load_hand_config("shadow_like"))
    errors = HandErrors.of(plant, hand, HandUncertainty(), span=100.0)
    finger, vector = errors.fingers[0], np.zeros(len(errors.sigma))
    bias, drift = errors.place(finger, "bias"), errors.place(finger, "drift")
    vector[bias], vector[drift] = [1e-3, 2e-3, 3e-3, 0.1, 0.2, 0.3], np.repeat([1e-5, -1e-3], 3)
    covariance = np.zeros((len(vector),) * 2)
    covariance[bias, bias], covariance[drift, drift] = 0.04 * np.eye(6), 1e-6 * np.eye(6)
    covariance[bias, drift] = covariance[drift, bias] = -1e-4 * np.eye(6)
    found = calibration_of(errors, vector, covariance, 50.0).fingers[finger]
    np.testing.assert_allclose(found.bias, [1.5e-3, 2.5e-3, 3.5e-3, 0.05, 0.15, 0.25])
    np.testing.assert_allclose(found.sigma[:6], math.sqrt(0.04 + 50.0**2 * 1e-6 - 2.0 * 50.0 * 1e-4), rtol=1e-5)
    np.testing.assert_array_equal(found.sigma[6:], 0.0)
