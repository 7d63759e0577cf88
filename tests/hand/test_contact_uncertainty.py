"""How far a hand's errors move its contacts, against the same errors drawn at random."""

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
from pydrake.math import RigidTransform

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.poses import exp_so3, log_so3
from tactopose_drake.core.sensing.intrinsic_contact import ContactSolution, solve_contact, solve_contacts
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.hand.contact_gains import contact_gains, thicker
from tactopose_drake.hand.contact_uncertainty import ContactUncertainty
from tactopose_drake.hand.encoder_offsets import encoder_gains, offset_sigmas
from tactopose_drake.hand.hand_config import HandUncertainty, SkinLayer, load_hand_config
from tactopose_drake.hand.hand_errors import HandErrors, calibration_of
from tactopose_drake.hand.hand_in_plant import make_hand_plant
from tactopose_drake.hand.kinematics import HandKinematics
from tests.hand.calibrated_shadow import SOFT, WrongHand
from tests.hand.grippers import write_gripper

NONE = {
    "encoder_offset_deg": 0.0,
    "mounting": 0.0,
    "mounting_deg": 0.0,
    "fingertip_radius": 0.0,
    "sensor_force": 0.0,
    "sensor_moment": 0.0,
}


def touch(hand, finger: str, force: float = 2.0) -> tuple[np.ndarray, ContactSolution]:  # type: ignore[no-untyped-def]
    """A wrench on the side of a fingertip, and the contact that it is."""
    surface = hand.surfaces[finger]
    n = np.array([0.6, 0.64, 0.48])
    p_SC = surface.X_SF[:, 3] + surface.X_SF[:, :3] @ (n * np.max(getattr(surface, "radius", 0.009)))
    f_S = -force * surface.X_SF[:, :3] @ n
    wrench = np.concatenate([np.cross(p_SC, f_S), f_S])
    return wrench, solve_contacts(wrench[None], surface)[0]


def test_joint_offsets_move_contacts_as_drawn_offsets_do() -> None:
    plant, hand = make_hand_plant(load_hand_config("shadow_like"))
    kinematics = HandKinematics(plant, hand.palm_frame)
    errors = HandUncertainty(**NONE | {"encoder_offset_deg": 0.5})
    uncertainty = ContactUncertainty(plant, hand, errors)
    generator = np.random.default_rng(0)
    finger = hand.fingers[0]
    _, solution = touch(hand, finger)
    assert solution.valid
    q = plant.GetPositions(plant.CreateDefaultContext()) + 0.3
    followers = {coupling.joint: coupling for f in hand.config.fingers for coupling in f.couplings}
    place = {plant.get_joint(i).name(): plant.get_joint(i).position_start() for i in plant.GetJointIndices()}
    kinematics.move(q)
    X_PS = kinematics.poses(hand.sensor_frames)[finger]
    said = uncertainty.covariance(finger, solution, X_PS, kinematics)
    drawn = []
    for _ in range(3000):
        offset = np.zeros(len(q))
        for name, start in place.items():
            if plant.GetJointByName(name).num_positions() and name not in followers:
                offset[start] = math.radians(0.5) * generator.normal()
        for coupling in followers.values():
            offset[place[coupling.joint]] = coupling.ratio * offset[place[coupling.follows]]
        kinematics.move(q + offset)
        X = kinematics.poses(hand.sensor_frames)[finger]
        turn = log_so3((X.rotation() @ X_PS.rotation().inverse()).matrix())
        drawn.append(np.concatenate([X @ solution.p_SC - X_PS @ solution.p_SC, turn]))
    scale = np.sqrt(np.outer(np.diag(said), np.diag(said)))
    np.testing.assert_allclose(np.cov(np.array(drawn).T) / scale, said / scale, atol=0.12)
    # What moves the point turns the normal by the same joints.
    assert np.abs(said[:3, 3:] / scale[:3, 3:]).max() > 0.5


def test_a_sensors_errors_move_the_contact_on_its_fingertip() -> None:
    plant, hand = make_hand_plant(load_hand_config("shadow_like"))
    errors = HandUncertainty(**NONE | {"sensor_force": 0.02, "sensor_moment": 0.0002})
    uncertainty = ContactUncertainty(plant, hand, errors)
    kinematics = HandKinematics(plant, hand.palm_frame)
    finger = hand.fingers[1]
    wrench, solution = touch(hand, finger)
    X_PS = kinematics.poses(hand.sensor_frames)[finger]
    said = uncertainty.covariance(finger, solution, X_PS, kinematics)
    noise = np.random.default_rng(1).normal(size=(4000, 6)) * np.repeat([0.0002, 0.02], 3)
    others = solve_contacts(wrench + noise, hand.surfaces[finger])
    R = X_PS.rotation().matrix()
    points = (others.p_SC - solution.p_SC) @ R.T
    turns = np.cross(R @ solution.n_S, others.n_S @ R.T)
    scale = np.sqrt(np.trace(said[:3, :3])), np.sqrt(np.trace(said[3:, 3:]))
    np.testing.assert_allclose(np.cov(points.T) / scale[0] ** 2, said[:3, :3] / scale[0] ** 2, atol=0.05)
    np.testing.assert_allclose(np.cov(turns.T) / scale[1] ** 2, said[3:, 3:] / scale[1] ** 2, atol=0.05)


def test_a_calibrated_soft_fingertip_gives_way_by_what_the_force_errs() -> None:
    wrong = WrongHand(0, layer=SOFT)
    plant, hand = wrong.plant, wrong.hand
    found = calibration_of(wrong.errors, np.zeros(len(wrong.truth)), np.zeros((len(wrong.truth),) * 2), 0.0)
    found.noise.force, found.noise.moment, found.noise.position = 0.1, 1e-9, 1e-9
    uncertainty = ContactUncertainty(plant, dataclasses.replace(hand, calibration=found), HandUncertainty(**NONE))
    kinematics = HandKinematics(plant, hand.palm_frame)
    finger = hand.fingers[0]
    solution = solve_contact(touch(hand, finger)[0], hand.surfaces[finger], layer=hand.layers[finger])
    X_PS = kinematics.poses(hand.sensor_frames)[finger]
    n = X_PS.rotation() @ solution.n_S
    said = uncertainty.covariance(finger, solution, X_PS, kinematics)
    assert math.sqrt(n @ said[:3, :3] @ n) == pytest.approx(0.1 / SOFT.stiffness, rel=0.05)


@pytest.mark.parametrize("layer", [None, SOFT], ids=["rigid", "soft"])
def test_the_sensor_s_errors_move_point_and_normal_together(layer: SkinLayer | None) -> None:
    wrong = WrongHand(0, HandUncertainty(**NONE), layer=layer)
    plant, hand, finger = wrong.plant, wrong.hand, wrong.hand.fingers[1]
    kinematics, sigma = HandKinematics(plant, hand.palm_frame), np.repeat([0.001, 0.05], 3)
    surface, layers = hand.surfaces[finger], hand.layers.get(finger)
    solution = solve_contact(touch(hand, finger)[0], surface, layer=layers)
    X_PS = kinematics.poses(hand.sensor_frames)[finger]
    told = HandUncertainty(**NONE | {"sensor_moment": sigma[0], "sensor_force": sigma[3]})
    said = ContactUncertainty(plant, hand, told).covariance(finger, solution, X_PS, kinematics)
    gains = contact_gains(touch(hand, finger)[0][None], surface, layers)
    J = np.concatenate([X_PS.rotation().matrix() @ each[0, :, :6] for each in (gains.point, gains.turn)]) * sigma
    widths = np.sqrt(np.repeat([np.trace(said[:3, :3]), np.trace(said[3:, 3:])], 3))
    scaled = said / np.outer(widths, widths)
    np.testing.assert_allclose(scaled, J @ J.T / np.outer(widths, widths), atol=1e-3)
    assert np.abs(scaled[:3, 3:]).max() > 0.3


def test_a_calibration_narrows_whatever_its_errors_move() -> None:
    told = HandUncertainty(encoder_offset_deg=2.0, mounting=0.001, fingertip_radius=0.001)
    wrong = WrongHand(0, told)
    plant, hand = wrong.plant, wrong.hand
    known = np.diag((0.1 * wrong.errors.sigma) ** 2)
    found = calibration_of(wrong.errors, np.zeros(len(wrong.truth)), known, 0.0)
    calibrated = dataclasses.replace(hand, calibration=found)
    fingers = np.isin(encoder_gains(plant, hand).joints, wrong.errors.joints)  # and not the wrist
    np.testing.assert_allclose(offset_sigmas(plant, hand, told), math.radians(2.0))
    np.testing.assert_allclose(offset_sigmas(plant, calibrated, told)[fingers], math.radians(0.2), rtol=1e-3)
    kinematics = HandKinematics(plant, hand.palm_frame)
    before, after = (ContactUncertainty(plant, each, told).surface_sigma(kinematics) for each in (hand, calibrated))
    assert before > 0.002
    assert after == pytest.approx(0.1 * before, rel=1e-3)


def test_a_thicker_fingertip_moves_the_point_along_the_force_and_a_mounting_anywhere() -> None:
    plant, hand = make_hand_plant(load_hand_config("shadow_like"))
    kinematics = HandKinematics(plant, hand.palm_frame)
    finger = hand.fingers[0]
    wrench, solution = touch(hand, finger)
    X_PS = kinematics.poses(hand.sensor_frames)[finger]
    # On the side of a capsule, with friction along its axis: the point slides along that, and the normal does not turn.
    moved = X_PS.rotation() @ (wrench[3:] / (wrench[3:] @ solution.n_S))
    assert np.linalg.norm(moved) > 1.1
    thick = ContactUncertainty(plant, hand, HandUncertainty(**NONE | {"fingertip_radius": 0.001}))
    said = thick.covariance(finger, solution, X_PS, kinematics)
    np.testing.assert_allclose(said[:3, :3], 1e-6 * np.outer(moved, moved), atol=1e-15)
    np.testing.assert_allclose(said[3:], 0.0, atol=1e-15)
    mounted = ContactUncertainty(plant, hand, HandUncertainty(**NONE | {"mounting": 0.002}))
    said = mounted.covariance(finger, solution, X_PS, kinematics)
    np.testing.assert_allclose(said[:3, :3], 4e-6 * np.eye(3), atol=1e-15)


def test_the_defaults_give_a_contact_that_a_good_hand_has() -> None:
    plant, hand = make_hand_plant(load_hand_config("shadow_like"))
    kinematics = HandKinematics(plant, hand.palm_frame)
    uncertainty = ContactUncertainty(plant, hand, HandUncertainty())
    for finger, X_PS in kinematics.poses(hand.sensor_frames).items():
        _, solution = touch(hand, finger)
        said = uncertainty.covariance(finger, solution, X_PS, kinematics)
        p_PC, n_PC = X_PS @ solution.p_SC, -(X_PS.rotation() @ solution.n_S)
        contacts = Contacts(p_PC[None], n_PC[None], covariance=said[None])
        assert 0.0003 < float(np.asarray(contacts.sigma_position)[0]) < 0.004
        assert math.radians(0.5) < float(np.asarray(contacts.sigma_normal)[0]) < math.radians(6.0)


def test_a_finger_that_slides_is_off_by_a_millimetre_a_degree_or_by_what_its_calibration_left(tmp_path: Path) -> None:
    plant, hand = make_hand_plant(load_hand_config(write_gripper(tmp_path)))
    told = HandUncertainty(**NONE | {"encoder_offset_deg": 2.0})
    joints, gains = encoder_gains(plant, hand)
    assert joints == ("left_slide", "right_slide")
    np.testing.assert_allclose(gains * offset_sigmas(plant, hand, told), 0.002 * np.eye(2))
    errors = HandErrors.of(plant, hand, told)
    np.testing.assert_allclose(errors.sigma[errors.free], 0.002)
    covariance = np.diag(np.where(errors.sigma > 0.0, 0.0004**2, 0.0))
    found = calibration_of(errors, np.zeros(len(covariance)), covariance, 0.0)
    found.noise.position = found.noise.normal_deg = found.noise.moment = found.noise.force = 1e-9
    calibrated = dataclasses.replace(hand, calibration=found)
    np.testing.assert_allclose(gains * offset_sigmas(plant, calibrated, told), 0.0004 * np.eye(2))
    kinematics = HandKinematics(plant, hand.palm_frame)
    X_PS, solution = kinematics.poses(hand.sensor_frames)["left"], touch(hand, "left")[1]
    for each, sigma in ((hand, 0.002), (calibrated, 0.0004)):
        uncertainty = ContactUncertainty(plant, each, told)
        assert uncertainty.surface_sigma(kinematics) == pytest.approx(sigma / math.sqrt(3.0))
        said = uncertainty.covariance("left", solution, X_PS, kinematics)
        np.testing.assert_allclose(said, np.diag([sigma**2, 0.0, 0.0, 0.0, 0.0, 0.0]), atol=1e-11)


def test_a_sensor_that_is_turned_swings_the_contact_about_its_origin() -> None:
    told = HandUncertainty(**NONE | {"mounting_deg": 1.0})
    wrong = WrongHand(0, told)
    plant, hand = wrong.plant, wrong.hand
    known = np.diag(np.square(wrong.errors.sigma))
    found = calibration_of(wrong.errors, np.zeros(len(known)), known, 0.0)
    found.noise.position = found.noise.normal_deg = found.noise.moment = found.noise.force = 1e-9
    kinematics, finger = HandKinematics(plant, hand.palm_frame), hand.fingers[0]
    X_PS, solution = kinematics.poses(hand.sensor_frames)[finger], touch(hand, finger)[1]
    turns_P = math.radians(1.0) * X_PS.rotation().matrix().T  # about each axis of S, in rows
    swings = np.column_stack([np.cross(turns_P, X_PS.rotation() @ solution.p_SC), turns_P])
    expected = swings.T @ swings
    for each in (hand, dataclasses.replace(hand, calibration=found)):
        said = ContactUncertainty(plant, each, told).covariance(finger, solution, X_PS, kinematics)
        np.testing.assert_allclose(said, expected, atol=1e-5 * np.trace(expected))


def test_errors_that_a_calibration_left_move_contacts_with_their_correlations() -> None:
    """By differences of the whole way from readings to a contact, of which each error changes one step."""
    told = HandUncertainty(mounting=0.002, mounting_deg=1.0, fingertip_radius=0.0005)
    wrong = WrongHand(0, told)
    plant, hand, errors = wrong.plant, wrong.hand, wrong.errors
    root = errors.sigma[:, None] * np.random.default_rng(5).normal(size=(len(errors.sigma),) * 2)
    covariance = root @ root.T / len(root)
    covariance[errors.sigma == 0.0] = covariance[:, errors.sigma == 0.0] = 0.0
    found = calibration_of(errors, np.zeros(len(covariance)), covariance, 0.0)
    found.noise.position = found.noise.normal_deg = found.noise.moment = found.noise.force = 1e-9
    kinematics, finger = HandKinematics(plant, hand.palm_frame), hand.fingers[1]
    q, (wrench, solution) = plant.GetPositions(plant.CreateDefaultContext()) + 0.2, touch(hand, finger)
    surface, gains = hand.surfaces[finger], errors.gains(plant, hand)

    def contact(vector: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The true point, the fingertip's orientation, and the normal in it, if these are the errors."""
        own = errors.of_finger(vector, finger)
        kinematics.move(q - gains @ errors.offsets(vector))
        X_PS = kinematics.poses(hand.sensor_frames)[finger].GetAsMatrix34()
        R = X_PS[:, :3] @ exp_so3(own.mounting[:3])
        p_PS = X_PS[:, 3] + X_PS[:, :3] @ own.mounting[3:]
        true = solve_contacts((wrench - own.bias)[None], thicker(surface, own.radius))[0]
        return p_PS + R @ true.p_SC, R, true.n_S

    p, R, n_S = contact(np.zeros(len(covariance)))
    J = np.zeros((6, len(covariance)))
    for k in np.flatnonzero(errors.sigma):
        step = np.zeros(len(covariance))
        step[k] = 1e-3 * errors.sigma[k]
        (p_more, R_more, n_more), (p_less, R_less, n_less) = contact(step), contact(-step)
        turn = log_so3(R_more @ R_less.T) + R @ np.cross(n_S, n_more - n_less)
        J[:, k] = np.concatenate([p_more - p_less, turn]) / (2.0 * step[k])
    kinematics.move(q)
    X_PS = kinematics.poses(hand.sensor_frames)[finger]
    np.testing.assert_allclose(X_PS @ solution.p_SC, p, atol=1e-12)
    calibrated = dataclasses.replace(hand, calibration=found)
    said = ContactUncertainty(plant, calibrated, told).covariance(finger, solution, X_PS, kinematics)
    scale = np.sqrt(np.outer(np.diag(said), np.diag(said)))
    np.testing.assert_allclose(said / scale, J @ covariance @ J.T / scale, atol=2e-3)


def test_a_bias_drifts_over_a_span_by_as_much_as_it_may_be() -> None:
    plant, hand = make_hand_plant(load_hand_config("shadow_like"))
    errors = HandErrors.of(plant, hand, HandUncertainty(sensor_force=0.1, sensor_moment=0.002), span=50.0)
    expected = np.repeat([0.002 / 50.0, 0.1 / 50.0], 3)
    for finger in errors.fingers:
        np.testing.assert_allclose(errors.sigma[errors.place(finger, "drift")], expected)


@pytest.mark.parametrize("name", list(NONE))
def test_an_uncertainty_below_zero_is_refused(name: str) -> None:
    plant, hand = make_hand_plant(load_hand_config("shadow_like"))
    with pytest.raises(InvalidInputError, match=rf"HandUncertainty\.{name}"):
        ContactUncertainty(plant, hand, HandUncertainty(**NONE | {name: -1.0}))


@pytest.mark.parametrize(
    ("name", "value", "allowed"),
    [
        ("mounting", 0.3, "from 0 to 0.05 m, not 0.3"),
        ("fingertip_radius", 0.1, "from 0 to 0.05 m, not 0.1"),
        ("encoder_offset_deg", 720.0, "from 0 to 45 deg, not 720"),
        ("mounting_deg", 90.0, "from 0 to 45 deg, not 90"),
        ("sensor_force", 50.0, "from 0 to 10 N, not 50"),
        ("sensor_moment", 0.5, "from 0 to 0.1 N m, not 0.5"),
    ],
)
def test_an_uncertainty_of_another_unit_is_refused(name: str, value: float, allowed: str) -> None:
    with pytest.raises(InvalidInputError, match=rf"HandUncertainty\.{name} must be a number {allowed}"):
        HandUncertainty(**NONE | {name: value}).validate()


def test_a_pose_is_used_as_given() -> None:
    plant, hand = make_hand_plant(load_hand_config("shadow_like"))
    kinematics = HandKinematics(plant, hand.palm_frame)
    wrench, solution = touch(hand, hand.fingers[0])
    uncertainty = ContactUncertainty(plant, hand, HandUncertainty(**NONE | {"fingertip_radius": 0.001}))
    said = uncertainty.covariance(hand.fingers[0], solution, RigidTransform(), kinematics)
    moved = wrench[3:] / (wrench[3:] @ solution.n_S)
    np.testing.assert_allclose(said[:3, :3], 1e-6 * np.outer(moved, moved), atol=1e-15)


def test_the_hands_surface_is_off_by_what_moves_its_fingertips() -> None:
    plant, hand = make_hand_plant(load_hand_config("shadow_like"))
    kinematics = HandKinematics(plant, hand.palm_frame)
    off = [
        ContactUncertainty(plant, hand, HandUncertainty(**NONE | errors)).surface_sigma(kinematics)
        for errors in (
            {}, {"mounting": 0.002}, {"encoder_offset_deg": 1.0}, {"encoder_offset_deg": 2.0}, {"mounting_deg": 2.0}
        )
    ]  # fmt: skip
    assert off[:2] == [0.0, pytest.approx(0.002)]
    # A fingertip is some 10 cm from the joints that move it, along two of three axes each.
    assert 0.001 < off[2] < 0.004
    assert off[3] == pytest.approx(2.0 * off[2])
    # Its middle is 7 mm from the sensor's frame, and moves across that.
    turned = np.random.default_rng(0).normal(scale=math.radians(2.0), size=(100000, 3))
    arm = hand.surfaces[hand.fingers[0]].X_SF[:, 3]
    assert off[4] == pytest.approx(np.sqrt(np.mean(np.cross(turned, arm) ** 2)), rel=0.01)
