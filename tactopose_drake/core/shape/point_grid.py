"""A point cloud sorted into cubic cells, for fast range and nearest-neighbour queries.

The cells of a column along z are consecutive, so the points in any part of a column are a contiguous run of the array.
"""

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from tactopose_drake.core.compilation import read_only
from tactopose_drake.core.shape.point_grid_kernels import Cloud, nearest_squares
from tactopose_drake.core.validation import FloatArray, finite_array
from tactopose_drake.errors import InvalidInputError


@dataclass(frozen=True, kw_only=True)
class PointGridParams:
    """The size of cells, which trades points per cell against memory."""

    cell_spacings: float = 2.5  # width of a cell over the median distance between nearest neighbours
    most_cells: int = 200_000  # cells are widened where there would be more


@dataclass(frozen=True, eq=False)
class PointGrid:
    """Points of an object in its frame O, by cells; made by `build_point_grid`; arrays are read-only.

    Attributes:
        points: in the order of their cells, shape (n, 3), m.
        starts: index of the first point of each cell (x slowest, z fastest), and n at the end, shape (nx ny nz + 1,).
        seeds: index of the point nearest to each cell's centre, shape (nx, ny, nz).
        origin: lower corner of the first cell, shape (3,), m.
        spacing: width of a cell, m.
    """

    points: FloatArray
    starts: NDArray[np.int32]
    seeds: NDArray[np.int32]
    origin: FloatArray
    spacing: float

    @property
    def kernel_view(self) -> Cloud:
        """The points in the form that kernels read."""
        points, starts, seeds, origin = map(read_only, (self.points, self.starts, self.seeds, self.origin))
        return Cloud(points, starts, seeds, origin, float(self.spacing))

    def distance(self, p_OQ: ArrayLike) -> FloatArray:
        """Distances, shape (n,), m, from points p_OQ, shape (n, 3), m, to the nearest point of the cloud."""
        queries = finite_array("p_OQ", p_OQ, (None, 3))
        squares = np.empty(len(queries))
        nearest_squares(self.kernel_view, queries, squares)
        return np.sqrt(squares)


def build_point_grid(points: ArrayLike, params: PointGridParams = PointGridParams()) -> PointGrid:
    """Sorts points (n, 3), m, into cells.

    Raises:
        InvalidInputError: fewer than two points, or points that are not finite or all the same.
    """
    points = finite_array("points", points, (None, 3))
    if len(points) < 2 or not np.any(np.ptp(points, axis=0) > 0):
        same = ", all the same" if len(points) > 1 else ""
        raise InvalidInputError(f"points must be at least 2 different ones, not {len(points)}{same}.")
    tree = scipy.spatial.cKDTree(points)
    gaps = np.asarray(tree.query(points, k=2)[0])
    lower, extent = points.min(axis=0), np.ptp(points, axis=0)
    spacing = max(params.cell_spacings * float(np.median(gaps[:, 1])), 1e-3 * float(extent.max()))
    while np.prod(extent / spacing + 1.0) > params.most_cells:
        spacing *= 1.2
    shape = (extent / spacing).astype(np.intp) + 1
    cell = np.minimum(((points - lower) / spacing).astype(np.intp), shape - 1)
    flat = (cell[:, 0] * shape[1] + cell[:, 1]) * shape[2] + cell[:, 2]
    order = np.argsort(flat, kind="stable")
    starts = np.searchsorted(flat[order], np.arange(np.prod(shape) + 1)).astype(np.int32)
    middles = lower + spacing * (np.moveaxis(np.indices(shape), 0, -1) + 0.5)
    rank = np.empty(len(points), dtype=np.int32)
    rank[order] = np.arange(len(points))
    seeds = rank[tree.query(middles)[1]]
    arrays = (points[order], starts, seeds, lower)
    for array in arrays:
        array.setflags(write=False)
    return PointGrid(*arrays, spacing)
