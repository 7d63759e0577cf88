"""What is believed of an object's pose at one time: a mixture of Gaussians over poses."""

import dataclasses

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.poses import retract
from tactopose_drake.core.validation import FloatArray, finite_array, instance_of
from tactopose_drake.errors import InvalidInputError

MOST_OF_THE_MASS = 0.5
"""The share of the probability that the first mode must carry to be called the answer."""
# Weights that sum to 1 within this do so but for rounding.
_ROUNDING = 1e-12


@dataclasses.dataclass(frozen=True, eq=False)
class GaussianMixture:
    """Modes of the object's pose in the palm frame, each a Gaussian of the increments from its pose; n of them.

    Attributes:
        X_PO: the modes' poses, shape (n, 3, 4).
        weights: their probabilities, shape (n,); they are scaled to sum to 1, where they do not but for rounding.
        covariance: of the increments (w, v) as in `poses.py`, shape (n, 6, 6), rad and m.

    Raises:
        InvalidInputError: a shape that does not fit, a number that is not finite, or weights of modes that are negative
            or all 0.
    """

    X_PO: FloatArray
    weights: FloatArray
    covariance: FloatArray

    def __post_init__(self) -> None:
        X_PO = finite_array("X_PO", self.X_PO, (None, 3, 4))
        weights = finite_array("weights", self.weights, (len(X_PO),))
        if len(X_PO):
            total = weights.sum()
            if weights.min() < 0.0 or not total > 0.0:
                raise InvalidInputError(f"weights: are {weights}; allowed are numbers >= 0, one of them > 0.")
            if abs(total - 1.0) > _ROUNDING:
                weights = weights / total
        object.__setattr__(self, "X_PO", X_PO)
        object.__setattr__(self, "weights", weights)
        object.__setattr__(self, "covariance", finite_array("covariance", self.covariance, (len(X_PO), 6, 6)))

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


def check_belief(name: str, value: object) -> None:
    """Checks that a value is a mixture of one mode at least.

    Raises:
        InvalidInputError: if it is not.
    """
    instance_of(name, value, GaussianMixture)
    if not len(value):  # type: ignore[arg-type]
        raise InvalidInputError(f"{name}: has no mode; allowed is a mixture of one at least.")
