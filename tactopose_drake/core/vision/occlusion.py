"""The share of an object that the hand hides from a camera."""

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.validation import FloatArray


def hidden_share(p_CQ: FloatArray, n_CQ: FloatArray, p_CH: FloatArray, radius: FloatArray) -> float:
    """The share of the object's camera side that spheres hide.

    The camera side is the surface that faces the camera; self-occlusion is neglected.

    Args:
        p_CQ: points on the object's surface, spread evenly, in the camera's frame C, shape (n, 3), m.
        n_CQ: outward normals there, shape (n, 3).
        p_CH: centres of the spheres, shape (h, 3), m.
        radius: their radii, shape (h,), m.

    Returns:
        From 0 (all is visible) to 1; 0 if nothing faces the camera.
    """
    facing = np.einsum("ni,ni->n", p_CQ, n_CQ) < 0.0
    if not facing.any():
        return 0.0
    return float(np.mean(segments_hit_spheres(p_CQ[facing], p_CH, radius)))


def segments_hit_spheres(p_CQ: FloatArray, p_CH: FloatArray, radius: FloatArray) -> NDArray[np.bool_]:
    """Tests which segments from the origin of C to the points Q pass through a sphere.

    Args:
        p_CQ: end points, shape (n, 3), m.
        p_CH: centres, shape (h, 3), m.
        radius: radii, shape (h,), m.

    Returns:
        Shape (n,), bool.
    """
    length = np.linalg.norm(p_CQ, axis=1)
    direction = p_CQ / np.where(length > 0.0, length, 1.0)[:, None]
    along = np.clip(direction @ p_CH.T, 0.0, length[:, None])  # position of the segment's point nearest to the centre
    squared = np.sum(p_CH**2, axis=1) - 2.0 * along * (direction @ p_CH.T) + along**2
    hit: NDArray[np.bool_] = np.any(squared < radius**2, axis=1)
    return hit
