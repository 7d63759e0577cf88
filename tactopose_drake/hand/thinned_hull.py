"""A mesh's convex hull without the tiny facets that Drake's contact surfaces do not bear.

Meshes of hands have vertices some micrometres apart; Drake makes no plane of a triangle whose edges' cross product is
shorter than 1e-10 m^2, and raises an error.
"""

from collections.abc import Iterator

import numpy as np
from pydrake.geometry import Convex, Mesh, PolygonSurfaceMesh
from scipy.spatial import cKDTree

from tactopose_drake.core.validation import FloatArray

_DISTANCES = (1e-4, 2e-4, 5e-4, 1e-3, 2e-3)  # that vertices keep where facets are too small, m
_LEAST_AREA = 2e-10  # of the parallelogram on two edges of a facet's triangle, m^2


def thinned_hull(mesh: Mesh | Convex, nearest: float = 0.0) -> Convex:
    """The hull of a mesh, of vertices so far from each other that no facet is too small.

    Args:
        mesh: what the hull is of.
        nearest: distance that vertices keep in any case, m: fewer make contact surfaces faster.
    """
    vertices = _vertices(mesh.GetConvexHull())
    for distance in (nearest, *(longer for longer in _DISTANCES if longer > nearest)):
        kept = _thinned(vertices, distance)
        is_whole = len(kept) == len(vertices)
        hull = Convex(mesh.source(), mesh.scale3()) if is_whole else Convex(kept.T, "hull")
        if min(_areas(hull.GetConvexHull())) >= _LEAST_AREA:
            break
    return hull


def _thinned(points: FloatArray, nearest: float) -> FloatArray:
    """Some of the points (n, 3), no two nearer to each other than so much, m; those far from the middle first."""
    order = np.argsort(-np.linalg.norm(points - points.mean(axis=0), axis=1), kind="stable")
    neighbours = cKDTree(points).query_ball_point(points, nearest)
    taken = np.zeros(len(points), dtype=np.bool_)
    for i in order:
        taken[i] = not taken[neighbours[i]].any()
    return points[taken]


def _vertices(hull: PolygonSurfaceMesh) -> FloatArray:
    return np.array([hull.vertex(i) for i in range(hull.num_vertices())])


def _areas(hull: PolygonSurfaceMesh) -> Iterator[float]:
    """The areas of the parallelograms on the facets' triangles, m^2, each facet divided from its first vertex."""
    vertices, data, start = _vertices(hull), hull.face_data(), 0
    while start < len(data):
        count = data[start]
        corners = vertices[data[start + 1 : start + 1 + count]]
        sides = corners[1:] - corners[0]
        yield from np.linalg.norm(np.cross(sides[:-1], sides[1:]), axis=1)
        start += 1 + count
