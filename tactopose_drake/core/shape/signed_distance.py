"""The signed distance grid of an object: distance and outward normal for any point, by trilinear interpolation."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactopose_drake.core.compilation import read_only
from tactopose_drake.core.kernels.grid_kernels import COARSENESS, Grid
from tactopose_drake.core.mesh.bodies import face_areas, volumes
from tactopose_drake.core.mesh.winding_kernels import winding_numbers
from tactopose_drake.core.shape import distance_transform
from tactopose_drake.core.shape.distance_kernels import signed_field
from tactopose_drake.core.shape.field_kernels import interpolate
from tactopose_drake.core.shape.smooth_normals import NormalParams, corner_normals, smooth_normals
from tactopose_drake.core.validation import FloatArray, positive_number
from tactopose_drake.errors import InvalidInputError

BYTES_PER_NODE = 16
"""Size of a node in memory: four numbers of four bytes."""

LEAST_NODES = 10_000
"""Least number of nodes that `max_bytes` must allow."""

_LOST = 1e-3  # length below which the direction of a mean normal is mere rounding error


@dataclass(frozen=True, kw_only=True)
class GridParams:
    """Resolution and extent of a grid, which trade accuracy against memory and time."""

    nodes: int = 2_000_000  # of a grid without a given spacing
    cells_per_wall: float = 2.5  # least number across a wall: a grid for thin walls is finer
    margin_cells: int = 3  # least margin around the mesh's box, in cells
    margin_share: float = 0.05  # least margin, as a share of its diagonal
    band: float = 2.0  # half width of the band about the surface where distances are exact, in spacings
    normals: NormalParams = NormalParams()


@dataclass(frozen=True, eq=False)
class DistanceGrid:
    """Signed distance and the surface's normal at the nodes of a cubic grid, in the object's frame O.

    Between nodes all four channels are interpolated trilinearly. Outside the grid a point is moved to the nearest point
    of the grid; its distance is that point's distance plus the length of the move, its normal is that point's normal.

    Attributes:
        values: shape (nx, ny, nz, 4), float32, C-contiguous, read-only; last axis: signed distance in m (negative
            inside), then the outward normal of the smooth surface at the closest point (see `smooth_normals`).
        origin: position of node (0, 0, 0), shape (3,), m.
        spacing: distance between nodes, m.
    """

    values: NDArray[np.float32]
    origin: FloatArray
    spacing: float

    @property
    def shape(self) -> tuple[int, int, int]:
        """Number of nodes along x, y and z."""
        nx, ny, nz = self.values.shape[:3]
        return nx, ny, nz

    @property
    def upper(self) -> FloatArray:
        """Position of the last node, shape (3,), m."""
        corner: FloatArray = self.origin + self.spacing * (np.array(self.shape) - 1)
        return corner

    def distance(self, p_OQ: ArrayLike) -> FloatArray:
        """Signed distances, shape (...), m, of points p_OQ in O, shape (..., 3), m.

        Raises:
            InvalidInputError: if the points are of another shape.
        """
        return self._interpolate(p_OQ, channels=1)[..., 0]

    def distance_and_normal(self, p_OQ: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Signed distances (...), m, and unit normals (..., 3) in O, of points p_OQ in O, shape (..., 3), m.

        Where the normals of a cell cancel (between two sides of the object, at its centre), that of the nearest node is
        used, and if that is degenerate too, the z axis.

        Raises:
            InvalidInputError: if the points are of another shape.
        """
        fields = self._interpolate(p_OQ, channels=4)
        normal = fields[..., 1:]
        lost = np.linalg.norm(normal, axis=-1) < _LOST
        if np.any(lost):
            points = np.asarray(p_OQ, dtype=np.float64)[lost]
            node = np.rint((np.clip(points, self.origin, self.upper) - self.origin) / self.spacing).astype(np.intp)
            nearest = self.values[node[:, 0], node[:, 1], node[:, 2], 1:]
            usable = np.linalg.norm(nearest, axis=-1, keepdims=True) >= _LOST
            normal[lost] = np.where(usable, nearest, [0.0, 0.0, 1.0])
        return fields[..., 0], normal / np.linalg.norm(normal, axis=-1, keepdims=True)

    @functools.cached_property
    def nodes(self) -> Grid:
        """The grid in the form that kernels read."""
        return Grid(read_only(self.values), read_only(self.origin), 1.0 / self.spacing)

    @functools.cached_property
    def coarse_distances(self) -> NDArray[np.float32]:
        """The distances at every fourth node along each axis, and at the last, m."""
        some = (np.minimum(np.arange(0, n + COARSENESS - 1, COARSENESS), n - 1) for n in self.shape)
        return np.asarray(read_only(self.values[..., 0][np.ix_(*some)]))

    def _interpolate(self, p_OQ: ArrayLike, channels: int) -> FloatArray:
        """The first `channels` fields at points (..., 3), shape (..., channels); the distance extended outside."""
        points = np.asarray(p_OQ, dtype=np.float64)
        if points.shape[-1:] != (3,):
            raise InvalidInputError(f"p_OQ must have the shape (..., 3), not {points.shape}.")
        flat = np.ascontiguousarray(points.reshape(-1, 3))
        fields = np.empty((len(flat), channels))
        interpolate(read_only(self.values), read_only(self.origin), self.upper, self.spacing, flat, fields)
        return fields.reshape(*points.shape[:-1], channels)


class PlacedGrid(NamedTuple):
    """The grid of an object at a pose in another frame P.

    Attributes:
        grid: of the object.
        X_PO: the object's pose, shape (3, 4).
    """

    grid: DistanceGrid
    X_PO: FloatArray

    def distance(self, p_PQ: FloatArray) -> FloatArray:
        """Signed distances, shape (...), m, of points p_PQ in P, shape (..., 3), m."""
        return self.grid.distance((p_PQ - self.X_PO[:, 3]) @ self.X_PO[:, :3])

    def distance_and_normal(self, p_PQ: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Signed distances (...), m, and unit normals (..., 3) in P, of points p_PQ in P, shape (..., 3), m."""
        R_PO = self.X_PO[:, :3]
        distance, n_O = self.grid.distance_and_normal((p_PQ - self.X_PO[:, 3]) @ R_PO)
        return distance, n_O @ R_PO.T


def build_grid(
    vertices: FloatArray,
    faces: NDArray[np.int32],
    *,
    spacing: float | None = None,
    max_bytes: int = 64 * 2**20,
    params: GridParams = GridParams(),
) -> DistanceGrid:
    """Builds the signed distance grid of a closed mesh; a point is inside if the winding number is at least one.

    Without a `spacing`, the grid has about two million nodes over the bounding box and its margin; more if walls are
    thinner than two and a half cells, but never more than `max_bytes` allow.

    Args:
        vertices: shape (v, 3), m.
        faces: vertex indices, anticlockwise seen from outside, shape (f, 3); none of zero area.
        spacing: distance between nodes, m.
        max_bytes: the largest size of `DistanceGrid.values`.
        params: its resolution otherwise, and its extent.

    Raises:
        InvalidInputError: if `spacing` is not positive, or needs more than `max_bytes`.
    """
    lower, upper = vertices.min(axis=0), vertices.max(axis=0)
    max_nodes = max_bytes // BYTES_PER_NODE
    if max_nodes < LEAST_NODES:
        raise InvalidInputError(f"max_grid_bytes must be a number >= {LEAST_NODES * BYTES_PER_NODE}, not {max_bytes}.")
    finest = _spacing_for(lower, upper, max_nodes, params)
    wall = _wall_thickness(vertices, faces)
    if spacing is None:
        h = max(finest, min(_spacing_for(lower, upper, params.nodes, params), wall / params.cells_per_wall))
    else:
        h = positive_number("spacing", spacing)
        if h < finest:
            raise InvalidInputError(
                f"spacing must be at least {finest:.3g} m with max_grid_bytes = {max_bytes}, not {h:g} m."
            )
    shape = grid_shape(lower, upper, h, params)
    origin = 0.5 * (lower + upper) - 0.5 * h * (np.array(shape) - 1)
    packed = distance_transform.pack_triangles(vertices[faces])
    nearest = distance_transform.nearest_faces(packed, origin, h, shape, params.band)
    winding = _winding(vertices, faces, origin, h, shape)
    values = signed_field(packed, nearest, winding, origin, h)
    corners = corner_normals(vertices, faces, packed[:, 12:15], math.cos(params.normals.crease))
    smooth_normals(values, corners, packed, nearest, origin, h, wall, params.normals)
    values.setflags(write=False)
    origin.setflags(write=False)
    return DistanceGrid(values, origin, float(h))


def _winding(
    vertices: FloatArray, faces: NDArray[np.int32], origin: FloatArray, h: float, shape: tuple[int, int, int]
) -> NDArray[np.int16]:
    """Winding numbers of the nodes, counted along columns shifted by a millionth of a cell or less.

    The shift avoids vertices of regular meshes in the nodes' own columns. If rounding makes a column miss a crossing
    all the same, which its remainder shows, another shift is tried.
    """
    for shift in (1.3e-7, -2.9e-7, 5.3e-7, -7.1e-7):
        beside = origin + h * shift * np.array([1.0, 2.1, 0.0])
        winding, rest = winding_numbers(vertices, faces, beside, h, shape)
        if not rest.any():
            break
    counts: NDArray[np.int16] = winding
    return counts


def _wall_thickness(vertices: FloatArray, faces: NDArray[np.int32]) -> float:
    """Twice the volume over the area: the thickness of a shell; two thirds of the radius for a ball."""
    return 2.0 * float(volumes(vertices, faces)[0]) / float(face_areas(vertices, faces).sum())


def grid_shape(
    lower: FloatArray, upper: FloatArray, h: float, params: GridParams = GridParams()
) -> tuple[int, int, int]:
    """Number of nodes along x, y and z of a grid of spacing h over a mesh's box with corners (3,), m."""
    margin = max(params.margin_cells * h, params.margin_share * float(np.linalg.norm(upper - lower)))
    nx, ny, nz = (int(n) for n in np.ceil((upper - lower + 2 * margin) / h) + 1)
    return nx, ny, nz


def _spacing_for(lower: FloatArray, upper: FloatArray, nodes: int, params: GridParams) -> float:
    """The spacing at which the grid has at most this many nodes."""
    extent = upper - lower + 2 * params.margin_share * float(np.linalg.norm(upper - lower))
    h = math.cbrt(np.prod(extent) / nodes)  # NumPy's cube root rounds differently on processors with AVX-512.
    while np.prod(grid_shape(lower, upper, h, params), dtype=np.float64) > nodes:
        h *= 1.002
    return h
