"""Look-ups in a distance grid, compiled: the distance and the normal at a point in O, and their derivatives.

A look-up is one gather of eight nodes of four float32 each (signed distance, normal), in four runs of 32 bytes.
"""

from typing import NamedTuple

import numpy as np

from tactopose_drake.core.compilation import inlined, part
from tactopose_drake.core.kernel_types import Floats1, OutFloats1, OutFloats2, Singles4

# Where interpolated normals nearly cancel (the middle of a thin wall) their direction is meaningless: this bounds it.
SOFT_LENGTH = 0.05

COARSENESS = 4
"""The distances at every fourth node along each axis form a grid of their own."""

_U4 = np.uintp(4)


class Grid(NamedTuple):
    """A distance grid, as kernels read it.

    Attributes:
        values: signed distance, m, and normal at the nodes, shape (nx, ny, nz, 4), read-only.
        origin: the first node in O, shape (3,), m, read-only.
        inverse_spacing: one over the distance between nodes, 1/m.
    """

    values: Singles4
    origin: Floats1
    inverse_spacing: float


@inlined
def cell(q, origin, inverse_spacing, limit):
    """The node below q along one axis, the fraction beyond it, and how far outside of the grid q is, in cells."""
    u = (q - origin) * inverse_spacing
    outside = 0.0
    if not u >= 0.0:  # True for NaN too, which must not become an index.
        outside = u
        u = 0.0
    elif u > limit:
        outside = u - limit
        u = limit
    i = int(u)
    if i > limit - 1:
        i = int(limit) - 1
    return i, u - i, outside


@part
def look_up(grid: Grid, x: float, y: float, z: float, out: OutFloats1) -> None:
    """Trilinear distance and normal at a point, out[0:4]; outside the grid, the distance to the grid is added."""
    values, origin, inverse_spacing = grid.values, grid.origin, grid.inverse_spacing
    i, fx, ox = cell(x, origin[0], inverse_spacing, values.shape[0] - 1.0)
    j, fy, oy = cell(y, origin[1], inverse_spacing, values.shape[1] - 1.0)
    k, fz, oz = cell(z, origin[2], inverse_spacing, values.shape[2] - 1.0)
    a00, a01 = (1.0 - fx) * (1.0 - fy), (1.0 - fx) * fy
    a10, a11 = fx * (1.0 - fy), fx * fy
    for c in range(4):
        low = (
            a00 * values[i, j, k, c]
            + a01 * values[i, j + 1, k, c]
            + a10 * values[i + 1, j, k, c]
            + a11 * values[i + 1, j + 1, k, c]
        )
        high = (
            a00 * values[i, j, k + 1, c]
            + a01 * values[i, j + 1, k + 1, c]
            + a10 * values[i + 1, j, k + 1, c]
            + a11 * values[i + 1, j + 1, k + 1, c]
        )
        out[c] = low + fz * (high - low)
    if ox != 0.0 or oy != 0.0 or oz != 0.0:
        out[0] += np.sqrt(ox * ox + oy * oy + oz * oz) / inverse_spacing


@part
def look_up_with_derivative(grid: Grid, x: float, y: float, z: float, out: OutFloats1, slope: OutFloats2) -> None:
    """As `look_up`, with slope[c, a] = d out[c] / d axis a, exact for the interpolant; slope is (4, 3)."""
    values, origin, inverse_spacing = grid.values, grid.origin, grid.inverse_spacing
    i, fx, ox = cell(x, origin[0], inverse_spacing, values.shape[0] - 1.0)
    j, fy, oy = cell(y, origin[1], inverse_spacing, values.shape[1] - 1.0)
    k, fz, oz = cell(z, origin[2], inverse_spacing, values.shape[2] - 1.0)
    for c in range(4):
        v000, v001 = np.float64(values[i, j, k, c]), np.float64(values[i, j, k + 1, c])
        v010, v011 = np.float64(values[i, j + 1, k, c]), np.float64(values[i, j + 1, k + 1, c])
        v100, v101 = np.float64(values[i + 1, j, k, c]), np.float64(values[i + 1, j, k + 1, c])
        v110, v111 = np.float64(values[i + 1, j + 1, k, c]), np.float64(values[i + 1, j + 1, k + 1, c])
        v00, v01 = v000 + fz * (v001 - v000), v010 + fz * (v011 - v010)
        v10, v11 = v100 + fz * (v101 - v100), v110 + fz * (v111 - v110)
        v0, v1 = v00 + fy * (v01 - v00), v10 + fy * (v11 - v10)
        out[c] = v0 + fx * (v1 - v0)
        slope[c, 0] = (v1 - v0) * inverse_spacing if ox == 0.0 else 0.0
        slope[c, 1] = ((1.0 - fx) * (v01 - v00) + fx * (v11 - v10)) * inverse_spacing if oy == 0.0 else 0.0
        dz0 = (1.0 - fy) * (v001 - v000) + fy * (v011 - v010)
        dz1 = (1.0 - fy) * (v101 - v100) + fy * (v111 - v110)
        slope[c, 2] = ((1.0 - fx) * dz0 + fx * dz1) * inverse_spacing if oz == 0.0 else 0.0
    if ox != 0.0 or oy != 0.0 or oz != 0.0:
        way = np.sqrt(ox * ox + oy * oy + oz * oz)
        out[0] += way / inverse_spacing
        slope[0, 0] += ox / way
        slope[0, 1] += oy / way
        slope[0, 2] += oz / way


@inlined
def interpolate(flat, at, sx, sy, fx, fy, fz):
    """One channel of the flattened grid in the cell whose first node is at `at`, and its derivatives per cell.

    sx and sy are the strides to the next node along x and y; along z it is 4.
    """
    v000, v001, v010, v011 = flat[at], flat[at + _U4], flat[at + sy], flat[at + sy + _U4]
    at += sx
    v100, v101, v110, v111 = flat[at], flat[at + _U4], flat[at + sy], flat[at + sy + _U4]
    z00, z01, z10, z11 = v001 - v000, v011 - v010, v101 - v100, v111 - v110
    v00, v01, v10, v11 = v000 + fz * z00, v010 + fz * z01, v100 + fz * z10, v110 + fz * z11
    y0, y1 = v01 - v00, v11 - v10
    v0, v1 = v00 + fy * y0, v10 + fy * y1
    z0, z1 = z00 + fy * (z01 - z00), z10 + fy * (z11 - z10)
    return v0 + fx * (v1 - v0), v1 - v0, y0 + fx * (y1 - y0), z0 + fx * (z1 - z0)
