"""The forward model of a touch: surfaces, points on them, and the wrenches that touches there exert."""

import dataclasses
from typing import Any

import numpy as np
from hypothesis import strategies as st

from tactopose_drake.core import poses
from tactopose_drake.core.sensing.soft_layer import SoftLayer
from tactopose_drake.core.surfaces import Capsule, Cylinder, Ellipsoid, Sphere, Superquadric, Surface
from tactopose_drake.core.validation import FloatArray

SURFACES: dict[str, Surface] = {
    "sphere": Sphere(radius=0.009),
    "ellipsoid": Ellipsoid(semi_axes=(0.009, 0.008, 0.012)),
    "cylinder": Cylinder(radius=0.009, length=0.02),
    "capsule": Capsule(radius=0.009, length=0.014),
    "capsule with two ends": Capsule(radius=0.009, length=0.014, two_ended=True),
    "hemisphere": Capsule(radius=0.009, length=0.0),
    "superquadric": Superquadric(semi_axes=(0.009, 0.008, 0.012), exponents=(0.7, 0.5)),
    "boxy superquadric": Superquadric(semi_axes=(0.009, 0.009, 0.009), exponents=(0.2, 0.3)),
    "pinched superquadric": Superquadric(semi_axes=(0.009, 0.008, 0.012), exponents=(1.5, 1.4)),
}
ROUND_SURFACES = [name for name in SURFACES if "superquadric" not in name]

seeds = st.integers(0, 2**32 - 1)


def placed(surface: Surface, generator: np.random.Generator) -> Any:
    """The surface in a random place."""
    p_SF = generator.uniform(-0.02, 0.02, (1, 3))
    return dataclasses.replace(surface, X_SF=poses.make_poses(poses.random_rotations(generator, 1), p_SF)[0])


@dataclasses.dataclass(frozen=True)
class Touches:
    """Contacts on one surface, in S, shapes (count, 3), and their wrenches, shape (count, 6)."""

    p_SC: FloatArray
    n_S: FloatArray
    f_S: FloatArray
    torque: FloatArray
    F_S: FloatArray


def touch(
    surface: Surface,
    generator: np.random.Generator,
    count: int,
    *,
    force: float | None = None,
    friction: float = 0.8,
    patch_radius: float = 0.003,
    layer: SoftLayer | None = None,
) -> Touches:
    """Random touches: anywhere, forces anywhere in the friction cone, local torques up to friction's on the patch."""
    q_S = surface.sample(generator, count)
    n_S = surface.normal(q_S)
    tangent = np.cross(n_S, generator.normal(size=(count, 3)))
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    angle = np.arctan(friction * np.sqrt(generator.random((count, 1))))
    size = generator.uniform(1.0, 10.0, (count, 1)) if force is None else force
    f_S = size * (np.sin(angle) * tangent - np.cos(angle) * n_S)
    normal_force = -np.sum(f_S * n_S, axis=1, keepdims=True)
    torque = generator.uniform(-1.0, 1.0, (count, 1)) * friction * normal_force * patch_radius * n_S
    p_SC = q_S if layer is None else q_S - normal_force / layer.stiffness * n_S
    return Touches(p_SC, n_S, f_S, torque, np.hstack([np.cross(p_SC, f_S) + torque, f_S]))
