"""Histograms of pair features, and the density of contacts' features in them, compiled."""

import numpy as np

from tactopose_drake.core.compilation import kernel
from tactopose_drake.core.kernel_types import Floats2, Ints1, Longs1, OutFloats1, OutLongs1, UnsignedShorts1
from tactopose_drake.core.shape.pair_feature_kernels import fill_feature

# The layout of the histogram that objects share, also of counts stored on disk.
DISTANCE = 0.004  # A bin's width, m.
DISTANCE_BINS = 256  # The last one also holds all longer distances.
ANGLE = np.pi / 12.0  # A bin's width, rad.
ANGLE_BINS = 13  # The first and the last are centred on 0 and pi, so that right angles are not on a border.


@kernel
def count_features(points: Floats2, normals: Floats2, counts: OutLongs1) -> None:
    """Counts ordered pairs of samples, of points and normals (n, 3), by their features, into bins (rows) of counts."""
    feature = np.empty(4)
    for i in range(points.shape[0]):
        for j in range(points.shape[0]):
            if i == j:
                continue
            fill_feature(points[i], normals[i], points[j], normals[j], feature)
            row = min(int(feature[0] / DISTANCE), DISTANCE_BINS - 1)
            for a in range(1, 4):
                row = row * ANGLE_BINS + int(feature[a] / ANGLE + 0.5)
            counts[row] += 1


@kernel
def add_densities(
    first: Longs1, objects: Ints1, counts: UnsignedShorts1, low: Longs1, weights: Floats2, density: OutFloats1
) -> None:
    """Adds to each object's density (n,) the weighted counts in the bins about one pair of contacts.

    Args:
        first: index of each row's first entry, and the number of entries, shape (rows + 1,).
        objects: of each entry, shape (e,).
        counts: of each entry, shape (e,).
        low: the lowest bin of each of the four features, shape (4,).
        weights: of that bin and those after it, by feature, shape (4, m).
        density: added to.
    """
    most = weights.shape[1]
    for d in range(most):
        for a in range(most):
            for b in range(most):
                for c in range(most):
                    weight = weights[0, d] * weights[1, a] * weights[2, b] * weights[3, c]
                    if weight > 0.0:
                        row = (low[0] + d) * ANGLE_BINS + low[1] + a
                        row = (row * ANGLE_BINS + low[2] + b) * ANGLE_BINS + low[3] + c
                        for k in range(first[row], first[row + 1]):
                            density[objects[k]] += weight * counts[k]
