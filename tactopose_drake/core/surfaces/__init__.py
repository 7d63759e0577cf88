"""Convex fingertip surfaces, S(p) = 0, with gradient and Hessian."""

from tactopose_drake.core.surfaces.capsule import Capsule
from tactopose_drake.core.surfaces.cylinder import Cylinder
from tactopose_drake.core.surfaces.ellipsoid import Ellipsoid
from tactopose_drake.core.surfaces.sphere import Sphere
from tactopose_drake.core.surfaces.superquadric import Superquadric
from tactopose_drake.core.surfaces.surface import Surface

__all__ = ["Capsule", "Cylinder", "Ellipsoid", "Sphere", "Superquadric", "Surface"]
