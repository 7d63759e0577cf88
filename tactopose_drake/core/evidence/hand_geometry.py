"""The hand's volume at one instant, as spheres."""

import dataclasses
from typing import Self

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.geometry_checks import FARTHEST, points_near
from tactopose_drake.core.plain_values import PlainValue, copied
from tactopose_drake.core.validation import FloatArray, check_count, positive_number, positive_numbers


@dataclasses.dataclass(frozen=True, eq=False)
class HandGeometry(PlainValue):
    """Spheres that fill the hand at one instant.

    Attributes:
        p_PH: centres in the palm frame, shape (h, 3), m; coordinates up to 10 m.
        radius: radii, shape (h,), m, from 1e-6 to 10.
        sigma: standard deviation of the hand's surface relative to the spheres, m, from errors of joints, links and
            packing; from 1e-7 to 10.

    Raises:
        InvalidInputError: no sphere, values that are not finite numbers, a shape that does not fit, or a number out of
            its range.
    """

    p_PH: FloatArray
    radius: FloatArray
    sigma: float = 0.001

    def __post_init__(self) -> None:
        p_PH = points_near("p_PH", self.p_PH, (None, 3))
        check_count("p_PH", len(p_PH), "spheres")
        radius = positive_numbers("radius", self.radius, (len(p_PH),), least=1e-6, most=FARTHEST)
        object.__setattr__(self, "sigma", positive_number("sigma", self.sigma, least=1e-7, most=FARTHEST))
        for name, value in (("p_PH", p_PH), ("radius", radius)):
            value.setflags(write=False)
            object.__setattr__(self, name, value)

    def chosen(self, index: NDArray[np.bool_]) -> Self:
        """A subset of the spheres, at least one, by a mask (h,)."""
        p_PH, radius = self.p_PH[index], self.radius[index]
        for value in (p_PH, radius):
            value.setflags(write=False)
        return copied(self, p_PH=p_PH, radius=radius)

    def placed(self, p_PH: FloatArray, sigma: float) -> Self:
        """The same spheres at other centres (h, 3), m, with another sigma of the surface, m.

        Raises:
            InvalidInputError: centres that are too far from the palm.
        """
        p_PH = points_near("p_PH", p_PH, self.p_PH.shape)
        p_PH.setflags(write=False)
        return copied(self, p_PH=p_PH, sigma=sigma)

    def __len__(self) -> int:
        return len(self.radius)

    def __repr__(self) -> str:
        radii = 1e3 * self.radius
        return (
            f"<HandGeometry: {len(self)} spheres, radii {radii.min():.1f} to {radii.max():.1f} mm, "
            f"sigma {1e3 * self.sigma:.3g} mm>"
        )
