"""Point-pair features of an object's surface: which two surface points can two contacts lie on?

Two oriented points have four numbers that no motion changes [D10]: their distance, the angle of each normal to the line
between them, and the angle between the normals. Every pair of about a thousand surface samples is sorted into bins of
the four; a query reads the bins around the numbers of two contacts.

Source: [D10] B. Drost, M. Ulrich, N. Navab, S. Ilic, Model globally, match locally, CVPR 2010.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tactopose_drake.core.shape.surface_samples import SurfaceSamples
from tactopose_drake.core.validation import FloatArray

MAX_POINTS = 1000
"""Of the object's surface samples so many are paired."""

_BYTE = 255.0
_DISTANCE_SHIFT = 3  # 32 bins
_ANGLE_SHIFT = 4  # 16 bins
_DISTANCE_BINS = 256 >> _DISTANCE_SHIFT
_ANGLE_BINS = 256 >> _ANGLE_SHIFT


@dataclass(frozen=True, eq=False)
class PairFeatures:
    """Pairs of surface samples, sorted by their features.

    A feature is four bytes: the distance in 255ths of `length`, the angles in 255ths of a half turn.

    Attributes:
        points: samples in O, shape (n, 3), m.
        normals: their outward unit normals, shape (n, 3).
        spacing: the distance between neighbouring samples, m.
        length: the largest distance between two samples, m.
        features: shape (pairs, 4): distance, angle of the first normal and of the second one to the line from the first
            point to the second, angle between the normals.
        pairs: indices of the two samples, shape (pairs, 2).
        first: the number of pairs in the bins before each, shape (bins + 1,).
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
        """One step of each of a feature's bytes, m and rad, shape (4,)."""
        return np.array([self.length, np.pi, np.pi, np.pi]) / _BYTE


def build_pair_features(
    samples: SurfaceSamples, area: float, symmetry_poses: FloatArray, max_points: int = MAX_POINTS
) -> PairFeatures:
    """Pairs the samples with each other.

    Args:
        samples: points spread evenly over the surface.
        area: of the surface, m^2.
        symmetry_poses: poses X_OO' (g, 3, 4) that leave the object as it is: of the pairs that they turn into each
            other only one is kept.
        max_points: how many of the samples are taken, at most.
    """
    chosen = np.linspace(0, len(samples), min(max_points, len(samples)), endpoint=False).astype(np.intp)
    points, normals = np.ascontiguousarray(samples.points[chosen]), np.ascontiguousarray(samples.normals[chosen])
    firsts = fundamental_points(points, symmetry_poses)
    length = _largest_distance(points)
    count = len(firsts) * (len(points) - 1)
    features, pairs = np.empty((count, 4), dtype=np.uint8), np.empty((count, 2), dtype=np.int16)
    first = np.zeros(_DISTANCE_BINS * _ANGLE_BINS**3 + 1, dtype=np.int32)
    _sort_pairs(points, normals, firsts, length, features, pairs, first)
    for array in (points, normals, features, pairs, first):
        array.setflags(write=False)
    return PairFeatures(points, normals, math.sqrt(area / len(points)), length, features, pairs, first)


def fundamental_points(points: FloatArray, symmetry_poses: FloatArray) -> NDArray[np.intp]:
    """Indices of the points (n, 3) that no symmetry (g, 3, 4) takes nearer to a certain corner of the object."""
    corner = points.max(axis=0) + np.array([0.1, 0.23, 0.37]) * np.ptp(points, axis=0)
    images = points @ np.swapaxes(symmetry_poses[:, :, :3], 1, 2) + symmetry_poses[:, None, :, 3]  # (g, n, 3)
    distance = np.linalg.norm(images - corner, axis=-1)
    return np.flatnonzero(distance[0] <= distance.min(axis=0) + 1e-9)


def pair_feature(p_a: FloatArray, n_a: FloatArray, p_b: FloatArray, n_b: FloatArray) -> FloatArray:
    """Distance (m) and angles (rad) of two oriented points, shape (4,), the points apart from each other."""
    feature = np.empty(4)
    fill_feature(p_a, n_a, p_b, n_b, feature)
    return feature


def _largest_distance(points: FloatArray) -> float:
    square = np.sum(points**2, axis=1)
    return math.sqrt(float(np.max(square[:, None] + square - 2.0 * points @ points.T)))


@njit(cache=True)
def fill_feature(p, n, q, m, out):  # type: ignore[no-untyped-def]
    """The compiled `pair_feature` of points p and q with normals n and m, into out (4,)."""
    x, y, z = q[0] - p[0], q[1] - p[1], q[2] - p[2]
    d = np.sqrt(x * x + y * y + z * z)
    out[0] = d
    along = (n[0] * x + n[1] * y + n[2] * z) / d
    out[1] = np.arccos(min(1.0, max(-1.0, along)))
    along = (m[0] * x + m[1] * y + m[2] * z) / d
    out[2] = np.arccos(min(1.0, max(-1.0, along)))
    out[3] = np.arccos(min(1.0, max(-1.0, n[0] * m[0] + n[1] * m[1] + n[2] * m[2])))


@njit(cache=True, inline="always")
def _bin(d, a, b, c):  # type: ignore[no-untyped-def]
    bins = ((d >> _DISTANCE_SHIFT) * _ANGLE_BINS + (a >> _ANGLE_SHIFT)) * _ANGLE_BINS + (b >> _ANGLE_SHIFT)
    return bins * _ANGLE_BINS + (c >> _ANGLE_SHIFT)


@njit(cache=True)
def _sort_pairs(points, normals, firsts, length, features, pairs, first):  # type: ignore[no-untyped-def]
    """Counting sort of all pairs (firsts, points) by bin; first is zero on entry."""
    n = points.shape[0]
    feature = np.empty(4)
    unsorted = np.empty((firsts.shape[0] * (n - 1), 4), dtype=np.uint8)
    row = 0
    for i in firsts:
        for j in range(n):
            if i == j:
                continue
            fill_feature(points[i], normals[i], points[j], normals[j], feature)
            unsorted[row, 0] = int(feature[0] * (_BYTE / length) + 0.5)
            for a in range(1, 4):
                unsorted[row, a] = int(feature[a] * (_BYTE / np.pi) + 0.5)
            u = unsorted[row]
            first[_bin(np.int64(u[0]), np.int64(u[1]), np.int64(u[2]), np.int64(u[3])) + 1] += 1
            row += 1
    for b in range(1, first.shape[0]):
        first[b] += first[b - 1]
    place = first[:-1].copy()
    row = 0
    for i in firsts:
        for j in range(n):
            if i == j:
                continue
            u = unsorted[row]
            b = _bin(np.int64(u[0]), np.int64(u[1]), np.int64(u[2]), np.int64(u[3]))
            k = place[b]
            place[b] += 1
            features[k] = u
            pairs[k, 0], pairs[k, 1] = i, j
            row += 1


@njit(cache=True, nogil=True)
def find_matches(features, first, feature, weight, reach, step, found):  # type: ignore[no-untyped-def]
    """Finds the pairs whose features differ from a measured one by at most `reach` standard deviations.

    Args:
        features: of `PairFeatures`.
        first: the same.
        feature: what was measured, in units of bytes, shape (4,).
        weight: one over its standard deviations, in the same, shape (4,); zero where nothing was measured.
        reach: of the root of the sum of the four squared whitened differences.
        step: of the pairs only those are looked at whose number is a multiple of it.
        found: indices of the pairs, rising, are written here as far as there is room, shape (n,).

    Returns:
        Their number.
    """
    count, square = 0, reach * reach
    begin, end = _bins(feature[0], weight[0], reach, _DISTANCE_SHIFT)
    for d in range(begin, end):
        left_d = max(0.0, square - _least_square(d, feature[0], weight[0], _DISTANCE_SHIFT))
        begin_a, end_a = _bins(feature[1], weight[1], np.sqrt(left_d), _ANGLE_SHIFT)
        for a in range(begin_a, end_a):
            left_a = max(0.0, left_d - _least_square(a, feature[1], weight[1], _ANGLE_SHIFT))
            begin_b, end_b = _bins(feature[2], weight[2], np.sqrt(left_a), _ANGLE_SHIFT)
            for b in range(begin_b, end_b):
                left_b = max(0.0, left_a - _least_square(b, feature[2], weight[2], _ANGLE_SHIFT))
                begin_c, end_c = _bins(feature[3], weight[3], np.sqrt(left_b), _ANGLE_SHIFT)
                row = ((d * _ANGLE_BINS + a) * _ANGLE_BINS + b) * _ANGLE_BINS
                # Bins that differ in the last angle alone lie next to each other.
                for k in range(-(-first[row + begin_c] // step) * step, first[row + end_c], step):
                    at, total = np.uintp(k), 0.0
                    for c in range(4):
                        difference = (features[at, c] - feature[c]) * weight[c]
                        total += difference * difference
                    if total <= square:
                        if count < found.shape[0]:
                            found[count] = k
                        count += 1
    return count


@njit(cache=True, inline="always")
def _bins(value, weight, reach, shift):  # type: ignore[no-untyped-def]
    """The first bin within reach of a feature's number, and the one after the last; at least one."""
    way = 256.0 if weight * 256.0 <= reach else reach / weight
    begin = int(max(0.0, min(_BYTE, np.floor(value - way)))) >> shift
    return begin, (int(max(0.0, min(_BYTE, np.ceil(value + way)))) >> shift) + 1


@njit(cache=True, inline="always")
def _least_square(b, value, weight, shift):  # type: ignore[no-untyped-def]
    """The least squared whitened difference between a feature's number and those of a bin."""
    low = float(b << shift)
    return (max(0.0, low - value, value - (low + ((1 << shift) - 1))) * weight) ** 2
