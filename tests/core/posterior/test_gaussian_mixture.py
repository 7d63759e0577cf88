import numpy as np
import pytest

from tactopose_drake.core.poses import compose, exp_so3, inverse, make_poses
from tactopose_drake.core.posterior.gaussian_mixture import GaussianMixture
from tactopose_drake.errors import InvalidInputError


def test_a_mixture_is_sampled_by_its_weights_and_covariances() -> None:
    generator = np.random.default_rng(0)
    root = generator.normal(size=(6, 6)) * np.repeat([0.05, 0.01], 3)[:, None]
    X = make_poses(exp_so3(np.array([[0.0, 0, 0], [0, 0, 2.0]])), np.array([[0.0, 0, 0], [0.5, 0, 0]]))
    belief = GaussianMixture(X, [3.0, 1.0], np.array([root @ root.T, np.zeros((6, 6))]))  # type: ignore[arg-type]
    np.testing.assert_allclose(belief.weights, [0.75, 0.25])
    assert belief.entropy == pytest.approx(-0.75 * np.log(0.75) - 0.25 * np.log(0.25))
    assert list(belief.likely(0.3)) == [0]
    assert list(belief.likely(0.9)) == [0]
    drawn = belief.sample(4000, generator)
    second = np.all(np.isclose(drawn, X[1]), axis=(1, 2))
    assert abs(second.mean() - 0.25) < 0.03
    p = drawn[~second][:, :, 3]
    assert np.allclose(np.cov(p.T), (root @ root.T)[3:, 3:], rtol=0.15, atol=2e-5)
    assert np.allclose(compose(X[1], inverse(drawn[second][0])), np.eye(3, 4))
    with pytest.raises(InvalidInputError, match="weights"):
        GaussianMixture(X, np.zeros(2), np.zeros((2, 6, 6)))


def test_weights_that_sum_to_one_but_for_rounding_stay_as_they_are() -> None:
    weights = np.array([0.25, 0.75 + 2.0**-51])
    assert weights.sum() > 1.0
    mixture = GaussianMixture(np.tile(np.eye(3, 4), (2, 1, 1)), weights, np.zeros((2, 6, 6)))
    np.testing.assert_array_equal(mixture.weights, weights)


def test_an_empty_mixture_has_no_mode() -> None:
    assert len(GaussianMixture.empty()) == 0
    assert GaussianMixture.empty().entropy == 0.0
