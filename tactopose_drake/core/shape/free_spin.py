"""One representative of all the poses that an object's symmetries make of one."""

from collections.abc import Sequence

import numpy as np

from tactopose_drake.core.poses import compose, exp_so3, make_poses, skew
from tactopose_drake.core.shape.symmetry import RotationalSymmetry
from tactopose_drake.core.validation import FloatArray


def turn_toward(
    X_PO: FloatArray, X_reference: FloatArray, symmetries: Sequence[RotationalSymmetry], rounds: int = 6
) -> FloatArray:
    """The poses (B, 3, 4), turned about the continuous axes until their rotations are nearest to the reference's.

    The object does not change by the turns. Of a turn exp(t a) the trace of R_reference^T R exp(t a) is a constant plus
    a cosine and a sine of t, whose largest value is where the rotation is nearest.

    Args:
        X_PO: poses, shape (B, 3, 4).
        X_reference: shape (3, 4).
        symmetries: the object's.
        rounds: in which a sphere's three axes are turned, each of which brings the pose nearer; one axis needs but one.
    """
    axes = [symmetry for symmetry in symmetries if symmetry.is_continuous]
    for symmetry in axes * (rounds if len(axes) > 1 else 1):
        M = X_reference[:, :3].T @ X_PO[:, :, :3]
        a = symmetry.axis
        cosine = np.trace(M, axis1=1, axis2=2) - np.einsum("i,bij,j->b", a, M, a)
        sine = np.einsum("bij,ji->b", M, skew(a))
        R = exp_so3(np.arctan2(sine, cosine)[:, None] * a)
        X_PO = compose(X_PO, make_poses(R, symmetry.point - R @ symmetry.point))
    return X_PO


def turn_alike(X_PO: FloatArray, X_reference: FloatArray, symmetries: Sequence[RotationalSymmetry]) -> FloatArray:
    """The poses (B, 3, 4), turned so that those which differ by turns about a continuous axis become about the same.

    Where the axis is upside down against the reference's, all turns about it are equally far from the reference, and
    the nearest one is arbitrary. Such poses are turned toward the reference upside down instead.

    Args:
        X_PO: poses, shape (B, 3, 4).
        X_reference: shape (3, 4).
        symmetries: the object's.
    """
    turned = turn_toward(X_PO, X_reference, symmetries)
    axes = [symmetry.axis for symmetry in symmetries if symmetry.is_continuous]
    if len(axes) != 1:
        return turned
    opposite = np.flatnonzero(X_PO[:, :, :3] @ axes[0] @ (X_reference[:, :3] @ axes[0]) < 0.0)
    across = np.linalg.svd(axes[0][None])[2][1]
    upside_down = make_poses(X_reference[:, :3] @ exp_so3(np.pi * across), X_reference[:, 3])
    turned[opposite] = turn_toward(X_PO[opposite], upside_down, symmetries)
    return turned


def nearest_images(
    X_PO: FloatArray, X_reference: FloatArray, turns: FloatArray, symmetries: Sequence[RotationalSymmetry]
) -> FloatArray:
    """Of the poses that look as X_PO (B, 3, 4) do, those whose rotations are nearest to the reference's.

    Args:
        X_PO: poses, shape (B, 3, 4).
        X_reference: shape (3, 4).
        turns: the object's symmetries as poses X_OO', the identity first, shape (g, 3, 4); some of each continuous one.
        symmetries: the same by their axes; the turns about the continuous ones are made exact.
    """
    if len(turns) > 1:
        wanted = (X_reference[:, :3] @ np.swapaxes(turns[:, :, :3], 1, 2)).reshape(-1, 9)
        best = np.argmax(X_PO[:, :, :3].reshape(-1, 9) @ wanted.T, axis=1)
        X_PO = compose(X_PO, turns[best])
    return turn_toward(X_PO, X_reference, symmetries)


def continuous_turns(symmetries: Sequence[RotationalSymmetry], X_PO: FloatArray) -> FloatArray:
    """Increments (w, v) of a pose (3, 4) by unit turns about the continuous axes, shape (n, 6), rad and m."""
    axes = [symmetry for symmetry in symmetries if symmetry.is_continuous]
    rows = np.empty((len(axes), 6))
    for row, each in zip(rows, axes, strict=True):
        row[:3], row[3:] = each.axis, X_PO[:, :3] @ each.moment
    return rows
