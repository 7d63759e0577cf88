"""Point-pair features of an object's surface, to find the pairs of surface points that two contacts can lie on.

Two oriented points have four features that are invariant under rigid motions [D10]: their distance, the angle of each
normal to the line between them, and the angle between the normals. All pairs of about a thousand surface samples are
sorted into bins of these features; a query reads the bins around the features of two contacts.

Source: [D10] B. Drost, M. Ulrich, N. Navab, S. Ilic, Model globally, match locally, CVPR 2010.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.shape.pair_feature_kernels import ANGLE_BINS, BYTE, DISTANCE_SHIFT, fill_feature, sort_pairs
from tactopose_drake.core.shape.surface_samples import SurfaceSamples
from tactopose_drake.core.validation import FloatArray

_DISTANCE_BINS = 256 >> DISTANCE_SHIFT
TABLE_SIZE = _DISTANCE_BINS * ANGLE_BINS**3 + 1
"""Number of bins, plus one for the end of the last."""


@dataclass(frozen=True, eq=False)
class PairFeatures:
    """Pairs of surface samples, sorted by their features.

    A feature is four bytes: the distance in units of `length` / 255, the angles in units of pi / 255.

    Attributes:
        points: samples in O, shape (n, 3), m.
        normals: their outward unit normals, shape (n, 3).
        spacing: the distance between neighbouring samples, m.
        length: the largest distance between two samples, m.
        features: shape (pairs, 4): distance, angle of the first normal and of the second one to the line from the first
            point to the second, angle between the normals.
        pairs: indices of the two samples, shape (pairs, 2).
        first: number of pairs in the bins before each, shape (bins + 1,).
    """

    points: FloatArray
    normals: FloatArray
    spacing: float
    length: float
    features: NDArray[np.uint8]
    pairs: NDArray[np.int16]
    first: NDArray[np.int32]

    @property
    def unit(self) -> FloatArray:
        """The quantisation step of each of a feature's bytes, m and rad, shape (4,)."""
        return np.array([self.length, np.pi, np.pi, np.pi]) / BYTE


def build_pair_features(
    samples: SurfaceSamples, area: float, symmetry_poses: FloatArray, max_points: int = 1000
) -> PairFeatures:
    """Computes the features of all pairs of samples.

    Args:
        samples: points spread evenly over the surface.
        area: of the surface, m^2.
        symmetry_poses: poses X_OO' (g, 3, 4) that leave the object unchanged: of pairs that are equivalent under them
            only one is kept.
        max_points: most samples that are used: memory and time are quadratic in it.
    """
    some = samples.thinned(min(max_points, len(samples)))
    points, normals = some.points, some.normals
    firsts = fundamental_points(points, symmetry_poses)
    length = _largest_distance(points)
    count = len(firsts) * (len(points) - 1)
    features, pairs = np.empty((count, 4), dtype=np.uint8), np.empty((count, 2), dtype=np.int16)
    first = np.zeros(TABLE_SIZE, dtype=np.int32)
    sort_pairs(points, normals, firsts, length, features, pairs, first)
    for array in (points, normals, features, pairs, first):
        array.setflags(write=False)
    return PairFeatures(points, normals, math.sqrt(area / len(points)), length, features, pairs, first)


def fundamental_points(points: FloatArray, symmetry_poses: FloatArray) -> NDArray[np.intp]:
    """Indices of one of each set of points (n, 3) that are equivalent under the symmetries (g, 3, 4)."""
    corner = points.max(axis=0) + np.array([0.1, 0.23, 0.37]) * np.ptp(points, axis=0)
    images = points @ np.swapaxes(symmetry_poses[:, :, :3], 1, 2) + symmetry_poses[:, None, :, 3]  # (g, n, 3)
    distance = np.linalg.norm(images - corner, axis=-1)
    return np.flatnonzero(distance[0] <= distance.min(axis=0) + 1e-9)


def pair_feature(p_a: FloatArray, n_a: FloatArray, p_b: FloatArray, n_b: FloatArray) -> FloatArray:
    """Distance (m) and angles (rad) of two distinct oriented points, shape (4,)."""
    feature = np.empty(4)
    fill_feature(p_a, n_a, p_b, n_b, feature)
    return feature


def _largest_distance(points: FloatArray) -> float:
    square = np.sum(points**2, axis=1)
    return math.sqrt(float(np.max(square[:, None] + square - 2.0 * points @ points.T)))
