"""Offsets of encoders by touches of which each tells a little: they are found, and known as well as is said."""

import dataclasses
import math

import numpy as np
import pytest

from tactopose_drake.core.calibration.offset_refinement import JointOffsets, OffsetRefinementParams, refine_offsets
from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.poses import exp_so3, make_poses, random_rotations, retract
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.synthetic import touch_surface
from tactopose_drake.errors import InvalidInputError
from tests.core.tracking.boxes import make_box

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
    with pytest.raises(InvalidInputError, match=rf"OffsetRefinementParams\.{name}: is {value}"):
        dataclasses.replace(PARAMS, **{name: value}).validate()
