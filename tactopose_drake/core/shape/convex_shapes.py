"""Convex shapes, and how deep points and meshes are in them.

The depth of a point below the surface of a convex shape is a concave function with Lipschitz constant 1. So its maximum
over a sphere is at most that at the centre plus the radius, and over a triangle at most that of any tangent: with both
bounds the deepest point of a mesh is found by branch and bound, over a tree of spheres and then over parts of
triangles.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linprog

from tactopose_drake.core.compilation import read_only
from tactopose_drake.core.shape import convex_shape_kernels
from tactopose_drake.core.shape.convex_shape_kernels import Shapes, Tree
from tactopose_drake.core.shape.morton_order import morton_codes
from tactopose_drake.core.validation import FloatArray

_LEAF = 4  # approximate number of triangles of a leaf
_BITS = 10  # of each coordinate in a Morton code

_NO_PLANES, _NO_AXES, _MIDDLE = np.zeros((0, 4)), np.zeros(3), np.zeros(3)


@dataclass(frozen=True, eq=False)
class ConvexShape:
    """A convex shape in its own frame G.

    Attributes:
        shapes: this shape alone, in the form that kernels read.
    """

    shapes: Shapes

    @classmethod
    def capsule(cls, radius: float, length: float) -> ConvexShape:
        """About the z axis, with this length of the cylindrical part, m; a ball if that is zero."""
        return cls._make(radius=radius, half_length=0.5 * length)

    @classmethod
    def cylinder(cls, radius: float, length: float) -> ConvexShape:
        """About the z axis, m."""
        ends = np.array([[0.0, 0.0, 1.0, 0.5 * length], [0.0, 0.0, -1.0, 0.5 * length]])
        return cls._make(radius=radius, half_length=math.inf, planes=ends)

    @classmethod
    def ellipsoid(cls, semi_axes: FloatArray) -> ConvexShape:
        """Of semi-axes (3,), m."""
        return cls._make(semi_axes=semi_axes)

    @classmethod
    def box(cls, size: FloatArray) -> ConvexShape:
        """About the origin, of side lengths (3,), m."""
        normals = np.concatenate([np.eye(3), -np.eye(3)])
        return cls._make(planes=np.column_stack([normals, np.tile(0.5 * size, 2)]))

    @classmethod
    def hull(cls, normals: FloatArray, offsets: FloatArray) -> ConvexShape:
        """The bounded intersection of half-spaces with outward unit normals (n, 3) and offsets (n,), m."""
        planes = np.column_stack([normals, offsets])
        return cls._make(planes=planes, deepest=_chebyshev_center(planes))

    @classmethod
    def _make(
        cls,
        *,
        radius: float = math.inf,
        half_length: float = 0.0,
        semi_axes: FloatArray = _NO_AXES,
        planes: FloatArray = _NO_PLANES,
        deepest: FloatArray = _MIDDLE,
    ) -> ConvexShape:
        """A shape from its parts; see `Shapes`."""
        first = np.array([0, len(planes)])
        numbers = np.array([radius]), np.array([half_length]), semi_axes[None], first, planes, deepest[None]
        return cls(Shapes(*map(read_only, numbers)))

    def depths(self, p_GQ: FloatArray) -> FloatArray:
        """Depths of points (n, 3), m, below its surface, shape (n,), m; negative outside."""
        depth = np.empty(len(p_GQ))
        convex_shape_kernels.find_depths(self.shapes, np.ascontiguousarray(p_GQ, dtype=np.float64), depth)
        return depth


def join_shapes(shapes: Sequence[ConvexShape]) -> Shapes:
    """Concatenates shapes, at least one, in the form that kernels read."""
    each = [shape.shapes for shape in shapes]
    first = np.cumsum([0, *(len(one.planes) for one in each)])
    radius, half_length, semi_axes, _, planes, deepest = map(np.concatenate, zip(*each, strict=True))
    return Shapes(*map(read_only, (radius, half_length, semi_axes, first, planes, deepest)))


def _chebyshev_center(planes: FloatArray) -> FloatArray:
    """The deepest point behind planes (n, 4), shape (3,), m, by linear programming in units of their extent."""
    unit = np.abs(planes[:, 3]).max()
    gaps = np.column_stack([planes[:, :3], np.ones(len(planes))])
    found = linprog([0.0, 0.0, 0.0, -1.0], gaps, planes[:, 3] / unit, bounds=(None, None))
    return np.asarray(unit * found["x"][:3])


def build_tree(vertices: FloatArray, faces: np.ndarray) -> Tree:
    """A tree over the triangles of a mesh with vertices (v, 3), m, and faces (f, 3).

    They are sorted along a space-filling curve, so that the triangles of each node are close together.
    """
    triangles = vertices[faces].reshape(-1, 9)
    order = np.argsort(_codes(vertices[faces].mean(axis=1)), kind="stable")
    leaves = 1 << max(0, math.ceil(math.log2(len(faces) / _LEAF)))
    count = leaves * math.ceil(len(faces) / leaves)
    chosen = np.arange(count) * len(faces) // count
    sorted_ones = triangles[order[chosen]]
    again = np.flatnonzero(np.diff(chosen) == 0) + 1  # Repeated triangles become points, so that each counts once.
    sorted_ones[again] = np.tile(sorted_ones[again, :3], 3)
    coordinates = np.ascontiguousarray(sorted_ones.reshape(-1, 3).T)
    spheres = [np.zeros((0, 4))]
    for level in range(leaves.bit_length()):
        points = coordinates.reshape(3, 1 << level, -1)
        center = 0.5 * (points.min(axis=2) + points.max(axis=2))
        radius = np.sqrt(((points - center[:, :, None]) ** 2).sum(axis=0).max(axis=1))
        spheres.append(np.column_stack([*center, radius]))
    return Tree(read_only(np.concatenate(spheres)), read_only(sorted_ones))


def _codes(points: FloatArray) -> np.ndarray:
    """Positions of points (n, 3) along that curve, shape (n,)."""
    low = points.min(axis=0)
    size = max(float(np.ptp(points, axis=0).max()), 1e-300)
    cells = np.minimum((points - low) / size * (1 << _BITS), (1 << _BITS) - 1).astype(np.int64)
    return morton_codes(cells, _BITS)
