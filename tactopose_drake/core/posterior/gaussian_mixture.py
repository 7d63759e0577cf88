"""What is believed of an object's pose at one time: a mixture of Gaussians over poses."""

import dataclasses

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.geometry_checks import FARTHEST
from tactopose_drake.core.poses import retract
from tactopose_drake.core.validation import FloatArray, instance_of, limited
from tactopose_drake.errors import InvalidInputError

# Of a mixture that is given from outside: nobody believes more, and products of such numbers are still finite.
_MOST_WEIGHT, _MOST_VARIANCE = 1e100, 1e6


@dataclasses.dataclass(frozen=True, eq=False)
class GaussianMixture:
    """Modes of the object's pose in the palm frame, each a Gaussian of the increments from its pose; n of them.

    Attributes:
        X_PO: the modes' poses, shape (n, 3, 4).
        weights: their probabilities, shape (n,); they sum to 1.
        covariance: of the increments (w, v) as in `poses.py`, shape (n, 6, 6), rad and m.
    """

    X_PO: FloatArray
    weights: FloatArray
    covariance: FloatArray

    @classmethod
    def empty(cls) -> "GaussianMixture":
        """No mode at all: nothing is known."""
        return cls(np.zeros((0, 3, 4)), np.zeros(0), np.zeros((0, 6, 6)))

    def __len__(self) -> int:
        return len(self.X_PO)

    @property
    def entropy(self) -> float:
        """Of which mode is the true one, nats."""
        share = self.weights[self.weights > 0.0]
        return float(-np.sum(share * np.log(share)))

    def likely(self, least: float) -> NDArray[np.intp]:
        """The modes of at least that weight, or of the largest there is."""
        return np.flatnonzero(self.weights >= min(least, self.weights.max()))

    def sample(self, count: int, generator: np.random.Generator) -> FloatArray:
        """Poses drawn from it, shape (count, 3, 4)."""
        mode = generator.choice(len(self), size=count, p=self.weights)
        normal = generator.normal(size=(count, 6))
        increment = np.einsum("bij,bj->bi", self.roots()[mode], normal)
        return retract(self.X_PO[mode], increment)

    def roots(self) -> FloatArray:
        """Matrices whose products with their transposes are the covariances, shape (n, 6, 6)."""
        values, vectors = np.linalg.eigh(self.covariance)
        roots: FloatArray = vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :]
        return roots


def checked_mixture(name: str, value: object) -> GaussianMixture:
    """Returns a mixture that is given from outside, its weights scaled to sum to 1.

    Raises:
        InvalidInputError: a value that is none, a shape that does not fit, a number that is not finite or beyond all
            reason, no mode, or weights that are negative or all 0.
    """
    instance_of(name, value, GaussianMixture)
    assert isinstance(value, GaussianMixture)
    X_PO = limited(f"{name}.X_PO", value.X_PO, (None, 3, 4), most=FARTHEST)
    weights = limited(f"{name}.weights", value.weights, (len(X_PO),), most=_MOST_WEIGHT)
    covariance = limited(f"{name}.covariance", value.covariance, (len(X_PO), 6, 6), most=_MOST_VARIANCE)
    if not len(X_PO):
        raise InvalidInputError(f"{name}: has no mode; allowed is a mixture of one at least.")
    if weights.min() < 0.0 or not weights.sum() > 0.0:
        raise InvalidInputError(f"{name}.weights: are {weights}; allowed are numbers >= 0, one of them > 0.")
    return GaussianMixture(X_PO, weights / weights.sum(), covariance)
