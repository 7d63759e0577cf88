"""The points of the surface in front of a tactile pad, and how well their covariance fits the felt one, compiled."""

from typing import NamedTuple

import numpy as np

from tactopose_drake.core.compilation import inlined, kernel
from tactopose_drake.core.kernel_types import Floats1, Floats2, Floats3, OutFloats1, OutFloats2
from tactopose_drake.core.kernels.pose_kernels import to_object
from tactopose_drake.core.shape.point_grid_kernels import Cloud, nearest_square, slot_of


class FeltPads(NamedTuple):
    """The pads that feel the object, read-only.

    Poses X_PB (k, 3, 4) of the sensing boxes in front of them, lower and upper corners in B (k, 3), and the patches'
    centroids in P (k, 3) and covariances (k, 3, 3).
    """

    X_PB: Floats3
    lower: Floats2
    upper: Floats2
    centroid: Floats2
    covariance: Floats3


class Box(NamedTuple):
    """Scratch: a box as `_place` expresses it in O."""

    R: OutFloats2
    p: OutFloats1
    c: OutFloats1
    low: OutFloats1
    high: OutFloats1


@inlined
def _place(X, pads, k, seen):
    """Expresses a box in O at the pose X: R = R_OB, p = p_OB, and the corners of its bounding box along O's axes.

    c is the patch's centroid in B.
    """
    X_PB, lower, upper, centroid = pads.X_PB[k], pads.lower[k], pads.upper[k], pads.centroid[k]
    R, p, c, low, high = seen
    for a in range(3):
        p[a] = 0.0
        for e in range(3):
            p[a] += X[e, a] * (X_PB[e, 3] - X[e, 3])
            R[a, e] = X[0, a] * X_PB[0, e] + X[1, a] * X_PB[1, e] + X[2, a] * X_PB[2, e]
    for a in range(3):
        middle, reach, c[a] = p[a], 0.0, 0.0
        for e in range(3):
            middle += R[a, e] * 0.5 * (lower[e] + upper[e])
            reach += abs(R[a, e]) * 0.5 * (upper[e] - lower[e])
            c[a] += X_PB[e, a] * (centroid[e] - X_PB[e, 3])
        low[a], high[a] = middle - reach, middle + reach


@inlined
def _overlap(low, high, origin, spacing, shape):
    """Whether the axis-aligned box from low to high meets the grid."""
    meet = True
    for a in range(3):
        meet = meet and high[a] >= origin[a] and low[a] <= origin[a] + shape[a] * spacing
    return meet


@kernel
def _gather(
    cloud: Cloud, box: Box, lower: Floats1, upper: Floats1, first: OutFloats1, second: OutFloats2
) -> tuple[int, float, float]:
    """Sums over the points in the box; returns their number, depth below z = 0, and least squared distance from c.

    first (3,) gets the sum of their offsets from c, second (3, 3) the lower triangle of the sum of outer products.
    """
    points, starts, seeds, origin, spacing = cloud
    R, p, c, low, high = box
    shape = seeds.shape
    count, depth, nearest = 0, 0.0, np.inf
    first[:] = 0.0
    second[:] = 0.0
    if not _overlap(low, high, origin, spacing, shape):
        return count, depth, nearest
    nx, ny, nz = shape
    inverse = 1.0 / spacing
    y_first, y_end = slot_of(low[1], origin[1], inverse, ny), slot_of(high[1], origin[1], inverse, ny) + 1
    z_first, z_end = slot_of(low[2], origin[2], inverse, nz), slot_of(high[2], origin[2], inverse, nz) + 1
    for i in range(slot_of(low[0], origin[0], inverse, nx), slot_of(high[0], origin[0], inverse, nx) + 1):
        for j in range(y_first, y_end):
            column = (i * ny + j) * nz
            for n in range(starts[column + z_first], starts[column + z_end]):
                dx, dy, dz = points[n, 0] - p[0], points[n, 1] - p[1], points[n, 2] - p[2]
                z = R[0, 2] * dx + R[1, 2] * dy + R[2, 2] * dz
                if z < lower[2] or z > upper[2]:
                    continue
                x = R[0, 0] * dx + R[1, 0] * dy + R[2, 0] * dz
                y = R[0, 1] * dx + R[1, 1] * dy + R[2, 1] * dz
                if x < lower[0] or x > upper[0] or y < lower[1] or y > upper[1]:
                    continue
                depth += max(0.0, -z)
                count += 1
                x, y, z = x - c[0], y - c[1], z - c[2]
                nearest = min(nearest, x * x + y * y + z * z)
                first[0] += x
                first[1] += y
                first[2] += z
                second[0, 0] += x * x
                second[1, 0] += y * x
                second[1, 1] += y * y
                second[2, 0] += z * x
                second[2, 1] += z * y
                second[2, 2] += z * z
    return count, depth, nearest


@kernel
def pad_costs(
    cloud: Cloud,
    pads: FeltPads,
    weights: Floats1,
    X_PO: Floats3,
    costs: OutFloats2,
) -> None:
    """Fills costs (B, k) with algorithm 5.2's cost of each pad at each pose, m.

    The nearest point is rarely searched for: it is within the gate if any point of the box is.
    """
    gate, h1, h2, h3 = weights
    box = Box(np.empty((3, 3)), np.empty(3), np.empty(3), np.empty(3), np.empty(3))
    first, second, q = np.empty(3), np.empty((3, 3)), np.empty(3)
    for b in range(X_PO.shape[0]):
        X = X_PO[b]
        for k in range(costs.shape[1]):
            _place(X, pads, k, box)
            count, depth, nearest = _gather(cloud, box, pads.lower[k], pads.upper[k], first, second)
            distance = 0.0
            if count <= 3 or nearest > gate * gate:
                to_object(X, pads.centroid[k], q)
                distance = np.sqrt(nearest_square(cloud, q[0], q[1], q[2]))
            matched = count > 3 and distance <= gate
            total, offset, square = h1 * distance, 0.0, 0.0
            for a in range(3):
                for e in range(a + 1):
                    difference = -pads.covariance[k, a, e]
                    if matched:
                        difference += (second[a, e] - first[a] * first[e] / count) / (count - 1)
                    square += difference * difference * (1.0 if a == e else 2.0)
                offset += first[a] * first[a]
            if matched:
                total = np.sqrt(offset) / count + h2 * depth
            if not np.isnan(pads.covariance[k, 0, 0]):
                total += h3 * np.sqrt(square)
            costs[b, k] = total
