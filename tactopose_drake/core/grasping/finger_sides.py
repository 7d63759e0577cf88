"""Tests whether the fingers of a grasp collide with each other."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from tactopose_drake.core.grasping.finger_geometry import FingerGeometry
from tactopose_drake.core.shape.sphere_packing import Spheres
from tactopose_drake.core.validation import FloatArray

_SLIM = 1.2  # largest half width of a slim finger about its joints, in radii of its fingertip

_SMALL = 0.001  # radius up to which spheres only mark corners, m
_PLACES = 3  # number of spheres along a fingertip's straight part


@dataclass(frozen=True, eq=False)
class FingerShape:
    """A finger in B postures, as spheres.

    Attributes:
        sides: its last two links and its tip.
        whole: all its links and its tip; for a slim finger the same as `sides`, which are what collides.
    """

    sides: Spheres
    whole: Spheres

    @classmethod
    def of(cls, geometry: FingerGeometry, q: FloatArray) -> Self:
        """A finger at positions q (B, m), rad or m."""
        near = sides(geometry, q)
        return cls(near, near if _is_slim(geometry) else _filling(geometry, q, geometry.body >= 0))

    @classmethod
    def of_axis(cls, geometry: FingerGeometry, q: FloatArray, width: float) -> Self:
        """A slim finger with a given half width about its joints, m."""
        axis = geometry.axis(q)
        near = axis, np.full(axis.shape[1], width)
        return cls(near, near)

    def apart(self, other: Self, least: float) -> NDArray[np.bool_]:
        """Which pairs of postures leave `least`, m, between the sides of each finger and the other, (B, B of other)."""
        free = are_apart(self.sides, other.whole, least)
        if self.whole is not self.sides or other.whole is not other.sides:
            free &= are_apart(self.whole, other.sides, least)
        return free


def half_width(geometry: FingerGeometry) -> float:
    """Largest distance of a finger's last two links and tip from the line through its joints, m."""
    chain, last = geometry.chain, geometry.on_last_links
    middle = 0.5 * (chain.lower + chain.upper)[None]
    reach = _distance_to_polyline(geometry.spheres(middle)[0, last], geometry.axis(middle)[0]) + geometry.radius[last]
    return float(reach.max(initial=geometry.tip_radius))


def sides(geometry: FingerGeometry, q: FloatArray) -> Spheres:
    """Spheres that represent a finger's last two links and tip: centres in P (B, s, 3) and radii (s,), m.

    For a slim finger they lie on its joints and are as wide as the finger; for any other, they are those that fill it.
    """
    if _is_slim(geometry):
        axis = geometry.axis(q)
        return axis, np.full(axis.shape[1], half_width(geometry))
    return _filling(geometry, q, geometry.on_last_links)


def _is_slim(geometry: FingerGeometry) -> bool:
    return half_width(geometry) <= _SLIM * geometry.tip_radius


def _filling(geometry: FingerGeometry, q: FloatArray, some: NDArray[np.bool_]) -> Spheres:
    """Some (s,) of the spheres that fill a finger's links, without mere corners, and its tip."""
    chosen = some & (geometry.radius > _SMALL)
    tip = np.concatenate([geometry.along_straight_part(_PLACES), geometry.p_ST[None]])
    centres = np.concatenate([geometry.spheres(q)[:, chosen], geometry.fixed_points(q, tip)], axis=1)
    return centres, np.append(geometry.radius[chosen], np.full(len(tip), geometry.tip_radius))


def are_apart(a: Spheres, b: Spheres, least: float) -> NDArray[np.bool_]:
    """Which pairs of postures keep a gap of at least `least`, m, between these spheres, shape (B of a, B of b)."""
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
