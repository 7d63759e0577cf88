import dataclasses

import numpy as np
import pytest

from tactopose_drake.core.poses import compose, exp_so3, inverse, make_poses
from tactopose_drake.core.posterior.gaussian_mixture import GaussianMixture, checked_mixture
from tactopose_drake.errors import InvalidInputError


def test_a_mixture_is_sampled_by_its_weights_and_covariances() -> None:
    generator = np.random.default_rng(0)
    root = generator.normal(size=(6, 6)) * np.repeat([0.05, 0.01], 3)[:, None]
    X = make_poses(exp_so3(np.array([[0.0, 0, 0], [0, 0, 2.0]])), np.array([[0.0, 0, 0], [0.5, 0, 0]]))
    given = GaussianMixture(X, [3.0, 1.0], np.array([root @ root.T, np.zeros((6, 6))]))  # type: ignore[arg-type]
    belief = checked_mixture("belief", given)
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


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("X_PO", np.zeros((2, 4, 4)), r"belief\.X_PO must have the shape .*, not \(2, 4, 4\)"),
        ("X_PO", np.full((2, 3, 4), 1e160), r"belief\.X_PO\[0, 0, 0\] must be a number from -10 to 10, not 1e\+160"),
        ("covariance", np.full((2, 6, 6), 1e300), r"belief\.covariance\[0, 0, 0\] must be .*, not 1e\+300"),
        ("weights", np.zeros(2), r"belief\.weights must be .*, not \[0\. 0\.\]"),
        ("weights", np.array([2.0, -1.0]), r"belief\.weights must be numbers >= 0, one of them > 0, not"),
        ("weights", np.ones(3), r"belief\.weights must have the shape .*, not \(3,\)"),
        ("covariance", np.full((2, 6, 6), np.nan), r"belief\.covariance\[0, 0, 0\] must be .*, not nan"),
    ],
)
def test_a_mixture_from_outside_is_checked(name: str, value: np.ndarray, message: str) -> None:
    two = GaussianMixture(np.tile(np.eye(3, 4), (2, 1, 1)), np.full(2, 0.5), np.zeros((2, 6, 6)))
    with pytest.raises(InvalidInputError, match=message):
        checked_mixture("belief", dataclasses.replace(two, **{name: value}))


def test_a_mixture_is_unaffected_by_changes_of_the_arrays_it_was_made_of() -> None:
    arrays = {"X_PO": np.tile(np.eye(3, 4), (2, 1, 1)), "weights": np.full(2, 0.5), "covariance": np.zeros((2, 6, 6))}
    mixture = GaussianMixture(**arrays)
    for name, array in arrays.items():
        held, given = getattr(mixture, name), array.copy()
        array += 1.0
        np.testing.assert_array_equal(held, given)
        with pytest.raises(ValueError, match="read-only"):
            held += 1.0


def test_an_empty_mixture_has_no_mode() -> None:
    assert len(GaussianMixture.empty()) == 0
    assert GaussianMixture.empty().entropy == 0.0
