"""The moves of the remesher keep a surface a surface, and each does what it is for."""

import numpy as np
import pytest
import trimesh

from .object_files import generate  # noqa: F401 (puts the shapes on the path)

# isort: split
from object_shapes.remeshing import Remesher


def remesher_of(mesh: trimesh.Trimesh, length: float) -> Remesher:
    points = [tuple(p) for p in mesh.vertices.tolist()]
    return Remesher(points, [tuple(f) for f in mesh.faces.tolist()], [length] * len(points))


def mesh_of(remesher: Remesher) -> trimesh.Trimesh:
    mesh = trimesh.Trimesh(remesher.points, list(remesher.faces.values()), process=False)
    mesh.remove_unreferenced_vertices()
    return mesh


def face_set(faces: object) -> set[frozenset[int]]:
    return {frozenset(map(int, face)) for face in faces}  # type: ignore[attr-defined]


def test_long_edges_are_split_until_none_is_left() -> None:
    remesher = remesher_of(trimesh.creation.icosphere(subdivisions=1, radius=1.0), 0.3)
    for _ in range(6):
        remesher.split_long_edges()
    mesh = mesh_of(remesher)
    assert mesh.is_watertight
    assert mesh.euler_number == 2
    assert mesh.edges_unique_length.max() <= 0.4 + 1e-12


def test_short_edges_are_collapsed() -> None:
    sphere = trimesh.creation.icosphere(subdivisions=4, radius=1.0)
    remesher = remesher_of(sphere, 0.3)
    remesher.collapse_short_edges()
    mesh = mesh_of(remesher)
    assert mesh.is_watertight
    assert mesh.euler_number == 2
    assert len(mesh.faces) < len(sphere.faces) / 3
    assert mesh.volume == pytest.approx(sphere.volume, rel=0.1)


def test_a_tube_of_three_sides_is_not_pinched_shut() -> None:
    """Around it the edges are short, but merging their ends would glue the tube's walls together."""
    turn = np.arange(3) * (2 * np.pi / 3)
    ring = np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
    vertices = np.concatenate([np.add(ring, (0, 0, 6 * level)) for level in range(4)])
    faces = [[0, 2, 1], [9, 10, 11]]
    for low in (0, 3, 6):
        for i in range(3):
            j = (i + 1) % 3
            faces += [[low + i, low + j, low + 3 + j], [low + i, low + 3 + j, low + 3 + i]]
    remesher = remesher_of(trimesh.Trimesh(vertices, faces, process=False), 3.0)
    # The inner rings' edges alone: at the two ends a merge is lawful.
    for a, b in ((3, 4), (4, 5), (3, 5), (6, 7), (7, 8), (6, 8)):
        remesher._collapse(a, b)
    assert face_set(remesher.faces.values()) == face_set(faces)


def test_a_bad_diagonal_is_flipped_back_and_good_ones_stay() -> None:
    sphere = trimesh.creation.icosphere(subdivisions=3, radius=1.0)
    good = remesher_of(sphere, 0.1)
    good.flip_edges()
    assert face_set(good.faces.values()) == face_set(sphere.faces)

    (one, two), (a, b) = sphere.face_adjacency[100], sphere.face_adjacency_edges[100]
    c, d = (next(v for v in sphere.faces[f] if v not in (a, b)) for f in (one, two))
    faces = sphere.faces.copy()
    faces[one] = [d if v == b else v for v in sphere.faces[one]]
    faces[two] = [c if v == a else v for v in sphere.faces[two]]
    spoiled = trimesh.Trimesh(sphere.vertices, faces, process=False)
    assert spoiled.is_watertight
    assert face_set(faces) != face_set(sphere.faces)
    remesher = remesher_of(spoiled, 0.1)
    remesher.flip_edges()
    assert face_set(remesher.faces.values()) == face_set(sphere.faces)
    assert mesh_of(remesher).is_winding_consistent
