"""Batched interpolation in a distance grid, compiled."""

import numpy as np

from tactopose_drake.core.compilation import kernel
from tactopose_drake.core.kernel_types import Floats1, Floats2, OutFloats2, Singles4


@kernel
def interpolate(
    values: Singles4, origin: Floats1, upper: Floats1, spacing: float, points: Floats2, fields: OutFloats2
) -> None:
    """Trilinear interpolation of a grid's first channels at points (n, 3), into fields (n, channels).

    For a point outside the grid, its distance from the grid is added to the first channel, the distance.

    Args:
        values: at the nodes, shape (nx, ny, nz, 4).
        origin: the first node, shape (3,), m.
        upper: the last node, shape (3,), m.
        spacing: between nodes, m.
        points: shape (n, 3), m.
        fields: output, with as many channels as it has columns.
    """
    i, t = np.empty(3, dtype=np.int64), np.empty(3)
    for n in range(points.shape[0]):
        outside = 0.0
        for axis in range(3):
            inside = min(max(points[n, axis], origin[axis]), upper[axis])
            u = (inside - origin[axis]) / spacing
            i[axis] = min(int(u), values.shape[axis] - 2) if u > 0.0 else 0  # NaN must not become an index
            t[axis] = u - i[axis]
            outside += (points[n, axis] - inside) ** 2
        for c in range(fields.shape[1]):
            fields[n, c] = 0.0
        for a in range(2):
            x = t[0] if a == 1 else 1.0 - t[0]
            for b in range(2):
                xy = x * (t[1] if b == 1 else 1.0 - t[1])
                for k in range(2):
                    weight = xy * (t[2] if k == 1 else 1.0 - t[2])
                    for c in range(fields.shape[1]):
                        fields[n, c] += weight * values[i[0] + a, i[1] + b, i[2] + k, c]
        fields[n, 0] += np.sqrt(outside)
