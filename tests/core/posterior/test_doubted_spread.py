import numpy as np
import pytest
import trimesh
from scipy.stats import chi2

import tactopose_drake as tp
from tactopose_drake.core.kernels.contact_alternatives_kernels import Alternatives
from tactopose_drake.core.poses import increments_between, retract
from tactopose_drake.core.posterior.doubted_spread_kernels import widen_modes

SIZES = np.array([0.06, 0.09, 0.13])
SCALE = np.repeat([0.02, 0.001], 3)


def random_information(generator: np.random.Generator, count: int) -> np.ndarray:
    factors = generator.normal(size=(count, 12, 6)) / SCALE
    return np.einsum("zai,zaj->zij", factors, factors)


def alternatives(seed: int) -> Alternatives:
    generator = np.random.default_rng(seed)
    information = random_information(generator, 5)
    return Alternatives(
        generator.uniform(0.05, 1.0, size=(1, 5)), 4.0 * generator.normal(size=(1, 5, 6)) / SCALE, information[None]
    )


def mean_product(of: Alternatives) -> np.ndarray:
    """Of the increments of the mixture of the local models, written out."""
    inverse = np.linalg.inv(of.information[0])
    step = -np.einsum("zij,zj->zi", inverse, of.gradient[0])
    gain = np.einsum("zi,zij,zj->z", of.gradient[0], inverse, of.gradient[0])
    weight = of.share[0] * np.exp(0.5 * gain) / np.sqrt(np.linalg.det(of.information[0] * np.outer(SCALE, SCALE)))
    second = inverse + np.einsum("zi,zj->zij", step, step)
    return np.asarray(np.einsum("z,zij->ij", weight / weight.sum(), second))


@pytest.mark.parametrize("seed", range(4))
def test_what_is_narrow_becomes_the_mixture(seed: int) -> None:
    of = alternatives(seed)
    expected = mean_product(of)
    covariance = 1e-6 * expected[None]
    widen_modes(of, covariance)
    np.testing.assert_allclose(covariance[0] / np.outer(SCALE, SCALE), expected / np.outer(SCALE, SCALE), rtol=1e-5)


@pytest.mark.parametrize("seed", range(4))
def test_what_is_wide_stays_and_what_is_in_between_is_no_less_than_both(seed: int) -> None:
    of = alternatives(seed)
    least = mean_product(of)
    wide = 4.0 * least[None]
    widen_modes(of, wide)
    np.testing.assert_allclose(wide[0] / np.outer(SCALE, SCALE), 4.0 * least / np.outer(SCALE, SCALE), rtol=1e-8)
    before = np.linalg.inv(random_information(np.random.default_rng(seed + 10), 1))
    after = before.copy()
    widen_modes(of, after)
    for narrower in (before[0], least):
        more = (after[0] - narrower) / np.outer(SCALE, SCALE)
        assert np.linalg.eigvalsh(more).min() > -1e-5 * np.abs(more).max()


def test_without_a_false_contact_and_without_a_local_model_nothing_changes() -> None:
    of = alternatives(0)
    none = of._replace(information=np.full_like(of.information, np.nan))
    covariance = np.linalg.inv(random_information(np.random.default_rng(1), 1))
    after = covariance.copy()
    widen_modes(none, after)
    np.testing.assert_array_equal(after, covariance)
    of.share[0, 1:] = 0.0
    of.gradient[:] = 0.0
    narrow = 1e-6 * covariance
    widen_modes(of, narrow)
    np.testing.assert_allclose(
        np.linalg.inv(narrow[0]) * np.outer(SCALE, SCALE), of.information[0, 0] * np.outer(SCALE, SCALE), rtol=1e-5
    )


def test_a_pose_that_hangs_on_one_contact_may_be_off_as_far_as_that_may_be_displaced() -> None:
    model = tp.ObjectModel.from_mesh(trimesh.creation.box(SIZES))
    on_faces = np.array(
        [[1, 0.1, 0.1], [0.2, 1, 0.7], [-0.2, 1, -0.6], [0.7, 0.6, 1], [-0.6, 0.5, 1], [0.1, -0.7, 1]], dtype=float
    )
    p, n = 0.5 * SIZES * on_faces, np.eye(3)[[0, 1, 1, 2, 2, 2]]
    away = p.copy()
    away[0, 0] += 0.012  # The only contact that tells where the box is along x.
    prior = tp.PosePrior(retract(np.eye(3, 4), np.array([0.02, -0.03, 0.01, 0.004, -0.006, 0.003])))
    off = tp.estimate_pose(model, tp.Contacts(away, n), prior=prior).best
    error = increments_between(off.X_PO.GetAsMatrix34()[None], np.eye(3, 4)[None])[0]
    assert off.inlier_probability.min() > 0.5  # All fit where the box is not.
    assert abs(error[3]) > 0.008
    assert error @ np.linalg.solve(off.covariance, error) < chi2.ppf(0.999, 6)
    sure = tp.estimate_pose(model, tp.Contacts(away, n), prior=prior, outlier_probability=0.0).best
    assert np.sqrt(off.covariance[3, 3]) > 2.5 * np.sqrt(sure.covariance[3, 3])
