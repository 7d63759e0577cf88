"""The prior of the object's pose, with the pose as a RigidTransform."""

from __future__ import annotations

import dataclasses
import math

from numpy.typing import ArrayLike
from pydrake.math import RigidTransform

from tactopose_drake.core.evidence.gaussian_prior import UNKNOWN_SIGMA, WIDEST_TRANSLATION, GaussianPrior
from tactopose_drake.core.geometry_checks import pose_near
from tactopose_drake.core.validation import FloatArray, remark

# Larger standard deviations say nothing of the pose of an object in a hand, and are probably in another unit.
_WIDEST = {
    "sigma_translation": (WIDEST_TRANSLATION, "m", "Multiply by 0.001 what is in millimetres"),
    "sigma_rotation": (math.pi, "rad", "Multiply by pi / 180 what is in degrees"),
}


@dataclasses.dataclass(frozen=True, eq=False, init=False, repr=False)
class PosePrior(GaussianPrior):
    """A Gaussian belief of the object's pose.

    If the object's middle lies farther from O than the object is large, both standard deviations are those of a frame
    at its middle: an error of the rotation about a far origin would move the object by as much.

    Attributes:
        X_PO: the object's pose in the palm frame; each access returns a new copy.
        mean: the same as an array, shape (3, 4), for `core`.
        sigma_translation: standard deviation of each coordinate of p_PO, m, from 1e-7 to 1000. More than 1 m is logged
            as a remark, since it is probably in millimetres, except for 1000, which says that nothing is known. Either
            way the object is where it is touched, as without a prior.
        sigma_rotation: standard deviation of a small rotation about each axis, rad, from 1e-6 to 1000. More than pi is
            logged likewise, since it is probably in degrees.

    Raises:
        InvalidInputError: if the pose is invalid or farther away than 10 m, or a sigma is out of its range.
    """

    X_PO: RigidTransform = dataclasses.field(kw_only=True)
    mean: FloatArray = dataclasses.field(init=False, repr=False)

    def __init__(
        self,
        X_PO: RigidTransform | ArrayLike,
        sigma_translation: float = 0.033,
        sigma_rotation: float = math.radians(16.0),
    ) -> None:
        """Takes the pose as a RigidTransform, or as an array of shape (3, 4) or (4, 4)."""
        super().__init__(pose_near("X_PO", X_PO), sigma_translation, sigma_rotation)
        for name, (most, unit, cure) in _WIDEST.items():
            if most < (sigma := getattr(self, name)) < UNKNOWN_SIGMA:
                remark(f"PosePrior: {name} is {sigma:g} {unit}, with which the prior says nothing. {cure}.")

    @classmethod
    def of(cls, prior: GaussianPrior) -> PosePrior:
        """Converts a prior of `core`."""
        return cls(prior.mean, prior.sigma_translation, prior.sigma_rotation)


# X_PO stays a dataclass field, so that it is in `to_dict`, but is computed from the mean.
PosePrior.X_PO = property(lambda prior: RigidTransform(pose=prior.mean), doc="The pose in the palm frame; a new copy.")
