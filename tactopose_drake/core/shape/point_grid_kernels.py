"""Nearest-neighbour queries in a grid of cells, compiled."""

from typing import NamedTuple

import numpy as np

from tactopose_drake.core.compilation import inlined, kernel, part
from tactopose_drake.core.kernel_types import Floats1, Floats2, Ints1, Ints3, OutFloats1


class Cloud(NamedTuple):
    """The fields of a `PointGrid`; read-only."""

    points: Floats2
    starts: Ints1
    seeds: Ints3
    origin: Floats1
    spacing: float


@inlined
def slot_of(x, origin, inverse_spacing, count):
    """Index of the cell that contains x along one axis, clamped to the grid."""
    return int(min(max((x - origin) * inverse_spacing, 0.0), count - 1.0))


@part
def nearest_square(cloud: Cloud, x: float, y: float, z: float) -> float:
    """The squared distance, m^2, from (x, y, z) to the nearest point.

    The nearest cell's seed gives an upper bound; the columns that intersect the ball of that radius are searched.
    """
    points, starts, seeds, origin, spacing = cloud
    nx, ny, nz = seeds.shape
    inverse = 1.0 / spacing
    seed = seeds[
        slot_of(x, origin[0], inverse, nx), slot_of(y, origin[1], inverse, ny), slot_of(z, origin[2], inverse, nz)
    ]
    best = (points[seed, 0] - x) ** 2 + (points[seed, 1] - y) ** 2 + (points[seed, 2] - z) ** 2
    reach = np.sqrt(best)
    for i in range(slot_of(x - reach, origin[0], inverse, nx), slot_of(x + reach, origin[0], inverse, nx) + 1):
        edge = origin[0] + i * spacing
        gap_x = max(edge - x, x - edge - spacing, 0.0)
        if gap_x * gap_x >= best:
            continue
        half = np.sqrt(best - gap_x * gap_x)
        for j in range(slot_of(y - half, origin[1], inverse, ny), slot_of(y + half, origin[1], inverse, ny) + 1):
            edge = origin[1] + j * spacing
            gap_y = max(edge - y, y - edge - spacing, 0.0)
            rest = best - gap_x * gap_x - gap_y * gap_y
            if rest <= 0.0:
                continue
            half = np.sqrt(rest)
            column = (i * ny + j) * nz
            first = starts[column + slot_of(z - half, origin[2], inverse, nz)]
            for n in range(first, starts[column + slot_of(z + half, origin[2], inverse, nz) + 1]):
                square = (points[n, 0] - x) ** 2 + (points[n, 1] - y) ** 2 + (points[n, 2] - z) ** 2
                best = min(best, square)
    return best


@kernel
def nearest_squares(cloud: Cloud, queries: Floats2, squares: OutFloats1) -> None:
    """`nearest_square` of each query (n, 3), into squares (n,)."""
    for n in range(queries.shape[0]):
        squares[n] = nearest_square(cloud, queries[n, 0], queries[n, 1], queries[n, 2])
