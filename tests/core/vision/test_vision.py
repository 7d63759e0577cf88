import math

import numpy as np
import pytest
from scipy.stats import kstest, norm, t

from tactopose_drake.core.poses import exp_so3, increments_between, make_poses
from tactopose_drake.core.vision.vision_model import VisionModel, measure_pose, tail_stretch
from tactopose_drake.errors import InvalidInputError

X_PO = make_poses(exp_so3(np.array([0.2, -1.1, 0.4])), np.array([0.02, -0.01, 0.1]))
MODEL = VisionModel(
    translation_clear=0.004, translation_hidden=0.05, rotation_clear_deg=3.0, rotation_hidden_deg=21.0, lost_share=1.0
)


@pytest.mark.parametrize(
    ("hidden", "translation", "degrees"), [(0.0, 0.004, 3.0), (0.5, 0.027, 12.0), (1.0, 0.05, 21.0)]
)
def test_the_error_grows_with_the_hidden_share(hidden: float, translation: float, degrees: float) -> None:
    for noise in np.random.default_rng(0).normal(size=(5, 6)):
        error = increments_between(X_PO, measure_pose(X_PO, hidden, noise, MODEL).mean)
        assert np.linalg.norm(error[:3]) == pytest.approx(math.radians(degrees))
        assert np.linalg.norm(error[3:]) == pytest.approx(translation)


@pytest.mark.parametrize("degrees_of_freedom", [5.0, 12.0])
def test_tails_are_those_of_students_t(degrees_of_freedom: float) -> None:
    noise = np.random.default_rng(1).normal(size=(4000, 2))
    errors = [error * tail_stretch(tail, degrees_of_freedom) for error, tail in noise]
    assert kstest(errors, t(degrees_of_freedom).cdf).pvalue > 0.01
    assert kstest(errors, norm.cdf).statistic > kstest(errors, t(degrees_of_freedom).cdf).statistic


def test_a_stretched_error_is_larger_than_the_prior_says() -> None:
    seen, stretched = (measure_pose(X_PO, 0.5, np.ones(6), MODEL, stretch) for stretch in (1.0, 3.0))
    np.testing.assert_array_equal(stretched.sigmas, seen.sigmas)
    near, far = (np.linalg.norm(increments_between(X_PO, prior.mean)[3:]) for prior in (seen, stretched))
    assert far == pytest.approx(3.0 * near)


def test_beyond_the_lost_share_the_error_grows_no_more() -> None:
    model = VisionModel(translation_clear=0.004, translation_hidden=0.05, lost_share=0.25)
    noise = np.random.default_rng(0).normal(size=6)
    sizes = [
        np.linalg.norm(measure_pose(X_PO, hidden, noise, model).mean[:, 3] - X_PO[:, 3])
        for hidden in (0.125, 0.25, 0.8)
    ]
    assert sizes == pytest.approx([0.027, 0.05, 0.05])
    with pytest.raises(InvalidInputError, match=r"lost_share must be .*, not 1\.5"):
        VisionModel(lost_share=1.5).validate()


def test_the_prior_states_the_errors_standard_deviation() -> None:
    noise = np.random.default_rng(0).normal(size=(2000, 6))
    priors = [measure_pose(X_PO, 0.7, z, MODEL) for z in noise]
    errors = np.array([increments_between(X_PO, prior.mean) for prior in priors])
    np.testing.assert_allclose(np.sqrt(np.mean(errors**2, axis=0)), priors[0].sigmas, rtol=0.05)
    np.testing.assert_allclose(errors.mean(axis=0) / priors[0].sigmas, 0.0, atol=0.1)


def test_the_same_noise_gives_the_same_pose_and_no_noise_is_no_failure() -> None:
    noise = np.random.default_rng(0).normal(size=6)
    np.testing.assert_array_equal(
        measure_pose(X_PO, 0.3, noise, MODEL).mean, measure_pose(X_PO, 0.3, noise, MODEL).mean
    )
    assert np.all(np.isfinite(measure_pose(X_PO, 0.3, np.zeros(6), MODEL).mean))


@pytest.mark.parametrize(
    "name", ["translation_clear", "translation_hidden", "rotation_clear_deg", "rotation_hidden_deg"]
)
def test_an_error_of_zero_is_refused_by_name(name: str) -> None:
    with pytest.raises(InvalidInputError, match=f"{name} must be .*, not 0"):
        VisionModel(**{name: 0.0}).validate()
