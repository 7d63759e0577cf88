"""The noise that a fit begins with, and that at which it ends."""

import numpy as np
import pytest

from tactopose_drake.core.calibration.annealed_fit import ContactNoise, _by_components, _by_medians, anneal, start_noise
from tactopose_drake.core.calibration.shared_least_squares import Linearization, Solution
from tactopose_drake.core.calibration.surface_residuals import ContactSigmas, GraspContacts, SurfaceRows
from tactopose_drake.core.poses import random_rotations
from tactopose_drake.core.shape.object_model import ObjectModel
from tests.core.calibration.shifted_contacts import SHIFT, SIGMA, Shifted


def test_a_fit_begins_with_as_much_noise_as_the_shared_errors_are_expected_to_make() -> None:
    """Of a distance, and of a turn about each axis: against errors drawn at random; and ten times noise at least."""
    generator, count, shared = np.random.default_rng(0), 40, 7
    J = generator.normal(size=(count, 6, shared)) * np.repeat([0.002, 0.1], 3)[:, None]
    valid = np.arange(count) % 4 > 0
    J[~valid] *= 100.0  # what is no contact tells nothing
    n_PC = random_rotations(generator, count)[:, 0]
    touches = GraspContacts(np.zeros(count, dtype=np.int64), np.zeros((count, 3)), n_PC, J, valid)
    moved = np.einsum("nij,dj->dni", J[valid], generator.normal(size=(4000, shared)))
    distance = np.einsum("dni,ni->dn", moved[..., :3], n_PC[valid])
    expected = np.sqrt(np.mean(distance**2)), np.sqrt(np.mean(moved[..., 3:] ** 2))
    none = ContactSigmas(np.zeros(count), np.zeros(count))
    assert start_noise(touches, ContactNoise(none, 1e-6, 1e-6)) == pytest.approx(expected, rel=0.03)
    assert start_noise(touches, ContactNoise(none, 0.1, 3.0)) == pytest.approx((1.0, 30.0))
    assert start_noise(touches.chosen(np.arange(0)), ContactNoise(none, 0.1, 3.0)) == pytest.approx((1.0, 30.0))


def test_the_noise_that_there_is_is_found(blob: ObjectModel) -> None:
    found = []
    for seed in range(4):
        shifted = Shifted(blob, SHIFT, noise=0.0008, seed=seed)
        count = len(shifted.p)
        noise = ContactNoise(ContactSigmas(np.zeros(count), np.zeros(count)), 0.0004, 0.02)
        fit = anneal(shifted.problem, np.zeros(3), shifted.X_PO, noise, (0.004, 0.2))
        found.append(fit.noise.position)
        np.testing.assert_allclose(SIGMA * fit.solution.shared, SHIFT, atol=0.002)
    # It is 0.8 mm, and was told to be 0.4 mm.
    assert 0.00055 < np.median(found) < 0.0009


def test_what_the_poses_take_up_of_the_noise_is_not_taken_for_less_noise(blob: ObjectModel) -> None:
    """Six contacts' distances, of which each grasp's pose suits itself to some, with noise that is as told."""
    noise, found = 0.0008, []
    for seed in range(4):
        shifted = Shifted(blob, SHIFT, noise=noise, seed=seed)
        told = ContactNoise(shifted.noise(0.0, 0.0), noise, 0.02)
        found.append(anneal(shifted.problem, np.zeros(3), shifted.X_PO, told, (0.004, 0.2)).noise.position)
    assert np.sqrt(np.mean(np.square(found))) == pytest.approx(noise, rel=0.1)


@pytest.mark.parametrize("told", [1.0, 3.0])
def test_the_sums_of_squares_tell_the_noise_that_unknowns_have_not_taken_up(told: float) -> None:
    """Of least squares' residuals, and what was told as much as ten of them would; what has no weight tells nothing."""
    generator, count, unknowns, sigma = np.random.default_rng(1), 12, 5, np.array([0.001, 0.05])
    assumed, weights = 1.7 * sigma, np.repeat([1.0, 0.0], [count, 2])
    basis = np.linalg.qr(generator.normal(size=(3 * count, unknowns)))[0]
    leverage = np.zeros((count + 2, 4))
    leverage[:count, [0, 1, 3]] = np.sum(basis**2, axis=1).reshape(count, 3)
    squares = []
    for _ in range(2000):
        # Of the difference of two normals one of three components is zero.
        noise = generator.normal(size=(count, 3)) * sigma[[0, 1, 1]] / assumed[[0, 1, 1]]
        left = noise.ravel() - basis @ (basis.T @ noise.ravel())
        residual = np.full((count + 2, 4), 1e3)
        residual[:count] = np.insert(left.reshape(count, 3), 2, 0.0, axis=1)
        nothing = np.zeros((count + 2, 4, 0))
        touches = GraspContacts(*np.zeros((5, count + 2), dtype=np.int64))  # type: ignore[arg-type]
        at = Linearization(touches, SurfaceRows(residual, nothing, nothing, residual[:, 0]), weights, weights, 0.0)
        solution = Solution(np.zeros(0), np.zeros((0, 3, 4)), np.zeros((0, 0)), leverage, at, True)
        none = ContactSigmas(np.zeros(count + 2), np.zeros(count + 2))
        found = _by_components(solution, ContactNoise(none, *assumed), ContactNoise(none, *(told * sigma)))
        squares.append(np.square(found))
    redundancy = np.array([1.0, 2.0]) * count - [leverage[:, 0].sum(), leverage[:, 1:].sum()]
    expected = sigma**2 * (redundancy + 10.0 * told**2) / (redundancy + 10.0)
    np.testing.assert_allclose(np.mean(squares, axis=0), expected, rtol=0.03)


@pytest.mark.parametrize("taken_up", [0.0, 0.4])
def test_the_middle_residuals_tell_the_noise_whatever_some_false_ones_are(taken_up: float) -> None:
    generator, count, sigma = np.random.default_rng(2), 20_000, np.array([0.001, 0.05])
    assumed = 1.7 * sigma
    residual = np.insert(generator.normal(size=(count, 3)), 2, 0.0, axis=1) * np.sqrt(1.0 - taken_up) / 1.7
    residual[:40] = 1e3
    leverage = taken_up * np.tile([1.0, 1.0, 0.0, 1.0], (count, 1))
    nothing, ones = np.zeros((count, 4, 0)), np.ones(count)
    touches = GraspContacts(*np.zeros((4, count), dtype=np.int64), ones.astype(np.bool_))  # type: ignore[arg-type]
    at = Linearization(touches, SurfaceRows(residual, nothing, nothing, ones), ones, ones, 0.0)
    solution = Solution(np.zeros(0), np.zeros((0, 3, 4)), np.zeros((0, 0)), leverage, at, True)
    none = ContactSigmas(np.zeros(count), np.zeros(count))
    np.testing.assert_allclose(_by_medians(solution, ContactNoise(none, *assumed)), sigma, rtol=0.03)
