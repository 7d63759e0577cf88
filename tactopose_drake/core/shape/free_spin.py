"""A unique representative among the poses that are equivalent under an object's symmetries."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.geometry_checks import pose_batch
from tactopose_drake.core.poses import make_poses
from tactopose_drake.core.shape import free_spin_kernels
from tactopose_drake.core.shape.symmetry import RotationalSymmetry
from tactopose_drake.core.validation import FloatArray, number_array

TURN_VOLUME = {0: 1.0, 1: 2.0 * np.pi, 3: 8.0 * np.pi**2}
"""Volume of the rotations about the continuous symmetry axes, by their number: none, one, or the three of a ball."""

# Rounds of coordinate descent over a sphere's three axes; one axis needs a single round.
_ROUNDS = 6


def turn_toward(X_PO: FloatArray, X_reference: FloatArray, symmetries: Sequence[RotationalSymmetry]) -> FloatArray:
    """Rotates poses (B, 3, 4) about the continuous axes until they are nearest to the reference's rotation.

    These rotations do not change the object.

    Args:
        X_PO: poses, shape (B, 3, 4).
        X_reference: shape (3, 4).
        symmetries: the object's.

    Raises:
        InvalidInputError: if poses are of another shape, or do not consist of numbers.
    """
    X_PO, X_reference = pose_batch(X_PO), number_array("X_reference", X_reference, (3, 4))
    return _turn(X_PO, X_reference[None], np.zeros(len(X_PO), dtype=np.int64), symmetries)


def turn_toward_nearest(
    X_PO: FloatArray, X_references: FloatArray, symmetries: Sequence[RotationalSymmetry], arm: float
) -> FloatArray:
    """Rotates poses (B, 3, 4) about the continuous axes until they are nearest to the nearest reference's rotation.

    Whatever the turns, which of the references (n, 3, 4) is nearest is judged by the place of the axis, and by its
    direction times the lever arm, m.
    """
    axes = [symmetry for symmetry in symmetries if symmetry.is_continuous]
    if not axes or not len(X_PO):
        return X_PO
    direction = axes[0].axis if len(axes) == 1 else np.zeros(3)  # The axes of a ball may point anywhere.
    placed, reference = (
        np.concatenate([X[:, :, :3] @ axes[0].point + X[:, :, 3], arm * (X[:, :, :3] @ direction)], axis=1)
        for X in (X_PO, X_references)
    )
    apart = np.square(reference).sum(axis=1) - 2.0 * placed @ reference.T  # less a part that is the same for all
    return _turn(X_PO, X_references, apart.argmin(axis=1), axes)


def turn_alike(
    X_PO: FloatArray, X_reference: FloatArray, symmetries: Sequence[RotationalSymmetry], symmetry_poses: FloatArray
) -> FloatArray:
    """Rotates poses (B, 3, 4) so that those that differ by a rotation about a continuous axis become about the same.

    If the axis points opposite to the reference's, all rotations about it are equally far from the reference, and the
    nearest one is arbitrary. Such poses are rotated toward the reference turned upside down instead: by one of the
    object's symmetries, if there is one, so that equivalent poses come together again.

    Args:
        X_PO: poses, shape (B, 3, 4).
        X_reference: shape (3, 4).
        symmetries: the object's.
        symmetry_poses: its finite symmetry group as poses X_OO', the identity first, shape (g, 3, 4).
    """
    continuous = [symmetry for symmetry in symmetries if symmetry.is_continuous]
    if len(continuous) != 1:
        return turn_toward(X_PO, X_reference, symmetries)
    axis = continuous[0].axis
    is_opposite = X_PO[:, :, :3] @ axis @ (X_reference[:, :3] @ axis) < 0.0
    turns = symmetry_poses[:, :, :3]
    flips = turns[turns @ axis @ axis < 0.0]
    half_turn = flips[0] if len(flips) else continuous[0].half_turn
    upside_down = make_poses(X_reference[:, :3] @ half_turn, X_reference[:, 3])
    return _turn(X_PO, np.stack([X_reference, upside_down]), is_opposite.astype(np.int64), symmetries)


def _turn(
    X_PO: FloatArray, references: FloatArray, choice: NDArray[np.int64], symmetries: Sequence[RotationalSymmetry]
) -> FloatArray:
    """Rotates poses (B, 3, 4) toward the rotations of the chosen (B,) ones of the references (n, 3, 4)."""
    axes = [symmetry for symmetry in symmetries if symmetry.is_continuous]
    if not axes:
        return X_PO
    axes, turned = axes * (_ROUNDS if len(axes) > 1 else 1), np.array(X_PO, order="C")
    lines = np.array([symmetry.axis for symmetry in axes]), np.array([symmetry.point for symmetry in axes])
    free_spin_kernels.turn_toward(np.ascontiguousarray(references), choice, *lines, turned)
    return turned


def nearest_images(
    X_PO: FloatArray, X_reference: FloatArray, turns: FloatArray, symmetries: Sequence[RotationalSymmetry]
) -> FloatArray:
    """Among the poses that look like X_PO (B, 3, 4), those whose rotations are nearest to the reference's.

    Args:
        X_PO: poses, shape (B, 3, 4).
        X_reference: shape (3, 4).
        turns: the object's symmetries as poses X_OO', the identity first, shape (g, 3, 4); sampled for continuous ones.
        symmetries: the same by their axes, by which rotations about continuous ones are made exact.

    Raises:
        InvalidInputError: if poses are of another shape, or do not consist of numbers.
    """
    X_PO, X_reference = pose_batch(X_PO), number_array("X_reference", X_reference, (3, 4))
    if len(turns) > 1:
        nearest = np.empty((len(X_PO), 3, 4))
        free_spin_kernels.take_nearest_image(X_reference, pose_batch(turns), X_PO, nearest)
        X_PO = nearest
    return turn_toward(X_PO, X_reference, symmetries)


def continuous_turns(symmetries: Sequence[RotationalSymmetry], X_PO: FloatArray) -> FloatArray:
    """Increments (w, v) of a pose (3, 4) per radian about each continuous axis, shape (n, 6), rad and m."""
    axes = [symmetry for symmetry in symmetries if symmetry.is_continuous]
    rows = np.empty((len(axes), 6))
    for row, each in zip(rows, axes, strict=True):
        row[:3], row[3:] = each.axis, X_PO[:, :3] @ each.moment
    return rows
