"""Offsets of encoders by touches of which each tells a little: they are found, and known as well as is said."""

import dataclasses
import math

import numpy as np
import pytest

from tactopose_drake.core.calibration.offset_refinement import JointOffsets, OffsetRefinementParams, refine_offsets
from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.poses import exp_so3, make_poses, random_rotations, retract, transform_points
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.synthetic import touch_surface
from tactopose_drake.errors import InvalidInputError
from tests.core.tracking.boxes import make_box, n_OC, p_OC
from tests.core.tracking.boxes import touch as touch_faces

SIGMA, NOISE = 0.03, (0.0003, math.radians(2.0))  # of each offset, rad; of a contact's point, m, and normal, rad
PARAMS = OffsetRefinementParams()


@pytest.fixture(scope="module")
def box() -> ObjectModel:
    return make_box()


def touch_by_a_wrong_hand(
    box: ObjectModel, offsets: np.ndarray, generator: np.random.Generator
) -> tuple[Contacts, np.ndarray, np.ndarray]:
    """A touch, what offsets move each contact by, and a pose near the true one; fingers as long as an arm of 8 cm."""
    X_PO = make_poses(random_rotations(generator, 1), generator.normal(size=(1, 3)))[0]
    felt = touch_surface(box, X_PO, 5, generator, spread=True, sigma_position=NOISE[0], sigma_normal=NOISE[1])
    gains = np.concatenate(
        [0.08 * generator.normal(size=(5, 3, len(offsets))), generator.normal(size=(5, 3, len(offsets)))], axis=1
    )
    moved = gains @ offsets
    p_PC = felt.p_PC + moved[:, :3]
    n_PC = np.array([exp_so3(turn) @ n for turn, n in zip(moved[:, 3:], felt.n_PC, strict=True)])
    told = np.sqrt(np.einsum("kij,kij->ki", gains, gains).reshape(5, 2, 3).mean(axis=2) * SIGMA**2 + np.square(NOISE))
    near = retract(X_PO[None], generator.normal(size=(1, 6)) * np.repeat([0.01, 0.001], 3))[0]
    return Contacts(p_PC, n_PC, sigma_position=told[:, 0], sigma_normal=told[:, 1]), gains, near


def test_offsets_are_found_over_touches_and_known_as_well_as_is_said(box: ObjectModel) -> None:
    scaled, before, after = [], [], []
    for seed in range(6):
        generator = np.random.default_rng(seed)
        true = SIGMA * generator.normal(size=8)
        known = JointOffsets.of_sigma(np.full(8, SIGMA))
        for _ in range(25):
            touch, gains, X_PO = touch_by_a_wrong_hand(box, true - known.mean, generator)
            left = JointOffsets(np.zeros(8), known.covariance, known.touches)
            found = refine_offsets(box, PARAMS, touch, gains, X_PO, left)
            known = JointOffsets(known.mean + found.mean, found.covariance, found.touches)
        assert known.touches > 12
        scaled.append((known.mean - true) / known.sigma)
        before.append(true)
        after.append(known.mean - true)
    assert np.sqrt(np.mean(np.square(after))) < 0.35 * np.sqrt(np.mean(np.square(before)))
    assert np.sqrt(np.mean(np.square(scaled))) < 1.5


def refine_one_offset(
    box: ObjectModel, seed: int, true: float, sigma: float, mean: float = 0.0, **params: float
) -> JointOffsets:
    """What a touch without noise says of one offset that moves and turns contacts along all axes alike."""
    generator = np.random.default_rng(seed)
    X_PO = make_poses(random_rotations(generator, 1), generator.normal(size=(1, 3)))[0]
    by_offset = np.array([0.05, 1.0])  # m and rad for each rad
    gains = generator.choice([-1.0, 1.0], size=(len(p_OC), 6, 1)) * np.repeat(by_offset, 3)[:, None]
    moved = true * gains[..., 0]
    n_PC = (exp_so3(moved[:, 3:]) @ (n_OC @ X_PO[:, :3].T)[..., None])[..., 0]
    told = np.hypot(by_offset * sigma, NOISE)
    contacts = Contacts(transform_points(X_PO, p_OC) + moved[:, :3], n_PC, sigma_position=told[0], sigma_normal=told[1])
    settings = dataclasses.replace(PARAMS, least_sigma_deg=1e-6, **params)
    return refine_offsets(box, settings, contacts, gains, X_PO, JointOffsets(np.array([mean]), np.diag([sigma**2])))


def test_one_touch_tells_how_far_its_contacts_were_moved_and_turned(box: ObjectModel) -> None:
    for seed in range(8):
        found = refine_one_offset(box, seed, 0.01, 10.0 * SIGMA, least_noise_share=1e-9)
        assert found.touches == 1
        assert found.mean[0] == pytest.approx(0.01, rel=0.02)


def test_what_is_known_of_an_offset_that_is_not_yet_taken_off_is_not_counted_again(box: ObjectModel) -> None:
    for seed in range(4):
        for mean in (0.005, 0.01, 0.02):
            found = refine_one_offset(box, seed, 0.01, 10.0 * SIGMA, mean=mean, least_noise_share=1e-9)
            assert found.mean[0] == pytest.approx(0.01, rel=0.02)


def test_what_contacts_are_told_to_err_by_the_joints_is_not_noise_to_these(box: ObjectModel) -> None:
    """Whatever was known of an offset, it comes to be known by the rest of the contacts' noise."""
    for seed in range(4):
        before, less = (
            refine_one_offset(box, seed, 0.0, s, least_noise_share=1e-9) for s in (5.0 * SIGMA, 25.0 * SIGMA)
        )
        assert less.sigma[0] == pytest.approx(before.sigma[0], rel=0.02)


def test_however_much_of_its_noise_is_of_the_joints_a_share_of_it_is_of_other_things(box: ObjectModel) -> None:
    for seed in range(4):
        few, more = (refine_one_offset(box, seed, 0.0, 50.0 * SIGMA, least_noise_share=s) for s in (0.001, 0.004))
        assert more.sigma[0] == pytest.approx(2.0 * few.sigma[0], rel=0.02)


def test_a_touch_that_does_not_fit_and_one_by_few_fingers_say_nothing(box: ObjectModel) -> None:
    generator = np.random.default_rng(1)
    known = JointOffsets.of_sigma(np.full(8, 0.001))
    touch, gains, X_PO = touch_by_a_wrong_hand(box, np.full(8, 0.08), generator)
    sure = Contacts(touch.p_PC, touch.n_PC, sigma_position=NOISE[0], sigma_normal=NOISE[1])
    assert refine_offsets(box, PARAMS, sure, gains, X_PO, known) is known
    touch, gains, X_PO = touch_by_a_wrong_hand(box, np.zeros(8), generator)
    few = Contacts(touch.p_PC[:2], touch.n_PC[:2], sigma_position=NOISE[0], sigma_normal=NOISE[1])
    assert refine_offsets(box, PARAMS, few, gains[:2], X_PO, known) is known
    assert refine_offsets(box, PARAMS, touch, gains, X_PO, known).touches == 1


def test_touches_with_noise_as_told_are_left_out_as_seldom_as_they_may_be(box: ObjectModel) -> None:
    """Residuals of six contacts, of which six numbers go into the pose."""
    generator, known, chance = np.random.default_rng(4), JointOffsets.of_sigma(np.full(1, 1e-6)), 0.2
    params = dataclasses.replace(PARAMS, chance=chance)
    X_PO = make_poses(random_rotations(generator, 1), generator.normal(size=(1, 3)))[0]
    told = 0
    for _ in range(1000):
        felt = touch_faces(X_PO, generator, sigmas=NOISE)
        told += refine_offsets(box, params, felt, np.ones((6, 6, 1)), X_PO, known).touches
    assert told / 1000 == pytest.approx(1.0 - chance, abs=0.05)


def test_no_offset_is_known_better_than_to_the_least_standard_deviation(box: ObjectModel) -> None:
    generator = np.random.default_rng(2)
    known = JointOffsets.of_sigma(np.full(3, SIGMA))
    for _ in range(60):
        touch, gains, X_PO = touch_by_a_wrong_hand(box, -known.mean, generator)
        found = refine_offsets(box, PARAMS, touch, gains, X_PO, JointOffsets(np.zeros(3), known.covariance))
        known = JointOffsets(known.mean + found.mean, found.covariance)
    assert np.all(known.sigma >= math.radians(PARAMS.least_sigma_deg) * (1.0 - 1e-9))
    assert np.all(known.sigma < 0.5 * SIGMA)


@pytest.mark.parametrize("name", [field.name for field in dataclasses.fields(OffsetRefinementParams)])
@pytest.mark.parametrize("value", [0, -1])
def test_parameters_that_are_none_are_named(name: str, value: int) -> None:
    PARAMS.validate()
    with pytest.raises(InvalidInputError, match=rf"OffsetRefinementParams\.{name} must be .*, not {value}"):
        dataclasses.replace(PARAMS, **{name: value}).validate()
