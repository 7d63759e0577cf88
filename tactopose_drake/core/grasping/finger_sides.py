"""Whether the fingers of a grasp are beside each other, or in each other."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from tactopose_drake.core.grasping.finger_geometry import FingerGeometry
from tactopose_drake.core.validation import FloatArray

_SLIM = 1.2  # half width of a slim finger about its joints, in radii of its fingertip

_SMALL = 0.001  # radius of spheres that stand for mere corners, m


def half_width(geometry: FingerGeometry) -> float:
    """How far a finger's last two links and its tip reach from the line through its joints, m."""
    chain = geometry.chain
    middle = 0.5 * (chain.lower + chain.upper)[None]
    last = geometry.body >= len(chain.bodies) - 2
    reach = _distance_to_polyline(geometry.spheres(middle)[0, last], geometry.axis(middle)[0]) + geometry.radius[last]
    return float(reach.max(initial=geometry.tip_radius))


def sides(geometry: FingerGeometry, q: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Spheres that stand for a finger's last two links and tip: centres in P (B, s, 3) and radii (s,), m.

    Of a slim finger they are as wide as the finger, about its joints; of another, those that fill it.
    """
    width = half_width(geometry)
    if width <= _SLIM * geometry.tip_radius:
        axis = geometry.axis(q)
        return axis, np.full(axis.shape[1], width)
    last = (geometry.body >= len(geometry.chain.bodies) - 2) & (geometry.radius > _SMALL)
    centres = np.concatenate([geometry.spheres(q)[:, last], geometry.tip(q)[:, None]], axis=1)
    return centres, np.append(geometry.radius[last], geometry.tip_radius)


def are_apart(a: tuple[FloatArray, FloatArray], b: tuple[FloatArray, FloatArray], least: float) -> NDArray[np.bool_]:
    """Which postures of two fingers leave so much between their spheres, m: (len(a), len(b)) of `sides` of each."""
    (p_a, r_a), (p_b, r_b) = a, b
    reach = r_a[:, None] + r_b
    apart = np.empty((len(p_a), len(p_b)), dtype=np.bool_)
    for i, centres in enumerate(p_a):
        gap = cdist(centres, p_b.reshape(-1, 3)).reshape(len(r_a), len(p_b), len(r_b)) - reach[:, None]
        apart[i] = gap.min(axis=(0, 2)) > least
    return apart


def _distance_to_polyline(points: FloatArray, corners: FloatArray) -> FloatArray:
    """Distances of points (n, 3) to the segments between corners (c, 3), shape (n,), m."""
    start, along = corners[:-1], np.diff(corners, axis=0)
    length = np.maximum(np.sum(along**2, axis=1), 1e-12)
    share = np.clip(np.einsum("nci,ci->nc", points[:, None] - start, along) / length, 0.0, 1.0)
    nearest = start + share[..., None] * along
    distance: FloatArray = np.linalg.norm(points[:, None] - nearest, axis=2).min(axis=1, initial=np.inf)
    return distance
