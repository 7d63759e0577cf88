"""A spherical fingertip."""

import dataclasses
import math

import numpy as np

from tactopose_drake.core.surfaces import surface_kernels
from tactopose_drake.core.surfaces.surface import Surface, one_length, random_directions
from tactopose_drake.core.validation import FloatArray


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Sphere(Surface):
    """A sphere about F's origin. All of it can be touched.

    Attributes:
        radius: m, > 0, up to 1.
        X_SF: pose of F in the sensor's frame, shape (3, 4), p in m; a RigidTransform or (4, 4) is taken too.

    Raises:
        InvalidInputError: a radius that is not positive, or an X_SF that is not a pose.
    """

    radius: float
    kind = surface_kernels.SMOOTH

    def _shape(self) -> tuple[float, ...]:
        r = one_length("radius", self.radius)
        return r, r, r, 1.0, 1.0, -math.inf, math.inf, r

    def _sample(self, generator: np.random.Generator, count: int) -> FloatArray:
        return self.radius * random_directions(generator, count)
