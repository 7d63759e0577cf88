"""A pose that something other than touch measured, mostly a camera's tracker, with its time."""

from __future__ import annotations

import dataclasses

import numpy as np

from tactopose_drake.core.evidence.gaussian_prior import GaussianPrior
from tactopose_drake.core.validation import LATEST, FloatArray, limited, points_near, pose_matrix
from tactopose_drake.errors import InvalidInputError


@dataclasses.dataclass(frozen=True, eq=False)
class PoseMeasurement:
    """The object's pose in the palm at one time in the past.

    Attributes:
        time: when it was so, s, of the clock that the frames of the belief are of: of the picture, not of its delivery.
        X_PO: the pose at that time, shape (3, 4), p in m, up to 10; a RigidTransform is taken too.
        covariance: of the increment (w, v) from it to the true pose, shape (6, 6), rad and m, of standard
            deviations from 1e-7 to 1000.

    Raises:
        InvalidInputError: a time or pose that is none, or a covariance that is not symmetric and positive definite.
    """

    time: float
    X_PO: FloatArray
    covariance: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "time", float(limited("time", self.time, (), most=LATEST)))
        covariance = limited("covariance", self.covariance, (6, 6), most=_MOST_VARIANCE)
        scale = np.sqrt(np.abs(np.diag(covariance)))
        if np.abs(covariance - covariance.T).max() > 1e-6 * scale.max() ** 2:
            raise InvalidInputError("covariance: is not symmetric.")
        if scale.min() < _LEAST_SIGMA or np.linalg.eigvalsh(covariance / np.outer(scale, scale)).min() <= 0.0:
            raise InvalidInputError(
                f"covariance: is not positive definite with standard deviations of {_LEAST_SIGMA:g} or more."
            )
        X_PO = pose_matrix("X_PO", self.X_PO)
        points_near("X_PO", X_PO[None, :, 3], (1, 3))
        for name, array in (("X_PO", X_PO), ("covariance", covariance)):
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    @classmethod
    def from_prior(cls, prior: GaussianPrior, time: float) -> PoseMeasurement:
        """What a prior says.

        Args:
            prior: of the pose.
            time: when it is so, s.
        """
        return cls(time, prior.mean, np.diag(prior.sigmas**2))

        Args:
            prior: what is known of the pose.
            time: as of when, s.
        """
        return cls(time, prior.mean, np.diag(prior.sigmas**2))

    def as_prior(self) -> GaussianPrior:
        """A prior that is at least as wide in every direction of rotation and of translation."""
        widest = [float(np.sqrt(np.linalg.eigvalsh(self.covariance[part, part])[-1])) for part in (_W, _V)]
        return GaussianPrior(self.X_PO, sigma_rotation=widest[0], sigma_translation=widest[1])


_W, _V = slice(0, 3), slice(3, 6)
_LEAST_SIGMA, _MOST_VARIANCE = 1e-7, 1e6
