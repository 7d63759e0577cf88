"""Errors of poses of symmetric objects, relative to the nearest symmetry image of the truth."""

import numpy as np
from numpy.typing import NDArray

import tactopose_drake as tp
from tactopose_drake.core.poses import compose, exp_so3, increments_between, make_poses, right_jacobian
from tactopose_drake.core.posterior import determined_part
from tactopose_drake.core.shape import turn_toward

Array = NDArray[np.float64]


def nearest_increments(model: tp.ObjectModel, X_PO: Array, information: Array, X_true: Array) -> Array:
    """Increments (n, 6) from a pose (3, 4) to the nearest symmetry images, by its information, of poses (n, 3, 4)."""
    images = compose(X_true[:, None], model.symmetry_poses[None])
    images = turn_toward(images.reshape(-1, 3, 4), X_PO, model.symmetries)
    for symmetry in [symmetry for symmetry in model.symmetries if symmetry.is_continuous] * 4:
        # A Gauss-Newton step in the angle about the axis of symmetry.
        u = increments_between(X_PO, images)
        shift = -images[:, :, :3] @ np.cross(symmetry.axis, symmetry.point)
        spin = np.linalg.solve(right_jacobian(u[:, :3]), np.broadcast_to(symmetry.axis, shift.shape)[..., None])
        turn = np.concatenate([spin[..., 0], shift], axis=1)
        slope, bend = np.einsum("bi,ij,bj->b", turn, information, u), np.einsum("bi,ij,bj->b", turn, information, turn)
        R = exp_so3(-(slope / bend)[:, None] * symmetry.axis)
        images = compose(images, make_poses(R, symmetry.point - R @ symmetry.point))
    u = increments_between(X_PO, images).reshape(len(X_true), -1, 6)
    least = np.einsum("bsi,ij,bsj->bs", u, information, u).argmin(axis=1)
    nearest: Array = u[np.arange(len(X_true)), least]
    return nearest


def least_error(model: tp.ObjectModel, X_PO: Array, X_true: Array, free: Array | None = None) -> Array:
    """Increment from a pose to the symmetry image of the true one whose surface is nearest, shape (6,), rad and m.

    Args:
        model: the object.
        X_PO: the pose, shape (3, 4).
        X_true: the true pose, shape (3, 4).
        free: directions (f, 6) along which errors are ignored.
    """
    metric = np.diag(np.repeat([(model.size / 2) ** 2, 1.0], 3))
    u: Array = nearest_increments(model, X_PO, metric, X_true[None])[0]
    return u if free is None or not len(free) else determined_part(u, free, model.size)
