"""Features of pairs of surface samples: their computation, sorting into bins, and look-up, compiled."""

import numpy as np

from tactopose_drake.core.compilation import inlined, kernel, part
from tactopose_drake.core.kernel_types import (
    Floats1,
    Floats2,
    Ints1,
    Longs1,
    OutFloats1,
    OutInts1,
    OutShorts2,
    OutUnsignedBytes2,
    UnsignedBytes2,
)

BYTE = 255.0  # the largest value of a byte
# The layout of the table: 32 bins of distances and 16 of each angle. Constant, so that the compiler knows the shifts of
# the innermost loop.
DISTANCE_SHIFT = 3
_ANGLE_SHIFT = 4
ANGLE_BINS = 256 >> _ANGLE_SHIFT


@kernel
def fill_feature(p: Floats1, n: Floats1, q: Floats1, m: Floats1, out: OutFloats1) -> None:
    """The compiled `pair_feature` of points p and q with normals n and m, written to out (4,)."""
    x, y, z = q[0] - p[0], q[1] - p[1], q[2] - p[2]
    d = np.sqrt(x * x + y * y + z * z)
    out[0] = d
    along = (n[0] * x + n[1] * y + n[2] * z) / d
    out[1] = np.arccos(min(1.0, max(-1.0, along)))
    along = (m[0] * x + m[1] * y + m[2] * z) / d
    out[2] = np.arccos(min(1.0, max(-1.0, along)))
    out[3] = np.arccos(min(1.0, max(-1.0, n[0] * m[0] + n[1] * m[1] + n[2] * m[2])))


@inlined
def _bin(d, a, b, c):
    bins = ((d >> DISTANCE_SHIFT) * ANGLE_BINS + (a >> _ANGLE_SHIFT)) * ANGLE_BINS + (b >> _ANGLE_SHIFT)
    return bins * ANGLE_BINS + (c >> _ANGLE_SHIFT)


@kernel
def sort_pairs(
    points: Floats2,
    normals: Floats2,
    firsts: Longs1,
    length: float,
    features: OutUnsignedBytes2,
    pairs: OutShorts2,
    first: OutInts1,
) -> None:
    """Counting sort of all pairs (firsts, points) by bin; `first` is zero on entry."""
    n = points.shape[0]
    feature = np.empty(4)
    unsorted = np.empty((firsts.shape[0] * (n - 1), 4), dtype=np.uint8)
    row = 0
    for i in firsts:
        for j in range(n):
            if i == j:
                continue
            fill_feature(points[i], normals[i], points[j], normals[j], feature)
            unsorted[row, 0] = int(feature[0] * (BYTE / length) + 0.5)
            for a in range(1, 4):
                unsorted[row, a] = int(feature[a] * (BYTE / np.pi) + 0.5)
            u = unsorted[row]
            first[_bin(np.int64(u[0]), np.int64(u[1]), np.int64(u[2]), np.int64(u[3])) + 1] += 1
            row += 1
    for b in range(1, first.shape[0]):
        first[b] += first[b - 1]
    place = np.empty(first.shape[0] - 1, dtype=np.int32)
    for b in range(place.shape[0]):
        place[b] = first[b]
    row = 0
    for i in firsts:
        for j in range(n):
            if i == j:
                continue
            u = unsorted[row]
            b = _bin(np.int64(u[0]), np.int64(u[1]), np.int64(u[2]), np.int64(u[3]))
            k = place[b]
            place[b] += 1
            for c in range(4):
                features[k, c] = u[c]
            pairs[k, 0], pairs[k, 1] = i, j
            row += 1


@part
def find_matches(
    features: UnsignedBytes2, first: Ints1, feature: Floats1, weight: Floats1, reach: float, step: int, found: OutInts1
) -> int:
    """Finds the pairs whose features differ from a measured one by at most `reach` standard deviations.

    Args:
        features: of `PairFeatures`.
        first: of `PairFeatures`.
        feature: the measured feature, in units of bytes, shape (4,).
        weight: its inverse standard deviations, in the same units, shape (4,); zero for components not measured.
        reach: bound on the root of the sum of the four squared whitened differences.
        step: only pairs whose index is a multiple of this are tested.
        found: output, the matching indices in ascending order, as many as fit, shape (n,).

    Returns:
        The number of matches.
    """
    count, square = 0, reach * reach
    begin, end = _bins(feature[0], weight[0], reach, DISTANCE_SHIFT)
    for d in range(begin, end):
        left_d = max(0.0, square - _least_square(d, feature[0], weight[0], DISTANCE_SHIFT))
        begin_a, end_a = _bins(feature[1], weight[1], np.sqrt(left_d), _ANGLE_SHIFT)
        for a in range(begin_a, end_a):
            left_a = max(0.0, left_d - _least_square(a, feature[1], weight[1], _ANGLE_SHIFT))
            begin_b, end_b = _bins(feature[2], weight[2], np.sqrt(left_a), _ANGLE_SHIFT)
            for b in range(begin_b, end_b):
                left_b = max(0.0, left_a - _least_square(b, feature[2], weight[2], _ANGLE_SHIFT))
                begin_c, end_c = _bins(feature[3], weight[3], np.sqrt(left_b), _ANGLE_SHIFT)
                row = ((d * ANGLE_BINS + a) * ANGLE_BINS + b) * ANGLE_BINS
                # Bins that differ in the last angle alone are contiguous.
                for k in range(-(-first[row + begin_c] // step) * step, first[row + end_c], step):
                    at, total = np.uintp(k), 0.0
                    for c in range(4):
                        difference = (features[at, c] - feature[c]) * weight[c]
                        total += difference * difference
                    # Branch-free: a pair that does not match is overwritten by the next one.
                    if count < found.shape[0]:
                        found[count] = k
                    count += 1 if total <= square else 0
    return count


@inlined
def _bins(value, weight, reach, shift):
    """The range of bins within reach of a feature's component: the first, and the one after the last."""
    way = 256.0 if weight * 256.0 <= reach else reach / weight
    begin = int(max(0.0, min(BYTE, np.floor(value - way)))) >> shift
    return begin, (int(max(0.0, min(BYTE, np.ceil(value + way)))) >> shift) + 1


@inlined
def _least_square(b, value, weight, shift):
    """The least squared whitened difference between a feature's component and the values in a bin."""
    low = float(b << shift)
    return (max(0.0, low - value, value - (low + ((1 << shift) - 1))) * weight) ** 2
