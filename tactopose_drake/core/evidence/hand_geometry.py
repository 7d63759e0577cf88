"""The hand's volume at one instant, as spheres."""

import dataclasses

import numpy as np

from tactopose_drake.core.validation import FloatArray, finite_array, positive_number
from tactopose_drake.errors import InvalidInputError


@dataclasses.dataclass(frozen=True, eq=False)
class HandGeometry:
    """Spheres that fill the hand at one instant.

    Attributes:
        p_PH: centres in the palm frame, shape (h, 3), m.
        radius: radii, shape (h,), m.
        sigma: standard deviation of the hand's surface from where the spheres have it, m: from joints, links, packing.

    Raises:
        InvalidInputError: no sphere, a number that is not finite, a shape that does not fit, or a radius or sigma that
            is not positive.
    """

    p_PH: FloatArray
    radius: FloatArray
    sigma: float = 0.001

    def __post_init__(self) -> None:
        p_PH = np.array(finite_array("p_PH", self.p_PH, (None, 3)))
        radius = np.array(finite_array("radius", self.radius, (len(p_PH),)))
        if not len(p_PH):
            raise InvalidInputError("p_PH: holds no sphere; the least is 1.")
        if np.any(radius <= 0):
            raise InvalidInputError(f"radius: holds {radius.min():g}; allowed are numbers > 0.")
        object.__setattr__(self, "sigma", positive_number("sigma", self.sigma))
        for name, value in (("p_PH", p_PH), ("radius", radius)):
            value.setflags(write=False)
            object.__setattr__(self, name, value)

    def __len__(self) -> int:
        return len(self.radius)
