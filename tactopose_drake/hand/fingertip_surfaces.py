"""The shapes of fingertips, as a hand's YAML has them."""

import dataclasses

from pydrake.common.schema import Transform

from tactopose_drake.core.surfaces import Capsule, Ellipsoid, Sphere, Surface
from tactopose_drake.core.validation import finite_array
from tactopose_drake.resources import fixed_pose


@dataclasses.dataclass(kw_only=True, slots=True)
class SphereSurface:
    """A spherical fingertip, `!SphereSurface` in YAML."""

    radius: float = 0.009  # m
    X_SF: Transform = dataclasses.field(default_factory=Transform)  # its centre's frame in the sensor's frame

    def make(self) -> Surface:
        """The surface that the contact solver takes."""
        return Sphere(self.radius, X_SF=fixed_pose("SphereSurface.X_SF", self.X_SF))


@dataclasses.dataclass(kw_only=True, slots=True)
class EllipsoidSurface:
    """An ellipsoidal fingertip, `!EllipsoidSurface` in YAML."""

    semi_axes: list[float] = dataclasses.field(default_factory=lambda: [0.009, 0.009, 0.009])  # m
    X_SF: Transform = dataclasses.field(default_factory=Transform)  # its centre's frame in the sensor's frame

    def make(self) -> Surface:
        """The surface that the contact solver takes."""
        a, b, c = finite_array("EllipsoidSurface.semi_axes", self.semi_axes, (3,)).tolist()
        return Ellipsoid((a, b, c), X_SF=fixed_pose("EllipsoidSurface.X_SF", self.X_SF))


@dataclasses.dataclass(kw_only=True, slots=True)
class CapsuleSurface:
    """A hemisphere on a cylinder along z of F, `!CapsuleSurface` in YAML; F's origin is the cylinder's middle."""

    radius: float = 0.009  # m
    length: float = 0.014  # of the cylindrical part, m
    X_SF: Transform = dataclasses.field(default_factory=Transform)  # in the sensor's frame

    def make(self) -> Surface:
        """The surface that the contact solver takes."""
        return Capsule(self.radius, self.length, X_SF=fixed_pose("CapsuleSurface.X_SF", self.X_SF))
