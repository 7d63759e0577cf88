"""What is known of the object's pose before the touch, usually from vision."""

import dataclasses
import math

import numpy as np

from tactopose_drake.core.compilation import read_only
from tactopose_drake.core.geometry_checks import in_steps, pose_near
from tactopose_drake.core.plain_values import PlainValue, numbers
from tactopose_drake.core.validation import FloatArray, positive_number

UNKNOWN_SIGMA = 1e3
"""Standard deviation, m and rad, of which nothing is known: the largest."""
WIDEST_TRANSLATION = 1.0
"""Standard deviation of translations, m, beyond which a prior says nothing of the position of an object in a hand."""
PRIOR_SIGMA_LIMITS = {"sigma_translation": (1e-7, UNKNOWN_SIGMA), "sigma_rotation": (1e-6, UNKNOWN_SIGMA)}
"""In m and rad. Beyond these, the information of the prior and of the touch exceed the precision of a double."""


@dataclasses.dataclass(frozen=True, eq=False)
class GaussianPrior(PlainValue):
    """A Gaussian prior of the object's pose.

    Attributes:
        mean: the object's pose in the palm frame, shape (3, 4); anything with `GetAsMatrix34` is taken too.
        sigma_translation: standard deviation of each coordinate of p_PO, m, from 1e-7 to 1000.
        sigma_rotation: standard deviation of a small rotation about each axis, rad, from 1e-6 to 1000.

    Raises:
        InvalidInputError: an invalid pose or one farther away than 10 m, or a sigma out of its range.
    """

    mean: FloatArray
    sigma_translation: float = 0.033
    sigma_rotation: float = math.radians(16.0)

    def __post_init__(self) -> None:
        mean = pose_near("mean", self.mean)
        mean.setflags(write=False)
        object.__setattr__(self, "mean", mean)
        for name, (least, most) in PRIOR_SIGMA_LIMITS.items():
            object.__setattr__(self, name, positive_number(name, getattr(self, name), least=least, most=most))

    def __repr__(self) -> str:
        return (
            f"<{type(self).__name__}: p_PO {numbers(1e3 * self.mean[:, 3], 1)} mm, sigma_translation "
            f"{1e3 * self.sigma_translation:.3g} mm, sigma_rotation {math.degrees(self.sigma_rotation):.3g} deg>"
        )

    def rounded(self) -> "GaussianPrior":
        """The prior with its pose rounded to a nanometre and a nanoradian."""
        return GaussianPrior.unchecked(in_steps(self.mean), self.sigma_translation, self.sigma_rotation)

    @staticmethod
    def unchecked(mean: FloatArray, sigma_translation: float, sigma_rotation: float) -> "GaussianPrior":
        """A prior of values that are known to be valid."""
        prior = object.__new__(GaussianPrior)
        vars(prior).update(mean=read_only(mean), sigma_translation=sigma_translation, sigma_rotation=sigma_rotation)
        return prior

    @property
    def tells_position(self) -> bool:
        """Whether it bounds the position more than the touch itself does."""
        return self.sigma_translation <= WIDEST_TRANSLATION

    @property
    def sigmas(self) -> FloatArray:
        """Standard deviations of the six increments (w, v), shape (6,), rad and m."""
        return np.array([self.sigma_rotation] * 3 + [self.sigma_translation] * 3)
