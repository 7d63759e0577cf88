"""What is known of the object's pose before the touch, mostly from vision."""

import dataclasses
import math

import numpy as np

from tactopose_drake.core.validation import FloatArray, pose_matrix, positive_number


@dataclasses.dataclass(frozen=True, eq=False)
class GaussianPrior:
    """A Gaussian belief of the object's pose.

    Attributes:
        mean: the object's pose in the palm frame, shape (3, 4); anything with `GetAsMatrix34` is taken too.
        sigma_translation: standard deviation of each coordinate of p_PO, m.
        sigma_rotation: standard deviation of a small rotation about each axis, rad.

    Raises:
        InvalidInputError: a pose that is none, or a sigma that is not positive and finite.
    """

    mean: FloatArray
    sigma_translation: float = 0.033
    sigma_rotation: float = math.radians(16.0)

    def __post_init__(self) -> None:
        mean = pose_matrix("mean", self.mean)
        mean.setflags(write=False)
        object.__setattr__(self, "mean", mean)
        object.__setattr__(self, "sigma_translation", positive_number("sigma_translation", self.sigma_translation))
        object.__setattr__(self, "sigma_rotation", positive_number("sigma_rotation", self.sigma_rotation))

    @property
    def sigmas(self) -> FloatArray:
        """Standard deviations of the six increments (w, v), shape (6,), rad and m."""
        return np.repeat([self.sigma_rotation, self.sigma_translation], 3)
