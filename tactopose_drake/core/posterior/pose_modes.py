"""The modes of what is believed of an object's pose, as a mixture of Gaussians: an estimate in arrays."""

import dataclasses

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.poses import retract
from tactopose_drake.core.validation import FloatArray, finite_array
from tactopose_drake.errors import InvalidInputError

MOST_OF_THE_MASS = 0.5
"""The share of the probability that the first mode must carry to be called the answer."""


@dataclasses.dataclass(frozen=True, eq=False)
class PoseModes:
    """Modes of the object's pose in the palm frame; n of them, one at least.

    Attributes:
        X_PO: their poses, shape (n, 3, 4).
        probability: of each, shape (n,); they are scaled to sum to 1.
        covariance: of the increments (w, v) as in `poses.py`, shape (n, 6, 6), rad and m.

    Raises:
        InvalidInputError: a shape that does not fit, a number that is not finite, no mode, or probabilities that are
            negative or all 0.
    """

    X_PO: FloatArray
    probability: FloatArray
    covariance: FloatArray

    def __post_init__(self) -> None:
        X_PO = finite_array("X_PO", self.X_PO, (None, 3, 4))
        probability = finite_array("probability", self.probability, (len(X_PO),))
        if not len(X_PO) or probability.min() < 0.0 or not probability.sum() > 0.0:
            raise InvalidInputError(f"probability: is {probability}; allowed are numbers >= 0, one of them > 0.")
        object.__setattr__(self, "X_PO", X_PO)
        object.__setattr__(self, "probability", probability / probability.sum())
        object.__setattr__(self, "covariance", finite_array("covariance", self.covariance, (len(X_PO), 6, 6)))

    def __len__(self) -> int:
        return len(self.X_PO)

    @property
    def entropy(self) -> float:
        """Of which mode is the true one, nats."""
        share = self.probability[self.probability > 0.0]
        return float(-np.sum(share * np.log(share)))

    def likely(self, least: float) -> NDArray[np.intp]:
        """The modes of at least that probability, or of the largest there is."""
        return np.flatnonzero(self.probability >= min(least, self.probability.max()))

    def sample(self, count: int, generator: np.random.Generator) -> FloatArray:
        """Poses drawn from it, shape (count, 3, 4)."""
        mode = generator.choice(len(self), size=count, p=self.probability)
        normal = generator.normal(size=(count, 6))
        increment = np.einsum("bij,bj->bi", self.roots()[mode], normal)
        return retract(self.X_PO[mode], increment)

    def roots(self) -> FloatArray:
        """Matrices whose products with their transposes are the covariances, shape (n, 6, 6)."""
        values, vectors = np.linalg.eigh(self.covariance)
        roots: FloatArray = vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :]
        return roots
