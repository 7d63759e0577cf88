"""Synthetic contacts on an object's surface, for tests, benchmarks, and studies without a simulator."""

import math

import numpy as np
from numpy.typing import ArrayLike

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.geometry_checks import pose_matrix
from tactopose_drake.core.poses import exp_so3
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import FloatArray, whole_number


def touch_surface(
    model: ObjectModel,
    X_PO: ArrayLike,
    count: int,
    generator: np.random.Generator,
    *,
    sigma_position: float = 0.0009,
    sigma_normal: float = math.radians(5.0),
    spread: bool = True,
) -> Contacts:
    """Contacts at random points of the surface, measured with noise.

    Args:
        model: the object.
        X_PO: its true pose, shape (3, 4); a `RigidTransform` or a 4x4 matrix will do.
        count: number of contacts, >= 1.
        generator: of the random numbers.
        sigma_position: standard deviation of each coordinate of a point, m; 0 for exact points (which claim 0.1 mm).
        sigma_normal: of a small rotation of a normal about each axis, rad; 0 for exact normals (which claim 0.5 deg).
        spread: each contact is the one of ten random points farthest from the earlier ones; otherwise uniform by area.

    Raises:
        InvalidInputError: if the pose is of another shape, or no rigid transform; if the count is not a whole
            number above 0.
    """
    X_PO, count = pose_matrix("X_PO", X_PO), whole_number("count", count, least=1)
    candidates = 10 if spread else 1
    p_OQ, n_O = random_surface_points(model, candidates * count, generator)
    chosen = [0]
    for i in range(1, count):
        batch = np.arange(candidates * i, candidates * (i + 1))
        gaps = np.linalg.norm(p_OQ[batch, None] - p_OQ[chosen], axis=-1).min(axis=1)
        chosen.append(int(batch[gaps.argmax()]))
    R_PO, p_PO = X_PO[:, :3], X_PO[:, 3]
    p_PC = p_OQ[chosen] @ R_PO.T + p_PO + generator.normal(size=(count, 3)) * sigma_position
    turn = exp_so3(generator.normal(size=(count, 3)) * sigma_normal)
    n_PC = (turn @ (n_O[chosen] @ R_PO.T)[..., None])[..., 0]
    return Contacts(
        p_PC,
        n_PC / np.linalg.norm(n_PC, axis=1, keepdims=True),
        sigma_position=sigma_position or 1e-4,
        sigma_normal=sigma_normal or math.radians(0.5),
    )


def random_surface_points(
    model: ObjectModel, count: int, generator: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Points (count, 3) uniform over the mesh's area, m, and their outward unit face normals (count, 3), in O."""
    a, b, c = np.swapaxes(model.vertices[model.faces], 0, 1)
    cross = np.cross(b - a, c - a)
    double_area = np.linalg.norm(cross, axis=1)
    face = generator.choice(len(a), size=count, p=double_area / double_area.sum())
    u, v = np.swapaxes(generator.random((count, 2)), 0, 1)[..., None]
    beyond = u + v > 1.0
    u, v = np.where(beyond, 1.0 - u, u), np.where(beyond, 1.0 - v, v)
    points: FloatArray = a[face] + u * (b[face] - a[face]) + v * (c[face] - a[face])
    return points, cross[face] / double_area[face, None]
