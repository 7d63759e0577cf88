import dataclasses
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pytest

from tactopose_drake.core.evidence.contact_reading import ContactReading, ErrorScales
from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.poses import make_poses, random_rotations, retract
from tactopose_drake.core.posterior.gaussian_mixture import GaussianMixture
from tactopose_drake.core.posterior.modes import Modes
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.tracking.calibration_scale import estimate_scale, follow_scale
from tactopose_drake.core.tracking.tracker_params import PoseTrackerParams
from tests.core.tracking.boxes import draw_biases, make_box, read, touch

PARAMS = PoseTrackerParams()
TOLD = PARAMS.calibration_position, math.radians(PARAMS.calibration_normal_deg)
X_PO = make_poses(random_rotations(np.random.default_rng(0), 1), np.array([[0.02, 0.0, 0.1]]))[0]


@pytest.fixture(scope="module")
def box() -> ObjectModel:
    return make_box()


class Felt(NamedTuple):
    """The last reading of a box that is held still, and the mean of so many frames' contacts."""

    reading: ContactReading
    mean: Contacts
    frames: int

    def estimate(self, box: ObjectModel, modes: Modes, inlier: np.ndarray | None = None) -> np.ndarray | None:
        """The scale by modes at which contacts are as told with some probabilities, shape (n, 6)."""
        inlier = np.ones((len(modes.mixture), len(self.mean))) if inlier is None else inlier
        return estimate_scale(box, PARAMS, *self, modes, inlier)


def feel(seed: int, scale: float, frames: int = 8, beside: np.ndarray | None = None) -> Felt:
    """What a hand feels that errs by the scale, and whose contacts are beside the box by so much more, shape (6, 3)."""
    generator = np.random.default_rng(seed)
    bias = scale * draw_biases(generator, *TOLD)
    if beside is not None:
        bias[:, :3] += beside
    felt = [touch(X_PO, generator, bias, TOLD) for _ in range(frames)]
    n_PC = np.mean([contacts.n_PC for contacts in felt], axis=0)
    n_PC /= np.linalg.norm(n_PC, axis=1, keepdims=True)
    return Felt(read(felt[-1]), felt[-1].with_arrays(p_PC=np.mean([c.p_PC for c in felt], axis=0), n_PC=n_PC), frames)


def modes_at(*X_PO: np.ndarray, weights: Sequence[float] = (1.0,)) -> Modes:
    """Modes of so much weight."""
    n = len(X_PO)
    mixture = GaussianMixture(np.stack(X_PO), np.array(weights), np.repeat(1e-6 * np.eye(6)[None], n, axis=0))
    return Modes(mixture, np.zeros(n), (np.zeros((0, 6)),) * n, 0.0)


def scales(box: ObjectModel, scale: float) -> np.ndarray:
    """Of some hands, the root of the factors' geometric mean."""
    found = [feel(seed, scale).estimate(box, modes_at(X_PO)) for seed in range(8)]
    return np.array([math.sqrt(math.sqrt(factors[0] * factors[1])) for factors in found if factors is not None])


@pytest.mark.parametrize("scale", [1.0, 2.0, 4.0])
def test_the_scale_is_found_up_to_a_factor(box: ObjectModel, scale: float) -> None:
    found = scales(box, scale)
    assert len(found) == 8
    assert 0.75 * scale < np.median(found) < 1.5 * scale
    assert np.all((found > 0.4 * scale) & (found < 2.5 * scale))


def test_what_a_hand_declares_beside_its_calibration_is_no_larger_calibration(box: ObjectModel) -> None:
    declared = 0.002, math.radians(8.0)
    new = PARAMS.frame_position, math.radians(PARAMS.frame_normal_deg)
    lasting = tuple(math.hypot(*pair) for pair in zip(TOLD, declared, strict=True))
    sigmas = tuple(math.hypot(*pair) for pair in zip(lasting, new, strict=True))
    covariance = np.tile(np.diag(np.repeat(np.square(sigmas), 3)), (6, 1, 1))
    found = []
    for seed in range(8):
        generator = np.random.default_rng(seed)
        bias = draw_biases(generator, *lasting)
        felt = [touch(X_PO, generator, bias, lasting, sigmas).with_covariance(covariance) for _ in range(8)]
        n_PC = np.mean([contacts.n_PC for contacts in felt], axis=0)
        n_PC /= np.linalg.norm(n_PC, axis=1, keepdims=True)
        mean = felt[-1].with_arrays(p_PC=np.mean([c.p_PC for c in felt], axis=0), n_PC=n_PC)
        factors = Felt(read(felt[-1]), mean, 8).estimate(box, modes_at(X_PO))
        assert factors is not None
        found.append(math.sqrt(math.sqrt(factors[0] * factors[1])))
    assert 0.75 < np.median(found) < 1.5


def test_where_the_pose_is_believed_to_be_has_no_part_in_it(box: ObjectModel) -> None:
    X_near = retract(X_PO, np.array([0.02, -0.01, 0.02, 0.002, -0.002, 0.001]))
    at_truth, beside = (feel(3, 2.0).estimate(box, modes_at(X)) for X in (X_PO, X_near))
    assert at_truth is not None
    np.testing.assert_allclose(beside, at_truth, rtol=0.1)


def test_a_wrong_mode_makes_the_calibration_as_bad_as_that_mode_is_probable(box: ObjectModel) -> None:
    X_wrong = retract(X_PO, np.array([0.0, 0.0, 0.8, 0.02, 0.0, 0.0]))
    felt = feel(3, 1.0)
    right, wrong, most, least, hardly = (
        felt.estimate(box, modes)
        for modes in (
            modes_at(X_PO),
            modes_at(X_wrong),
            modes_at(X_wrong, X_PO, weights=(0.7, 0.3)),
            modes_at(X_PO, X_wrong, weights=(0.7, 0.3)),
            modes_at(X_PO, X_wrong, weights=(0.995, 0.005)),
        )
    )
    assert right is not None
    assert wrong is not None
    assert wrong.min() > 8.0 * right.max()
    np.testing.assert_allclose(most, wrong**0.7 * right**0.3)
    np.testing.assert_allclose(least, wrong**0.3 * right**0.7)
    np.testing.assert_array_equal(hardly, right)


def test_a_contact_that_seems_false_tells_nothing_of_the_calibration(box: ObjectModel) -> None:
    beside = np.zeros((6, 3))
    beside[2], beside[3] = [0.0, 0.0, 0.02], -0.02 * X_PO[:, 1]
    felt, inlier = feel(1, 1.0, beside=beside), np.array([[0.9, 0.8, 0.01, 0.02, 0.9, 0.9]])
    believed, without = felt.estimate(box, modes_at(X_PO)), felt.estimate(box, modes_at(X_PO), inlier)
    assert believed is not None
    assert without is not None
    assert believed[0] > 10.0
    assert without[0] < 3.0
    # A mode to which too few contacts are none leaves it to the others.
    X_near, inlier = retract(X_PO, np.full(6, 0.002)), np.concatenate([inlier, np.full((1, 6), 0.01)])
    by_both = felt.estimate(box, modes_at(X_PO, X_near, weights=(0.5, 0.5)), inlier)
    np.testing.assert_allclose(by_both, without)


def test_too_few_contacts_or_frames_and_touch_without_normals_tell_nothing(box: ObjectModel) -> None:
    felt = feel(0, 4.0)
    two = felt._replace(reading=read(felt.reading.contacts[:2], np.arange(2)), mean=felt.mean[:2])
    bare = felt._replace(mean=Contacts(felt.mean.p_PC, None, sigma_position=felt.mean.sigma_position))
    for little in (two, bare, feel(0, 4.0, frames=1)):
        assert little.estimate(box, modes_at(X_PO)) is None


def test_the_factors_are_a_mean_in_which_later_estimates_count_at_least_as_told() -> None:
    settings = dataclasses.replace(PARAMS.calibration_scale, least_share=0.5)
    errors = ErrorScales()
    for now, expected in ((4.0, 4.0), (16.0, 8.0), (0.5, 2.0)):
        errors = follow_scale(errors, np.full(2, now), settings)
        np.testing.assert_allclose(errors.calibration, expected)
    assert errors.estimates == 3


def test_what_the_surface_is_off_by_is_not_taken_for_the_hand(box: ObjectModel) -> None:
    rough = PoseTrackerParams(surface_position=4.0 * TOLD[0], surface_normal_deg=4.0 * PARAMS.calibration_normal_deg)
    found = []
    for params in (PARAMS, rough):
        inlier, modes = np.ones((1, 6)), modes_at(X_PO)
        each = [estimate_scale(box, params, *feel(seed, 4.0), modes, inlier) for seed in range(4)]
        found.append(np.exp(np.mean([np.log(factors) for factors in each if factors is not None])))
    assert found[0] > 8.0
    assert found[1] < 0.5 * found[0]
