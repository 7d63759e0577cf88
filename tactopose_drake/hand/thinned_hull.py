"""A mesh's convex hull without the tiny facets that Drake's contact surfaces do not bear.

Meshes of hands have vertices some micrometres apart; Drake makes no plane of a triangle whose edges' cross product is
shorter than 1e-10 m^2, and raises an error.
"""

import functools
import itertools
from pathlib import Path

import numpy as np
from pydrake.geometry import Convex, Mesh, PolygonSurfaceMesh
from scipy.spatial import cKDTree

from tactopose_drake.core.validation import FloatArray
from tactopose_drake.estimation.hull_vertices import hull_vertices

_DISTANCES = (1e-4, 2e-4, 5e-4, 1e-3, 2e-3)  # that vertices keep where facets are too small, m
_KEPT = 64  # hulls, of as many files
_LEAST_AREA = 2e-10  # of the parallelogram on two edges of a facet's triangle, m^2


def thinned_hull(mesh: Mesh | Convex, nearest: float = 0.0) -> Convex:
    """The hull of a mesh, of vertices so far from each other that no facet is too small.

    Args:
        mesh: what the hull is of.
        nearest: distance that vertices keep in any case, m: fewer make contact surfaces faster.
    """
    source = mesh.source()
    if not source.is_path():
        return _thin(Convex(source, mesh.scale3()), nearest)
    a, b, c = mesh.scale3().tolist()
    return _of_file(source.path(), source.path().stat().st_mtime_ns, (a, b, c), nearest)


@functools.lru_cache(maxsize=_KEPT)
def _of_file(path: Path, changed: int, scale: tuple[float, float, float], nearest: float) -> Convex:
    """The thinned hull of a file; fingers mostly are alike, and a station makes several of each."""
    return _thin(Convex(path, np.array(scale)), nearest)


def _thin(mesh: Convex, nearest: float) -> Convex:
    vertices = hull_vertices(mesh.GetConvexHull())
    for distance in (nearest, *(longer for longer in _DISTANCES if longer > nearest)):
        kept = _thinned(vertices, distance)
        hull = mesh if len(kept) == len(vertices) else Convex(kept.T, "hull")
        if _least_area(hull.GetConvexHull()) >= _LEAST_AREA:
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


def _least_area(hull: PolygonSurfaceMesh) -> float:
    """The least area of the parallelograms on the facets' triangles, m^2, each facet divided from its first vertex."""
    vertices, data, start = hull_vertices(hull), np.asarray(hull.face_data()), 0
    triangles: list[tuple[int, int, int]] = []
    while start < len(data):
        first, *others = data[start + 1 : start + 1 + data[start]]
        triangles += [(first, *sides) for sides in itertools.pairwise(others)]
        start += 1 + data[start]
    a, b, c = vertices[np.array(triangles).T]
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).min())
