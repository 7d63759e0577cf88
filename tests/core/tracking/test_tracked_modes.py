import dataclasses

import numpy as np
import pytest

from tactopose_drake.core.motion.rigid_motion import Motion, predict_poses
from tactopose_drake.core.poses import make_poses, random_rotations
from tactopose_drake.core.tracking.tracked_modes import TrackedModes, predict_modes
from tactopose_drake.core.tracking.tracker_params import MixtureParams
from tests.core.tracking.rough_modes import HAND, SOURCES, make_rough_modes

COVARIANCE = np.diag([0.01, 0.02, 0.03, 1e-4, 2e-4, 3e-4])


@pytest.mark.parametrize("factor", [0.25, 1.0, 4.0])
def test_fitted_modes_are_as_wide_as_told_and_share_no_more_with_the_biases_than_they_are_wide(factor: float) -> None:
    modes = make_rough_modes(1.0)
    fitted = modes.fitted(factor * modes.covariance)
    np.testing.assert_array_equal(fitted.covariance, factor * modes.covariance)
    expected = min(1.0, factor**0.5) * modes.cross_covariance
    np.testing.assert_allclose(fitted.cross_covariance, expected, rtol=1e-9, atol=1e-12)


def test_fitted_modes_stay_covariances() -> None:
    modes = make_rough_modes(1.0)
    fitted = modes.fitted(modes.covariance[::-1].copy())
    own = np.repeat(HAND + fitted.roughness, 3, axis=2).reshape(2, -1)
    for P, C, B in zip(fitted.covariance, fitted.cross_covariance, own, strict=True):
        assert np.linalg.eigvalsh(np.block([[P, C], [C.T, np.diag(B)]])).min() > 0.0


def test_modes_are_widened_where_they_are_narrower_than_told_and_nowhere_else() -> None:
    modes = make_rough_modes(1.0)
    narrow, wide = modes.covariance, np.linalg.cholesky(modes.covariance)
    factors = np.array([0.1, 0.5, 1.0, 2.0, 4.0, 9.0])
    told = wide * factors[None, None] @ np.swapaxes(wide, 1, 2)
    expected = wide * np.maximum(factors, 1.0)[None, None] @ np.swapaxes(wide, 1, 2)
    np.testing.assert_allclose(modes.at_least(told).covariance, expected, rtol=1e-9, atol=1e-15)
    np.testing.assert_allclose(modes.at_least(0.5 * narrow).covariance, narrow, rtol=1e-9, atol=1e-15)
    np.testing.assert_array_equal(modes.at_least(told).cross_covariance, modes.cross_covariance)
    assert len(TrackedModes.empty(2).at_least(np.zeros((0, 6, 6)))) == 0


def test_pruned_are_the_heaviest_and_sum_to_one() -> None:
    modes = make_rough_modes(0.0).chosen([0, 1, 0, 1])
    modes = dataclasses.replace(modes, log_weight=np.array([6.0, 10.0, -33.0, 9.0]))
    pruned = modes.pruned(MixtureParams(max_modes=3, least_share=0.05))
    np.testing.assert_array_equal(pruned.X_PO, modes.X_PO[[1, 3]])
    assert np.logaddexp.reduce(pruned.log_weight) == pytest.approx(0.0, abs=1e-12)
    assert np.diff(pruned.log_weight)[0] == pytest.approx(-1.0)
    assert len(TrackedModes.empty(2).pruned(MixtureParams())) == 0


def test_new_sources_are_unknown_to_the_modes() -> None:
    modes = make_rough_modes(1.0)
    wider = modes.with_sources(SOURCES + 2)
    np.testing.assert_array_equal(wider.cross_covariance[:, :, : 6 * SOURCES], modes.cross_covariance)
    np.testing.assert_array_equal(wider.cross_covariance[:, :, 6 * SOURCES :], np.zeros((2, 6, 12)))
    np.testing.assert_array_equal(wider.roughness[:, SOURCES:], np.zeros((2, 2, 2)))
    assert wider.with_sources(SOURCES) is wider


def test_larger_biases_widen_a_mode_by_how_it_depends_on_them() -> None:
    """Six contacts' distances that a pose is read off: it errs by what they err by, and by the noise."""
    generator = np.random.default_rng(0)
    gain, noise, variances = generator.normal(size=(6, 6)), 0.3 * np.eye(6), np.array([1.0, 4.0])

    def mode(roughness: np.ndarray) -> TrackedModes:
        B = np.diag(np.repeat(variances + roughness, 3))
        start = TrackedModes.independent(np.eye(3, 4)[None], np.eye(6)[None], 1)
        return dataclasses.replace(
            start,
            covariance=(gain @ B @ gain.T + noise)[None],
            cross_covariance=(-gain @ B)[None],
            roughness=roughness[None, None],
        )

    before, after = np.array([0.0, 0.5]), np.array([15.0, 0.1])
    found, expected = mode(before).with_roughness(after[None, None], variances), mode(after)
    np.testing.assert_allclose(found.covariance, expected.covariance, rtol=1e-12)
    np.testing.assert_allclose(found.cross_covariance, expected.cross_covariance, rtol=1e-12)
    np.testing.assert_array_equal(found.roughness, expected.roughness)
    assert len(TrackedModes.empty(2).with_roughness(np.zeros((0, 2, 2)), variances)) == 0


def random_pose(seed: int) -> np.ndarray:
    generator = np.random.default_rng(seed)
    return make_poses(random_rotations(generator, 1), 0.1 * generator.normal(size=(1, 3)))


def test_the_most_that_touch_may_tell_turns_with_the_object() -> None:
    spread = np.diag([4e-4, 1e-4, 2e-4, 1e-6, 9e-6, 4e-6])
    modes = TrackedModes.independent(random_pose(4), spread[None], 1)
    modes = dataclasses.replace(modes, most_information=np.linalg.inv(spread)[None])
    motion = Motion(np.array([0.3, -0.9, 0.5, 0.05, 0.0, -0.03]), np.zeros((6, 6)))
    turned = predict_poses(modes.X_PO, spread[None], motion)[1]
    np.testing.assert_allclose(np.linalg.inv(predict_modes(modes, motion, 0.3).most_information), turned, atol=1e-12)
    assert np.abs(turned - spread).max() > 1e-6


def test_what_is_no_knowledge_any_more_does_not_grow() -> None:
    modes = TrackedModes.independent(random_pose(3), COVARIANCE[None], 1)
    motion = Motion(np.zeros(6), np.diag(np.repeat([9.0, 4.0], 3)))
    for _ in range(3):
        modes = predict_modes(modes, motion, 0.3)
        np.testing.assert_allclose(np.linalg.eigvalsh(modes.covariance[0][3:, 3:]), 0.09)
        # The mean square of a random rotation's angle is pi^2 / 3 + 2.
        assert np.trace(modes.covariance[0][:3, :3]) == pytest.approx(np.pi**2 / 3.0 + 2.0)


def test_what_is_no_knowledge_any_more_shares_as_much_less_with_the_biases() -> None:
    limits = np.repeat([(np.pi**2 + 6.0) / 9.0, 0.3**2], 3)
    modes = TrackedModes.independent(random_pose(3), np.diag(4.0 * limits)[None], 2)
    cross = np.random.default_rng(0).normal(size=(1, 6, 12))
    modes = dataclasses.replace(modes, cross_covariance=cross)
    after = predict_modes(modes, Motion(np.zeros(6), np.zeros((6, 6))), 0.3)
    np.testing.assert_allclose(after.covariance[0], np.diag(limits), atol=1e-12)
    np.testing.assert_allclose(after.cross_covariance, 0.5 * cross)
