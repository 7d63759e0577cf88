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
from tactopose_drake.core.shape.surface_samples import points_along_surface
from tactopose_drake.core.shape.surfel_kernels import BLOCK, Discs, Measurements, densities
from tactopose_drake.core.validation import FloatArray


@dataclass(frozen=True, kw_only=True)
class SurfelParams:
    """How finely discs cover a surface, and which of them are reckoned: exactness against time."""

    spacing_sigmas: float = 1.3  # wanted between neighbours, in a point's standard deviations
    least_spacing: float = 0.0005  # between neighbours, m, however well a point is known
    max_surfels: int = 250_000  # about so many, at the most: larger surfaces get larger discs
    points_per_disc: int = 9  # of the surface, whose mean and variance a disc is
    least_mean_normal: float = 0.92  # length of the mean of a disc's normals: they differ by some 20 degrees
    cell_spacings: float = 3.4  # a cell's width, in spacings: a contact's surroundings lie in few long runs
    reach: float = 3.8  # discs count within so many standard deviations of a contact


@dataclass(frozen=True, eq=False)
class Surfels:
    """Discs, sorted into cubic cells.

    Attributes:
        discs: centre in O, m; outward unit normal; area, m^2; variance of its points along each axis of its plane, m^2;
            variance of its normals about each, rad^2; shape (9, n + BLOCK), the last of which are none, of area 0.
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

    def kernel_view(self, reach: float) -> Discs:
        """The discs as kernels read them, of which those count that are within so many standard deviations."""
        discs, first, origin = read_only(self.discs), read_only(self.first), read_only(self.origin)
        return Discs(discs, first, origin, 1.0 / self.cell, self.shape, self.spacing, reach)


def surfel_spacing(sigma: float, area: float, params: SurfelParams = SurfelParams()) -> float:
    """The spacing, m, that suits a point known to sigma, m, on a surface of this area, m^2: one of four an octave."""
    wanted = max(params.spacing_sigmas * sigma, params.least_spacing, math.sqrt(area / params.max_surfels))
    return 1e-3 * float(2.0 ** (0.25 * math.ceil(4.0 * math.log2(1e3 * wanted) - 0.5)))


def make_surfels(
    vertices: FloatArray,
    faces: NDArray[np.int32],
    area: float,
    spacing: float,
    params: SurfelParams = SurfelParams(),
) -> Surfels:
    """Covers the mesh (v, 3), (f, 3) of this area, m^2, with discs about `spacing` apart, m, and more along creases."""
    count = max(1, round(params.points_per_disc * area / spacing**2))
    points, normals, share = points_along_surface(vertices, faces, count)
    # A disc is the points of one voxel whose normals have the same largest part, so that edges and walls come apart.
    part = np.abs(normals).argmax(axis=1)
    side = 2 * part + (np.take_along_axis(normals, part[:, None], axis=1)[:, 0] > 0.0)
    voxel = ((points - points.min(axis=0)) / spacing).astype(np.int64)
    _, disc = np.unique((voxel << [43, 23, 3]).sum(axis=1) + side, return_inverse=True)
    size = np.bincount(disc)
    center, mean = (_averages(rows, disc, size) for rows in (points, normals))
    variance = 0.5 * _averages(np.sum((points - center[disc]) ** 2, axis=1)[:, None], disc, size)[:, 0]
    length = np.linalg.norm(mean, axis=1)
    is_flat = length > params.least_mean_normal
    rest = ~is_flat[disc]
    discs = np.concatenate(
        [
            np.column_stack([center, mean / length[:, None], share * size, variance, 0.5 * (1.0 - length**2)])[is_flat],
            # Where they differ still, each point is a disc by itself.
            np.column_stack([points, normals, *np.broadcast_arrays(share, share / 12.0, 0.0, points[:, 0])[:3]])[rest],
        ]
    )
    cell = params.cell_spacings * spacing
    origin = discs[:, :3].min(axis=0) - 1e-9
    index = ((discs[:, :3] - origin) / cell).astype(np.int64)
    nx, ny, nz = (int(n) for n in index.max(axis=0) + 1)
    key = (index[:, 0] * ny + index[:, 1]) * nz + index[:, 2]
    order = np.argsort(key, kind="stable")
    discs = np.concatenate([discs[order].T, np.zeros((9, BLOCK))], axis=1).astype(np.float32)
    first = np.searchsorted(key[order], np.arange(nx * ny * nz + 1)).astype(np.int32)
    for array in (discs, first, origin):
        array.setflags(write=False)
    return Surfels(discs, first, origin, cell, (nx, ny, nz), spacing)


def _averages(rows: FloatArray, group: NDArray[np.intp], size: NDArray[np.intp]) -> FloatArray:
    """Means of rows (n, d) over their groups, shape (groups, d)."""
    return np.stack([np.bincount(group, column) / size for column in rows.T], axis=1)


def contact_densities(
    surfels: Surfels, measured: Measurements, X_PO: FloatArray, params: SurfelParams = SurfelParams()
) -> FloatArray:
    """The densities (B, k) of contacts at poses (B, 3, 4), over those on a flat surface with the right normal."""
    density = np.empty((len(X_PO), len(measured.p)))
    densities(surfels.kernel_view(params.reach), measured, X_PO, density)
    return density
