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
from numpy.typing import NDArray

from tactopose_drake.core.compilation import read_only
from tactopose_drake.core.shape.morton_order import morton_codes
from tactopose_drake.core.shape.surface_samples import points_along_surface
from tactopose_drake.core.shape.surfel_kernels import BLOCK, Discs
from tactopose_drake.core.validation import FloatArray

# How finely discs cover a surface, and which of them are reckoned: exactness against time.
SPACING_SIGMAS = 1.3
"""Wanted between neighbours, in a point's standard deviations."""
LEAST_SPACING = 0.0005
"""Between neighbours, m, however well a point is known."""
_MAX_SURFELS = 250_000  # about so many, at the most: larger surfaces get larger discs
_POINTS_PER_DISC = 9  # of the surface, whose mean and variance a disc is
_LEAST_MEAN_NORMAL = 0.92  # length of the mean of a disc's normals: they differ by some 20 degrees
_CELL_SPACINGS = 3.4  # a cell's width, in spacings: a contact's surroundings lie in few long runs
_REACH = 3.8  # discs count within so many standard deviations of a contact
_AN_OCTAVE = 4  # spacings
_BITS = 4  # of each coordinate within a cell, by which its discs are sorted


@dataclass(frozen=True, eq=False)
class Surfels:
    """Discs, sorted into cubic cells; where cells along z follow on each other their discs are a run of whole blocks.

    Attributes:
        blocks: of BLOCK discs near each other: centre in O, m; outward unit normal; area, m^2; variance of its points
            along each axis of its plane, m^2; variance of its normals about each, rad^2; shape (b, 9, BLOCK). What
            fills the last block of a run has no area.
        balls: centre in O and radius of a ball around the discs of each block, m, shape (b, 4).
        first: of each column, the number of places before each of its cells, and before the next column's discs,
            shape (nx * ny * (nz + 1),).
        origin: the first cell's lower corner, shape (3,), m.
        cell: a cell's width, m.
        shape: number of cells along x, y and z.
        spacing: about the distance between neighbours, m.
    """

    blocks: NDArray[np.float32]
    balls: NDArray[np.float32]
    first: NDArray[np.int32]
    origin: FloatArray
    cell: float
    shape: tuple[int, int, int]
    spacing: float

    def kernel_view(self) -> Discs:
        """The discs as kernels read them."""
        blocks, balls, first, origin = map(read_only, (self.blocks, self.balls, self.first, self.origin))
        return Discs(blocks, balls, first, origin, 1.0 / self.cell, self.shape, self.spacing, _REACH)


def surfel_spacing(sigma: float, area: float) -> float:
    """The spacing, m, that suits a point known to sigma, m, on a surface of this area, m^2: one of four an octave."""
    wanted = max(SPACING_SIGMAS * sigma, LEAST_SPACING, math.sqrt(area / _MAX_SURFELS))
    return 1e-3 * float(2.0 ** (math.ceil(_AN_OCTAVE * math.log2(1e3 * wanted) - 0.5) / _AN_OCTAVE))


def surfel_sigmas(least: float, largest: float) -> FloatArray:
    """Standard deviations of points, m, from the least to the largest, that between them suit all spacings."""
    least = max(least, LEAST_SPACING / SPACING_SIGMAS)
    steps = max(0, math.ceil(_AN_OCTAVE * math.log2(largest / least)))
    return np.asarray(least * 2.0 ** (np.arange(steps + 1) / _AN_OCTAVE))


def make_surfels(vertices: FloatArray, faces: NDArray[np.int32], area: float, spacing: float) -> Surfels:
    """Covers the mesh (v, 3), (f, 3) of this area, m^2, with discs about `spacing` apart, m, and more along creases."""
    count = max(1, round(_POINTS_PER_DISC * area / spacing**2))
    points, normals, share = points_along_surface(vertices, faces, count)
    # A disc is the points of one voxel whose normals have the same largest part, so that edges and walls come apart.
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
            np.column_stack([points[rest], normals[rest], alone]),  # Where they differ still, each is a disc by itself.
        ]
    )
    return _sorted(discs.astype(np.float32), _CELL_SPACINGS * spacing, spacing)


def _sorted(discs: NDArray[np.float32], cell: float, spacing: float) -> Surfels:
    """Discs (n, 9), in cells of this width, and within each so that neighbours follow on each other."""
    origin = discs[:, :3].min(axis=0).astype(np.float64) - 1e-9
    place = (discs[:, :3] - origin) / cell
    index = place.astype(np.int64)
    nx, ny, nz = (int(n) for n in index.max(axis=0) + 1)
    # Of a column of cells one may be empty: it counts in numbering them, and so does the end.
    number = (index[:, 0] * ny + index[:, 1]) * (nz + 1) + index[:, 2]
    parts = (2.0**_BITS * (place - index)).astype(np.int64)
    order = np.lexsort((morton_codes(parts, _BITS), number))
    discs, number = discs[order], number[order]
    # Runs of cells without a gap begin with a block of their own; the last disc's place fills the last block.
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
