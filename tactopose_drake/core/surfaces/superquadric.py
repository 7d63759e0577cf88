"""A superquadric fingertip: from ellipsoid to rounded box, rounded cylinder or lens.

Source: [B81] A. H. Barr, Superquadrics and angle-preserving transformations, 1981.
"""

import dataclasses
import math

import numpy as np

from tactopose_drake.core.surfaces import surface_kernels
from tactopose_drake.core.surfaces.surface import Surface, random_directions, three_lengths
from tactopose_drake.core.validation import FloatArray, positive_numbers


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Superquadric(Surface):
    """A convex superellipsoid about F's origin: (|x/a|^(2/e2) + |y/b|^(2/e2))^(e2/e1) + |z/c|^(2/e1) = 1.

    Exponents (1, 1) are the ellipsoid; smaller ones make it boxier (e1 along z, e2 around it), larger ones pinch it
    towards an octahedron, with creases on the planes of symmetry. All of it can be touched.

    Attributes:
        semi_axes: a, b, c along F's axes, m, > 0, up to 1.
        exponents: e1 and e2, without unit, each from 0.1 to 1.5.
        X_SF: pose of F in the sensor's frame, shape (3, 4), p in m; a RigidTransform or (4, 4) is taken too.

    Raises:
        InvalidInputError: semi-axes or exponents out of these ranges, or an X_SF that is not a pose.
    """

    semi_axes: tuple[float, float, float]
    exponents: tuple[float, float] = (1.0, 1.0)
    kind = surface_kernels.SMOOTH

    def _shape(self) -> tuple[float, ...]:
        axes = three_lengths("semi_axes", self.semi_axes)
        e1, e2 = positive_numbers("exponents", self.exponents, (2,), least=0.1, most=1.5).tolist()
        object.__setattr__(self, "semi_axes", axes)
        object.__setattr__(self, "exponents", (e1, e2))
        return *axes, e1, e2, -math.inf, math.inf, math.hypot(*axes)

    def _sample(self, generator: np.random.Generator, count: int) -> FloatArray:
        points: FloatArray = np.array(self.semi_axes) * random_directions(generator, count)
        for point in points:
            surface_kernels.project(self.kind, self.shape, point)
        return points
