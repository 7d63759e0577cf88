"""An ellipsoidal fingertip."""

import dataclasses
import math

import numpy as np

from tactopose_drake.core.surfaces import surface_kernels
from tactopose_drake.core.surfaces.surface import Surface, random_directions, three_lengths
from tactopose_drake.core.validation import FloatArray


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Ellipsoid(Surface):
    """An ellipsoid about F's origin: (x/a)^2 + (y/b)^2 + (z/c)^2 = 1. All of it can be touched.

    Attributes:
        semi_axes: a, b, c along F's axes, m, > 0, up to 1.
        X_SF: pose of F in the sensor's frame, shape (3, 4), p in m; a RigidTransform or (4, 4) is taken too.

    Raises:
        InvalidInputError: semi-axes that are not three positive numbers, or an X_SF that is not a pose.
    """

    semi_axes: tuple[float, float, float]
    kind = surface_kernels.SMOOTH

    def _shape(self) -> tuple[float, ...]:
        axes = three_lengths("semi_axes", self.semi_axes)
        object.__setattr__(self, "semi_axes", axes)
        return *axes, 1.0, 1.0, -math.inf, math.inf, max(axes)

    def _sample(self, generator: np.random.Generator, count: int) -> FloatArray:
        return np.array(self.semi_axes) * random_directions(generator, count)
