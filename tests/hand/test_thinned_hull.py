"""Hulls whose facets Drake's contact surfaces bear."""

from pathlib import Path

import numpy as np
import trimesh
from pydrake.geometry import Convex, Mesh

from tactopose_drake.hand.thinned_hull import thinned_hull


def points_of(shape: Convex) -> np.ndarray:
    hull = shape.GetConvexHull()
    return np.array([hull.vertex(i) for i in range(hull.num_vertices())])


def test_vertices_micrometres_apart_become_one(tmp_path: Path) -> None:
    ball = trimesh.creation.icosphere(subdivisions=2, radius=0.01)
    corner = ball.vertices[0] * 1.0005
    beside = [corner + 4e-6 * np.cross(corner, side) / np.linalg.norm(corner) for side in np.eye(3)]
    trimesh.convex.convex_hull(np.concatenate([ball.vertices, [corner], beside])).export(tmp_path / "fine.obj")
    fine = points_of(Convex(tmp_path / "fine.obj"))
    hull = points_of(thinned_hull(Mesh(str(tmp_path / "fine.obj"))))
    assert len(hull) < len(fine)
    gaps = np.linalg.norm(hull[:, None] - hull, axis=2) + np.eye(len(hull))
    assert gaps.min() > 9e-5
    assert np.linalg.norm(fine[:, None] - hull, axis=2).min(axis=1).max() < 1e-4


def test_a_coarse_mesh_stays_as_it_is(tmp_path: Path) -> None:
    ball = trimesh.creation.icosphere(subdivisions=2, radius=0.01)
    ball.export(tmp_path / "ball.obj")
    mesh = Mesh(str(tmp_path / "ball.obj"), np.array([2.0, 2.0, 2.0]))
    hull = thinned_hull(mesh)
    assert hull.source().path() == tmp_path / "ball.obj"
    np.testing.assert_allclose(np.linalg.norm(points_of(hull), axis=1), 0.02, rtol=1e-5)
    assert len(points_of(thinned_hull(mesh, 0.008))) < len(ball.vertices)
