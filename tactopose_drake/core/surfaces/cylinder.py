"""A cylindrical fingertip."""

import dataclasses
import math

import numpy as np

from tactopose_drake.core.surfaces import surface_kernels
from tactopose_drake.core.surfaces.surface import Surface, one_length
from tactopose_drake.core.validation import FloatArray


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Cylinder(Surface):
    """The side of a cylinder about F's z axis, centred on F's origin.

    Its side can be touched, -length/2 <= z <= length/2; its flat ends are not part of the surface. S(p) is that of the
    infinite cylinder.

    Attributes:
        radius: m, > 0, up to 1.
        length: m, > 0, up to 1.
        X_SF: pose of F in the sensor's frame, shape (3, 4), p in m; a RigidTransform or (4, 4) is taken too.

    Raises:
        InvalidInputError: a radius or length that is not positive, or an X_SF that is not a pose.
    """

    radius: float
    length: float
    kind = surface_kernels.ROD

    def _shape(self) -> tuple[float, ...]:
        r, half = one_length("radius", self.radius), 0.5 * one_length("length", self.length)
        return r, -math.inf, math.inf, 0.0, 0.0, -half, half, math.hypot(r, half)

    def _sample(self, generator: np.random.Generator, count: int) -> FloatArray:
        angle = generator.uniform(-math.pi, math.pi, count)
        z = generator.uniform(-0.5, 0.5, count) * self.length
        return np.stack([self.radius * np.cos(angle), self.radius * np.sin(angle), z], axis=1)
