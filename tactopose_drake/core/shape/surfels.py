"""The surface as many small discs, which say how likely a measured contact is, edges and thin walls included.

A contact may lie anywhere on the surface, each place as likely as any other. The density of what is measured of it is
then an integral over the surface: of a normal density of the point about the place, times one of the normal about the
place's. The integral is a sum over discs (surfels [P00]), each a normal density in its plane. Where the surface is flat
it comes to the exponential of the squared distance and angle; at an edge, at a corner, and in a wall as thin as the
noise it is a sum over all the faces that the contact may belong to.

Source: [P00] H. Pfister, M. Zwicker, J. van Baar, M. Gross, Surfels: Surface Elements as Rendering Primitives, SIGGRAPH
2000.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tactopose_drake.core.shape.surface_samples import points_along_surface
from tactopose_drake.core.validation import FloatArray

MAX_SURFELS = 250_000
FINEST = 0.0005
"""Discs lie no closer than this, m."""

_SPACING_SHARE = 1.3
_POINTS_PER_DISC = 9
_FLAT = 0.92  # The mean of a disc's normals is at least so long: they differ by some 20 degrees.
_CELL_SHARE = 3.4  # A cell's width in the same: a contact's surroundings lie in few long runs.
_BLOCK = 16  # So many discs are reckoned at once.
_REACH = 3.8  # Discs count within so many standard deviations.
_MOST = 24.0  # No disc counts for less than the exponential of minus this.
_LEAST = 1e-9  # The density far from the surface, as a share of that on it.


@dataclass(frozen=True, eq=False)
class Surfels:
    """Discs, sorted into cubic cells.

    Attributes:
        discs: centre in O, m; outward unit normal; area, m^2; variance of its points along each axis of its plane, m^2;
            variance of its normals about each, rad^2; shape (9, n + _BLOCK), the last of which are none, of area 0.
        first: the number of discs in the cells before each, shape (cells + 1,); cells along z lie next to each other.
        origin: the first cell's lower corner, shape (3,), m.
        cell: a cell's width, m.
        shape: number of cells along x, y and z.
        spacing: about the distance between neighbours, m.
    """

    discs: NDArray[np.float32]
    first: NDArray[np.int32]
    origin: FloatArray
    cell: float
    shape: tuple[int, int, int]
    spacing: float


def surfel_spacing(sigma: float, area: float) -> float:
    """The spacing, m, that suits a point known to sigma, m, on a surface of this area, m^2: one of four an octave."""
    wanted = max(_SPACING_SHARE * sigma, FINEST, math.sqrt(area / MAX_SURFELS))
    return 1e-3 * float(2.0 ** (0.25 * math.ceil(4.0 * math.log2(1e3 * wanted) - 0.5)))


def make_surfels(vertices: FloatArray, faces: NDArray[np.int32], area: float, spacing: float) -> Surfels:
    """Covers the mesh (v, 3), (f, 3) of this area, m^2, with discs about `spacing` apart, m, and more along creases."""
    points, normals, share = points_along_surface(vertices, faces, max(1, round(_POINTS_PER_DISC * area / spacing**2)))
    # A disc is the points of one voxel whose normals have the same largest part, so that edges and walls come apart.
    part = np.abs(normals).argmax(axis=1)
    side = 2 * part + (np.take_along_axis(normals, part[:, None], axis=1)[:, 0] > 0.0)
    voxel = ((points - points.min(axis=0)) / spacing).astype(np.int64)
    _, disc = np.unique((voxel << [43, 23, 3]).sum(axis=1) + side, return_inverse=True)
    size = np.bincount(disc)
    center, mean = (_averages(rows, disc, size) for rows in (points, normals))
    variance = 0.5 * _averages(np.sum((points - center[disc]) ** 2, axis=1)[:, None], disc, size)[:, 0]
    length = np.linalg.norm(mean, axis=1)
    is_flat = length > _FLAT
    rest = ~is_flat[disc]
    discs = np.concatenate(
        [
            np.column_stack([center, mean / length[:, None], share * size, variance, 0.5 * (1.0 - length**2)])[is_flat],
            # Where they differ still, each point is a disc by itself.
            np.column_stack([points, normals, *np.broadcast_arrays(share, share / 12.0, 0.0, points[:, 0])[:3]])[rest],
        ]
    )
    cell = _CELL_SHARE * spacing
    origin = discs[:, :3].min(axis=0) - 1e-9
    index = ((discs[:, :3] - origin) / cell).astype(np.int64)
    nx, ny, nz = (int(n) for n in index.max(axis=0) + 1)
    key = (index[:, 0] * ny + index[:, 1]) * nz + index[:, 2]
    order = np.argsort(key, kind="stable")
    discs = np.concatenate([discs[order].T, np.zeros((9, _BLOCK))], axis=1).astype(np.float32)
    first = np.searchsorted(key[order], np.arange(nx * ny * nz + 1)).astype(np.int32)
    for array in (discs, first, origin):
        array.setflags(write=False)
    return Surfels(discs, first, origin, cell, (nx, ny, nz), spacing)


def _averages(rows: FloatArray, group: NDArray[np.intp], size: NDArray[np.intp]) -> FloatArray:
    """Means of rows (n, d) over their groups, shape (groups, d)."""
    return np.stack([np.bincount(group, column) / size for column in rows.T], axis=1)


def contact_densities(
    surfels: Surfels,
    p: FloatArray,
    n: FloatArray,
    sigma_position: FloatArray,
    weight_normal: FloatArray,
    X_PO: FloatArray,
    cost: FloatArray,
) -> None:
    """Writes the negative log densities of contacts (k, 3) at poses (B, 3, 4) into cost (B,).

    Each contact's density is divided by that on a flat surface with the right normal.

    Args:
        surfels: the surface.
        p: points in P, shape (k, 3), m.
        n: unit normals in P, shape (k, 3).
        sigma_position: of each coordinate of each point, shape (k,), m.
        weight_normal: one over sigma of each normal, shape (k,), 1/rad; zero where there is none.
        X_PO: poses, shape (B, 3, 4).
        cost: the result.
    """
    _densities(
        surfels.discs,
        surfels.first,
        surfels.origin,
        1.0 / surfels.cell,
        surfels.shape,
        p,
        n,
        sigma_position,
        weight_normal,
        surfels.spacing,
        X_PO,
        cost,
    )


@njit(cache=True, inline="always")
def _exp_minus(x):  # type: ignore[no-untyped-def]
    """exp(-x) of a float32, to a thousandth where 0 <= x < 8 and a quarter up to 24: the library's takes twice as long.

    The sixteenth power of a short series for exp(x / 16).
    """
    y, one = x * np.float32(1.0 / 16.0), np.float32(1.0)
    third = np.float32(1.0 / 6.0) + y * (np.float32(1.0 / 24.0) + y * np.float32(1.0 / 120.0))
    power = one + y * (one + y * (np.float32(0.5) + y * third))
    power = power * power
    power = power * power
    power = power * power
    power = power * power
    return one / power


@njit(cache=True, nogil=True, error_model="numpy")
def _densities(  # type: ignore[no-untyped-def]
    discs, first, origin, per_cell, shape, p, n, sigma, weight_n, spacing, X, cost
):
    """Each number of the discs is an array by itself, read by unsigned offsets, which need no check of their sign, and
    in whole blocks: what of a run's last block lies behind its end counts for nothing.
    """
    x_disc, y_disc, z_disc, x_normal, y_normal, z_normal = discs[0], discs[1], discs[2], discs[3], discs[4], discs[5]
    area, spread, roughness = discs[6], discs[7], discs[8]
    q, m, shares = np.empty(3), np.empty(3), np.empty(_BLOCK, dtype=np.float32)
    low, high = np.empty(3, dtype=np.int64), np.empty(3, dtype=np.int64)
    one, half = np.float32(1.0), np.float32(0.5)
    most = np.float32(_MOST)
    for b in range(X.shape[0]):
        total = 0.0
        for i in range(p.shape[0]):
            reach = _REACH * sigma[i] + 0.5 * spacing
            x, y, z = p[i, 0] - X[b, 0, 3], p[i, 1] - X[b, 1, 3], p[i, 2] - X[b, 2, 3]
            empty = False
            for a in range(3):
                q[a] = X[b, 0, a] * x + X[b, 1, a] * y + X[b, 2, a] * z
                m[a] = X[b, 0, a] * n[i, 0] + X[b, 1, a] * n[i, 1] + X[b, 2, a] * n[i, 2]
                low[a] = max(0, int(np.floor((q[a] - reach - origin[a]) * per_cell)))
                high[a] = min(shape[a] - 1, int(np.floor((q[a] + reach - origin[a]) * per_cell)))
                empty = empty or high[a] < low[a]
            for j in range(_BLOCK):
                shares[j] = 0.0
            if not empty:
                q0, q1, q2 = np.float32(q[0]), np.float32(q[1]), np.float32(q[2])
                m0, m1, m2 = np.float32(m[0]), np.float32(m[1]), np.float32(m[2])
                variance, per_across = np.float32(sigma[i] ** 2), np.float32(0.5 / sigma[i] ** 2)
                per_normal = np.float32(weight_n[i] ** 2)
                for a in range(low[0], high[0] + 1):
                    for c in range(low[1], high[1] + 1):
                        row = (a * shape[1] + c) * shape[2]
                        begin = np.uintp(first[row + low[2]])
                        count = np.uintp(first[row + high[2] + 1]) - begin
                        for block in range(np.uintp(0), count, np.uintp(_BLOCK)):
                            for j in range(np.uintp(_BLOCK)):
                                k = begin + block + np.uintp(j)
                                dx, dy, dz = q0 - x_disc[k], q1 - y_disc[k], q2 - z_disc[k]
                                d = dx * x_normal[k] + dy * y_normal[k] + dz * z_normal[k]
                                square = dx * dx + dy * dy + dz * dz - d * d
                                # One division for both factors.
                                wider, rougher = variance + spread[k], one + per_normal * roughness[k]
                                both = one / (wider * rougher)
                                exponent = per_across * d * d + half * rougher * both * square
                                # Half the squared difference of unit vectors is one minus their product.
                                turned = one - (m0 * x_normal[k] + m1 * y_normal[k] + m2 * z_normal[k])
                                exponent += per_normal * wider * both * turned
                                # Without a branch, which would part the block.
                                share = area[k] * both * _exp_minus(min(exponent, most))
                                shares[j] += share if block + np.uintp(j) < count else np.float32(0.0)
            density = np.float32(0.0)
            for j in range(_BLOCK):
                density += shares[j]
            total -= np.log(density / (2.0 * np.pi) + _LEAST)
        cost[b] = total
