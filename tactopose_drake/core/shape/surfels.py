"""The surface as many small discs, for the exact likelihood of a contact, edges and thin walls included.

A contact may lie anywhere on the surface with uniform density. The density of its measurement is then an integral over
the surface of a Gaussian of the point about the place, times one of the normal about the place's. The integral is a sum
over discs (surfels [P00]), each a Gaussian in its plane. On a flat surface it reduces to the exponential of the squared
distance and angle; at an edge, at a corner, and in a wall as thin as the noise it sums over all the faces that the
contact may belong to.

Source: [P00] H. Pfister, M. Zwicker, J. van Baar, M. Gross, Surfels: Surface Elements as Rendering Primitives, SIGGRAPH
2000.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.compilation import read_only
from tactopose_drake.core.shape.morton_order import morton_codes
from tactopose_drake.core.shape.surface_samples import points_along_surface
from tactopose_drake.core.shape.surfel_kernels import BLOCK, Discs
from tactopose_drake.core.validation import FloatArray

# Resolution of the discs, and which of them are evaluated: accuracy against time.
SPACING_SIGMAS = 1.3
"""Distance between neighbours, in a point's standard deviations."""
LEAST_SPACING = 0.0005
"""Least distance between neighbours, m, however accurate points are."""
_MAX_SURFELS = 250_000  # approximately: larger surfaces get larger discs
_POINTS_PER_DISC = 9  # of the surface, whose mean and variance define a disc
_LEAST_MEAN_NORMAL = 0.92  # least length of the mean of a disc's normals: they differ by some 20 degrees
_CELL_SPACINGS = 3.4  # width of a cell, in spacings, so that a contact's neighbourhood consists of few long runs
_REACH = 3.8  # standard deviations of a contact within which discs count
_AN_OCTAVE = 4  # number of spacings per factor of two
_BITS = 4  # of each coordinate within a cell in the Morton code that sorts its discs


@dataclass(frozen=True, eq=False)
class Surfels:
    """Discs, sorted into cubic cells; runs of non-empty cells along z have their discs in whole blocks.

    Attributes:
        blocks: of BLOCK neighbouring discs: centre in O, m; outward unit normal; area, m^2; variance of its points
            along each axis of its plane, m^2; variance of its normals about each, rad^2; shape (b, 9, BLOCK). Padding
            in the last block of a run has no area.
        balls: centre in O and radius of a bounding ball of each block, m, shape (b, 4).
        first: for each column, the number of places before each of its cells, and before the next column's discs,
            shape (nx * ny * (nz + 1),).
        origin: the first cell's lower corner, shape (3,), m.
        cell: a cell's width, m.
        shape: number of cells along x, y and z.
        spacing: approximate distance between neighbours, m.
    """

    blocks: NDArray[np.float32]
    balls: NDArray[np.float32]
    first: NDArray[np.int32]
    origin: FloatArray
    cell: float
    shape: tuple[int, int, int]
    spacing: float

    def kernel_view(self) -> Discs:
        """The discs in the form that kernels read."""
        blocks, balls, first, origin = map(read_only, (self.blocks, self.balls, self.first, self.origin))
        return Discs(blocks, balls, first, origin, 1.0 / self.cell, self.shape, self.spacing, _REACH)


def surfel_spacing(sigma: float, area: float) -> float:
    """The spacing, m, for points of standard deviation sigma, m, on a surface of this area, m^2; four per octave."""
    wanted = max(SPACING_SIGMAS * sigma, LEAST_SPACING, math.sqrt(area / _MAX_SURFELS))
    return 1e-3 * float(2.0 ** (math.ceil(_AN_OCTAVE * math.log2(1e3 * wanted) - 0.5) / _AN_OCTAVE))


def surfel_sigmas(least: float, largest: float) -> FloatArray:
    """Standard deviations of points, m, between the least and the largest, that cover all spacings."""
    least = max(least, LEAST_SPACING / SPACING_SIGMAS)
    steps = max(0, math.ceil(_AN_OCTAVE * math.log2(largest / least)))
    return np.asarray(least * 2.0 ** (np.arange(steps + 1) / _AN_OCTAVE))


def make_surfels(vertices: FloatArray, faces: NDArray[np.int32], area: float, spacing: float) -> Surfels:
    """Covers the mesh (v, 3), (f, 3) of this area, m^2, with discs about `spacing` apart, m, and closer on creases."""
    count = max(1, round(_POINTS_PER_DISC * area / spacing**2))
    points, normals, share = points_along_surface(vertices, faces, count)
    # A disc is made of the points of one voxel whose normals have the same dominant axis, which separates edges and
    # walls.
    part = np.abs(normals).argmax(axis=1)
    side = 2 * part + (np.take_along_axis(normals, part[:, None], axis=1)[:, 0] > 0.0)
    x, y, z = (((row - row.min()) / spacing).astype(np.int64) for row in points.T)
    _, disc = np.unique((x << 43) + (y << 23) + (z << 3) + side, return_inverse=True)
    size = np.bincount(disc)
    center, mean = (_averages(rows, disc, size) for rows in (points, normals))
    x, y, z = ((row - middle[disc]) ** 2 for row, middle in zip(points.T, center.T, strict=True))
    variance = 0.5 * _averages((x + y + z)[:, None], disc, size)[:, 0]
    length = np.linalg.norm(mean, axis=1)
    is_flat = length > _LEAST_MEAN_NORMAL
    rest = np.flatnonzero(~is_flat[disc])
    alone = np.tile([share, share / 12.0, 0.0], (len(rest), 1))
    discs = np.concatenate(
        [
            np.column_stack([center, mean / length[:, None], share * size, variance, 0.5 * (1.0 - length**2)])[is_flat],
            np.column_stack([points[rest], normals[rest], alone]),  # Where normals still differ, each point is a disc.
        ]
    )
    return _sorted(discs.astype(np.float32), _CELL_SPACINGS * spacing, spacing)


def _sorted(discs: NDArray[np.float32], cell: float, spacing: float) -> Surfels:
    """Sorts discs (n, 9) into cells of this width, and within each along a Morton curve."""
    origin = discs[:, :3].min(axis=0).astype(np.float64) - 1e-9
    place = (discs[:, :3] - origin) / cell
    index = place.astype(np.int64)
    nx, ny, nz = (int(n) for n in index.max(axis=0) + 1)
    # One number per column is left unused, so that columns are never contiguous.
    number = (index[:, 0] * ny + index[:, 1]) * (nz + 1) + index[:, 2]
    parts = (2.0**_BITS * (place - index)).astype(np.int64)
    order = np.lexsort((morton_codes(parts, _BITS), number))
    discs, number = discs[order], number[order]
    # Each run of contiguous cells begins with a new block; copies of its last disc without area fill the last block.
    begins = np.flatnonzero(np.diff(number, prepend=-2) > 1)
    count = np.diff(begins, append=len(discs))
    whole = -(-count // BLOCK) * BLOCK
    at = np.arange(len(discs)) + np.repeat(np.cumsum(whole) - whole - begins, count)
    filled = np.repeat(discs[begins + count - 1], whole, axis=0)
    filled[:, 6] = 0.0
    filled[at] = discs
    blocks = np.ascontiguousarray(filled.reshape(-1, BLOCK, 9).swapaxes(1, 2))
    center = 0.5 * (blocks[:, :3].max(axis=2) + blocks[:, :3].min(axis=2))
    radius = np.sqrt(np.sum((blocks[:, :3] - center[:, :, None]) ** 2, axis=1).max(axis=1))
    balls = np.column_stack([center, radius])
    first = np.append(at, len(filled))[np.searchsorted(number, np.arange(nx * ny * (nz + 1)))].astype(np.int32)
    for array in (blocks, balls, first, origin):
        array.setflags(write=False)
    return Surfels(blocks, balls, first, origin, cell, (nx, ny, nz), spacing)


def _averages(rows: FloatArray, group: NDArray[np.intp], size: NDArray[np.intp]) -> FloatArray:
    """Means of rows (n, d) over their groups, shape (groups, d)."""
    return np.stack([np.bincount(group, column) / size for column in rows.T], axis=1)
