"""Poses in which an object may be held in a hand."""

import math

import numpy as np

from tactopose_drake.core import poses
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.shape.signed_distance import PlacedGrid
from tactopose_drake.core.shape.sphere_packing import Spheres
from tactopose_drake.core.validation import FloatArray

_STEPS, _BEYOND = 6, 0.0005  # most steps by which an object is shifted off, and the margin of each, m


def sample_held_pose(
    model: ObjectModel,
    grip: tuple[FloatArray, FloatArray],
    up_P: FloatArray,
    tilt_deg: float,
    generator: np.random.Generator,
) -> FloatArray:
    """A random pose X_PO (3, 4): upright within the tilt, any spin, a point of the object's axis in the grip region.

    Args:
        model: the object.
        grip: lower and upper corner of the grip region, shape (3,), m, in P.
        up_P: direction from which the object's z axis is tilted, shape (3,).
        tilt_deg: largest tilt, deg.
        generator: source of the choice.
    """
    up = up_P / np.linalg.norm(up_P)
    side, other = poses.axes_across(up)
    spin, lean = generator.uniform(-math.pi, math.pi, 2)
    tilt = math.radians(generator.uniform(0.0, tilt_deg))
    R_tilt = poses.exp_so3(tilt * (math.cos(lean) * side + math.sin(lean) * other))
    R_PO = R_tilt @ np.column_stack([side, other, up]) @ poses.exp_so3(np.array([0.0, 0.0, spin]))
    low, high = model.vertices[:, 2].min(), model.vertices[:, 2].max()
    # The fingers stand side by side over about twice this length.
    margin = min(0.035, 0.5 * (high - low))
    p_OG = np.array([*model.center_of_mass[:2], generator.uniform(low + margin, high - margin)])
    p_PG = generator.uniform(*grip)
    return poses.make_poses(R_PO, p_PG - R_PO @ p_OG)


def shifted_off(model: ObjectModel, X_PO: FloatArray, spheres: Spheres, clearance: float) -> FloatArray:
    """Shifts the pose (3, 4) in a few steps until the object keeps off spheres, if that is possible.

    Each step moves the object off the sphere that is deepest in it.

    Args:
        model: the object.
        X_PO: its pose, shape (3, 4).
        spheres: centres in P (n, 3) and radii (n,), m.
        clearance: m.
    """
    centres, radius = spheres
    for _ in range(_STEPS):
        distance, n_O = model.grid.distance_and_normal((centres - X_PO[:, 3]) @ X_PO[:, :3])
        deepest = int(np.argmin(distance - radius))
        lacking = clearance - (distance - radius)[deepest]
        if lacking <= 0.0:
            break
        X_PO = poses.make_poses(X_PO[:, :3], X_PO[:, 3] - (lacking + _BEYOND) * (X_PO[:, :3] @ n_O[deepest]))
    return X_PO


def least_distance(model: ObjectModel, X_PO: FloatArray, spheres: Spheres) -> float:
    """Least distance of the object at a pose (3, 4) from spheres, centres in P (n, 3) and radii (n,), m."""
    centres, radius = spheres
    return float((PlacedGrid(model.grid, X_PO).distance(centres) - radius).min())
