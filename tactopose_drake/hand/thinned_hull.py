"""A mesh's convex hull without the tiny facets that Drake's contact surfaces do not support.

Meshes of hands may have vertices micrometres apart; Drake raises an error for a triangle whose edges' cross product is
shorter than 1e-10 m^2.
"""

import functools
import itertools
from pathlib import Path

import numpy as np
from pydrake.geometry import Convex, Mesh, PolygonSurfaceMesh
from scipy.spatial import cKDTree

from tactopose_drake.core.validation import FloatArray
from tactopose_drake.estimation.hull_vertices import hull_vertices

_DISTANCES = (1e-4, 2e-4, 5e-4, 1e-3, 2e-3)  # least distances between vertices that are tried in turn, m
_KEPT = 64  # cached hulls
_LEAST_AREA = 2e-10  # of the parallelogram on two edges of a facet's triangle, m^2


def thinned_hull(mesh: Mesh | Convex, nearest: float = 0.0) -> Convex:
    """The hull of a mesh, with vertices far enough apart that no facet is too small.

    Args:
        mesh: the mesh.
        nearest: least distance between vertices, m; fewer vertices make contact surfaces faster to compute.
    """
    source = mesh.source()
    if not source.is_path():
        return _thin(Convex(source, mesh.scale3()), nearest)
    a, b, c = mesh.scale3().tolist()
    return _of_file(source.path(), source.path().stat().st_mtime_ns, (a, b, c), nearest)


@functools.lru_cache(maxsize=_KEPT)
def _of_file(path: Path, changed: int, scale: tuple[float, float, float], nearest: float) -> Convex:
    """The thinned hull of a file; cached, as fingers are mostly alike and used several times."""
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
    """A subset of points (n, 3) with distances above `nearest`, m; points far from the middle are preferred."""
    order = np.argsort(-np.linalg.norm(points - points.mean(axis=0), axis=1), kind="stable")
    neighbours = cKDTree(points).query_ball_point(points, nearest)
    taken = np.zeros(len(points), dtype=np.bool_)
    for i in order:
        taken[i] = not taken[neighbours[i]].any()
    return points[taken]


def _least_area(hull: PolygonSurfaceMesh) -> float:
    """The least parallelogram area of the facets' triangles, m^2; each facet is fanned from its first vertex."""
    vertices, data, start = hull_vertices(hull), np.asarray(hull.face_data()), 0
    triangles: list[tuple[int, int, int]] = []
    while start < len(data):
        first, *others = data[start + 1 : start + 1 + data[start]]
        triangles += [(first, *sides) for sides in itertools.pairwise(others)]
        start += 1 + data[start]
    a, b, c = vertices[np.array(triangles).T]
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).min())
