"""A fingertip of a cylinder with a hemispherical end: the common shape."""

import dataclasses
import math

import numpy as np

from tactopose_drake.core.surfaces import surface_kernels
from tactopose_drake.core.surfaces.surface import Surface, one_length, random_directions
from tactopose_drake.core.validation import FloatArray, flag


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Capsule(Surface):
    """A hemisphere on the +z end of a cylinder about F's z axis; on both ends if `two_ended`.

    F's origin is the middle of the cylindrical part, as in Drake's `Capsule`, so the hemisphere's centre is at
    z = +length/2. The side, -length/2 <= z <= length/2, and the hemisphere can be touched. The flat base of a capsule
    with one end is where the finger continues: it is not part of the surface, and S(p) is that of a cylinder that is
    infinite towards -z. A length of 0 leaves the hemisphere alone (a sphere if `two_ended`).

    Attributes:
        radius: m, > 0, up to 1.
        length: length of the cylindrical part, m, >= 0, up to 1.
        two_ended: whether a second hemisphere closes the -z end.
        X_SF: pose of F in the sensor's frame, shape (3, 4), p in m; a RigidTransform or (4, 4) is taken too.

    Raises:
        InvalidInputError: a radius that is not positive, a length below zero, or an X_SF that is not a pose.
    """

    radius: float
    length: float
    two_ended: bool = False
    kind = surface_kernels.ROD

    def _shape(self) -> tuple[float, ...]:
        two_ended = flag("two_ended", self.two_ended)
        r, half = one_length("radius", self.radius), 0.5 * one_length("length", self.length, allow_zero=True)
        lo, z_min = (-half, -math.inf) if two_ended else (-math.inf, -half)
        return r, lo, half, 0.0, 0.0, z_min, math.inf, r + half

    def _sample(self, generator: np.random.Generator, count: int) -> FloatArray:
        points = self.radius * random_directions(generator, count)
        if not self.two_ended:
            points[:, 2] = np.abs(points[:, 2])
        # A hemisphere has the area of a cylinder of length `radius`.
        ends = self.radius * (2.0 if self.two_ended else 1.0)
        on_side = generator.random(count) * (self.length + ends) < self.length
        angle = generator.uniform(-math.pi, math.pi, count)
        side = np.stack([self.radius * np.cos(angle), self.radius * np.sin(angle), np.zeros(count)], axis=1)
        side[:, 2] = generator.uniform(-0.5, 0.5, count) * self.length
        end = np.where(points[:, 2] < 0.0, -0.5, 0.5) * self.length
        points[:, 2] += end
        return np.where(on_side[:, None], side, points)
