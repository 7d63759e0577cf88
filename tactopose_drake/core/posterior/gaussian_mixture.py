"""A Gaussian mixture over poses: the belief about an object's pose at one instant."""

import dataclasses

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.geometry_checks import FARTHEST
from tactopose_drake.core.plain_values import ReadOnlyCopies
from tactopose_drake.core.poses import retract
from tactopose_drake.core.validation import FloatArray, check_count, instance_of, limited
from tactopose_drake.errors import InvalidInputError

# Bounds on a mixture from outside, far beyond any real belief; products of such numbers are still finite.
_MOST_WEIGHT, _MOST_VARIANCE = 1e100, 1e6


@dataclasses.dataclass(frozen=True, eq=False)
class GaussianMixture(ReadOnlyCopies):
    """A mixture over the object's pose in the palm frame: n modes, Gaussian in the increments from their poses.

    Its arrays are read-only copies of those given.

    Attributes:
        X_PO: the modes' poses, shape (n, 3, 4).
        weights: their probabilities, shape (n,); they sum to 1.
        covariance: of the increments (w, v) as in `poses.py`, shape (n, 6, 6), rad and m.
    """

    X_PO: FloatArray
    weights: FloatArray
    covariance: FloatArray

    def __post_init__(self) -> None:
        for name in ("X_PO", "weights", "covariance"):
            array = np.array(getattr(self, name))
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    @classmethod
    def empty(cls) -> "GaussianMixture":
        """A mixture without modes: nothing is known."""
        return cls(np.zeros((0, 3, 4)), np.zeros(0), np.zeros((0, 6, 6)))

    def __len__(self) -> int:
        return len(self.X_PO)

    @property
    def entropy(self) -> float:
        """Entropy of the discrete distribution over the modes, nats."""
        share = self.weights[self.weights > 0.0]
        return float(-np.sum(share * np.log(share)))

    def likely(self, least: float) -> NDArray[np.intp]:
        """Indices of the modes with at least this weight, or of the heaviest if none has it."""
        return np.flatnonzero(self.weights >= min(least, self.weights.max()))

    def sample(self, count: int, generator: np.random.Generator) -> FloatArray:
        """Poses drawn from it, shape (count, 3, 4)."""
        mode = generator.choice(len(self), size=count, p=self.weights)
        normal = generator.normal(size=(count, 6))
        increment = np.einsum("bij,bj->bi", self.roots()[mode], normal)
        return retract(self.X_PO[mode], increment)

    def roots(self) -> FloatArray:
        """Square roots A of the covariances, A A^T = covariance, shape (n, 6, 6)."""
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
    check_count(name, len(X_PO), "modes")
    if weights.min() < 0.0 or not weights.sum() > 0.0:
        raise InvalidInputError(f"{name}.weights must be numbers >= 0, one of them > 0, not {weights}.")
    return GaussianMixture(X_PO, weights / weights.sum(), covariance)
