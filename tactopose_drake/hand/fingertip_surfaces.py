"""The shape and the skin of a fingertip in a hand's YAML file."""

import dataclasses

from pydrake.common.schema import Transform

from tactopose_drake.core.sensing.soft_layer import SoftLayer
from tactopose_drake.core.surfaces import Capsule, Ellipsoid, Sphere, Superquadric, Surface
from tactopose_drake.core.validation import finite_array, told_of
from tactopose_drake.resources import fixed_pose
from tactopose_drake.resources.drake_values import WithDrakeValues


@dataclasses.dataclass(kw_only=True, slots=True, eq=False)
class SphereSurface(WithDrakeValues):
    """A spherical fingertip, `!SphereSurface` in YAML."""

    radius: float = 0.009  # m
    X_SF: Transform = dataclasses.field(default_factory=Transform)  # its centre's frame in the sensor's frame

    def make(self) -> Surface:
        """The surface that the contact solver takes."""
        return Sphere(self.radius, X_SF=fixed_pose("SphereSurface.X_SF", self.X_SF))


@dataclasses.dataclass(kw_only=True, slots=True, eq=False)
class EllipsoidSurface(WithDrakeValues):
    """An ellipsoidal fingertip, `!EllipsoidSurface` in YAML."""

    semi_axes: list[float] = dataclasses.field(default_factory=lambda: [0.009, 0.009, 0.009])  # m
    X_SF: Transform = dataclasses.field(default_factory=Transform)  # its centre's frame in the sensor's frame

    def make(self) -> Surface:
        """The surface that the contact solver takes."""
        a, b, c = finite_array("EllipsoidSurface.semi_axes", self.semi_axes, (3,)).tolist()
        return Ellipsoid((a, b, c), X_SF=fixed_pose("EllipsoidSurface.X_SF", self.X_SF))


@dataclasses.dataclass(kw_only=True, slots=True, eq=False)
class CapsuleSurface(WithDrakeValues):
    """A hemisphere on a cylinder along z of F, `!CapsuleSurface` in YAML; F's origin is the cylinder's middle."""

    radius: float = 0.009  # m
    length: float = 0.014  # of the cylindrical part, m
    X_SF: Transform = dataclasses.field(default_factory=Transform)  # in the sensor's frame

    def make(self) -> Surface:
        """The surface that the contact solver takes."""
        return Capsule(self.radius, self.length, X_SF=fixed_pose("CapsuleSurface.X_SF", self.X_SF))


@dataclasses.dataclass(kw_only=True, slots=True, eq=False)
class SuperquadricSurface(WithDrakeValues):
    """A rounded box, cylinder or anything between them and an ellipsoid, `!SuperquadricSurface` in YAML."""

    semi_axes: list[float] = dataclasses.field(default_factory=lambda: [0.009, 0.009, 0.009])  # m
    # e1 along z and e2 around it, each from 0.1 (boxy) over 1 (ellipsoid) to 1.5.
    exponents: list[float] = dataclasses.field(default_factory=lambda: [1.0, 1.0])
    X_SF: Transform = dataclasses.field(default_factory=Transform)  # its centre's frame in the sensor's frame

    def make(self) -> Surface:
        """The surface that the contact solver takes."""
        a, b, c = finite_array("SuperquadricSurface.semi_axes", self.semi_axes, (3,)).tolist()
        e1, e2 = finite_array("SuperquadricSurface.exponents", self.exponents, (2,)).tolist()
        return Superquadric((a, b, c), (e1, e2), X_SF=fixed_pose("SuperquadricSurface.X_SF", self.X_SF))


@dataclasses.dataclass(kw_only=True, slots=True)
class SkinLayer:
    """A soft skin; its indentation at a contact is the normal force divided by the stiffness."""

    thickness: float = 0.002  # m
    stiffness: float = 10000.0  # N/m: the slope of force over depth, measured by pressing the fingertip on a flat plate

    def make(self, name: str, surface: Surface) -> SoftLayer:
        """The layer that the contact solver takes.

        Raises:
            InvalidInputError: if a number is out of its range, or the skin is too thick for the fingertip; the message
                begins with `name`.
        """
        with told_of(f"{name}."):
            layer = SoftLayer(thickness=self.thickness, stiffness=self.stiffness)
            layer.check_fits(surface.half_width)
        return layer
