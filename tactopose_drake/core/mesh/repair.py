"""Converts raw triangles to a closed, consistently oriented mesh in metres: checks, repairs, and states each repair."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from tactopose_drake.core.mesh import bodies as mesh_bodies
from tactopose_drake.core.mesh import topology as mesh_topology
from tactopose_drake.core.mesh.flat_faces import without_flat_faces
from tactopose_drake.core.mesh.holes import close_holes
from tactopose_drake.core.mesh.loading import RawMesh
from tactopose_drake.core.mesh.solid import SolidProperties, solid_properties
from tactopose_drake.core.mesh.topology import IntArray
from tactopose_drake.core.plain_values import counted
from tactopose_drake.core.validation import FloatArray
from tactopose_drake.errors import InvalidMeshError, MeshUnitsError

LARGEST_SIZE = 3.0
SMALLEST_SIZE = 0.002
"""Range of diagonals, m, of a plausible object in metres."""

FARTHEST = 20.0
"""Largest distance of a mesh from its frame's origin, in sizes: beyond, poses of the frame say little of the object."""

_MERGE_DISTANCE = 1e-7  # between duplicates of a vertex, as a share of the size: single-precision rounding
_MOST_NEIGHBOURS = 50  # pairs of vertices within a welding distance, per vertex: more are no cracks
# Widths of cracks that are welded if that closes the mesh, as shares of the size, tried in turn.
_WELD_DISTANCES = (1e-5, 1e-4)


class MeshRepairWarning(UserWarning):
    """A mesh needed the repair that the message states."""


@dataclass(frozen=True, eq=False)
class RepairedMesh:
    """A closed mesh and what was done to it.

    Attributes:
        vertices: shape (v, 3), m.
        faces: vertex indices, anticlockwise seen from outside, shape (f, 3); none of zero area, and every edge belongs
            to two, once in each direction.
        repairs: one sentence for each repair.
        properties: volume, centroid and inertia, which are physically possible; sealed cavities, whose walls are not
            among the faces, are empty.
    """

    vertices: FloatArray
    faces: NDArray[np.int32]
    repairs: tuple[str, ...]
    properties: SolidProperties


def repair_mesh(raw: RawMesh, name: str) -> RepairedMesh:
    """Checks a mesh, and repairs what can be repaired without guessing at the shape.

    Repaired with a statement: faces without area, repeated faces, faces with the wrong orientation, inside-out bodies,
    edges where bodies touch, cracks, holes that leave inside and outside distinguishable, debris, bodies that overlap
    or touch along faces. Duplicate vertices are merged silently. Separate bodies are kept as one rigid object, with a
    statement. Inside-out shells within a body are its cavities: they take away mass, but no finger reaches their walls,
    which are left out of the surface, with a statement.

    Args:
        raw: the triangles.
        name: of the mesh, in error messages.

    Raises:
        InvalidMeshError: if there are no faces, a vertex is not finite, the mesh is not manifold, has no volume, is so
            open that inside and outside are not distinguishable, passes through itself so that its inertia is that of
            no body, or lies so far from its frame's origin that precision is lost.
        MeshUnitsError: if its size is not that of an object in metres.
    """
    repairs: list[str] = []
    try:
        size = _check(raw)
        vertices, faces = _connect(raw.vertices, raw.faces, size, repairs)
        vertices, faces = close_holes(vertices, faces, size, repairs)
        vertices, faces = mesh_bodies.arrange(vertices, faces, repairs)
        vertices, faces = _compact(vertices, without_flat_faces(vertices, faces, size, repairs))
        properties = solid_properties(vertices, faces)
        vertices, faces = _compact(vertices, mesh_bodies.without_cavities(vertices, faces, repairs))
    except (InvalidMeshError, MeshUnitsError) as error:
        raise type(error)(f"{name} {error}") from None
    return RepairedMesh(vertices, faces.astype(np.int32), tuple(repairs), properties)


def _check(raw: RawMesh) -> float:
    """Checks faces, indices and vertices, and that the size is that of an object in metres; returns the size."""
    if not len(raw.faces):
        raise InvalidMeshError("must have faces, but is empty, cut short, or made of points alone.")
    bad = np.flatnonzero(np.any((raw.faces < 0) | (raw.faces >= len(raw.vertices)), axis=1))
    if len(bad):
        raise InvalidMeshError(
            f"must have faces of vertex numbers from 0 to {len(raw.vertices) - 1}, not of "
            f"{raw.faces[bad[0]].tolist()} as face {bad[0]}."
        )
    used = np.unique(raw.faces)
    bad = used[np.any(~np.isfinite(raw.vertices[used]), axis=1)]
    if len(bad):
        raise InvalidMeshError(
            f"must have vertices of finite numbers, not of {raw.vertices[bad[0]].tolist()} as vertex {bad[0]}."
        )
    lower, upper = raw.vertices[used].min(axis=0), raw.vertices[used].max(axis=0)
    with np.errstate(over="ignore"):  # an infinite size is rejected below
        extents = upper - lower
        size = float(np.linalg.norm(extents))
    if size == 0.0:
        raise InvalidMeshError("must enclose a volume, but is a single point.")
    if not SMALLEST_SIZE <= size <= LARGEST_SIZE:
        measures = " x ".join(f"{extent:.3g}" for extent in extents)
        cure = "by 0.001 if it is in millimetres" if size > LARGEST_SIZE else "by 1000 if it was scaled down twice"
        raise MeshUnitsError(
            f"must have a diagonal from {SMALLEST_SIZE:g} to {LARGEST_SIZE:g} m, not {size:.3g} m; it measures "
            f"{measures} m. Scale it {cure}: `scale=`, `--scale`, or `scale:` in a library.yaml."
        )
    distance = float(np.linalg.norm(0.5 * (lower + upper)))
    if distance > FARTHEST * size:
        raise InvalidMeshError(
            f"must lie at most {FARTHEST:g} times its size from the origin of its frame, not {distance / size:.3g} "
            f"times, {distance:.3g} m. Move it near the origin."
        )
    return size


def _connect(vertices: FloatArray, faces: IntArray, size: float, repairs: list[str]) -> tuple[FloatArray, IntArray]:
    """Merges duplicate vertices and makes the mesh manifold; wider cracks are welded if that closes the mesh."""
    vertices, faces = _merge(vertices, faces, _MERGE_DISTANCE * size)
    stated: list[str] = []
    connected = _make_manifold(vertices, faces, stated)
    if len(mesh_topology.link_faces(connected[1]).open):
        for share in _WELD_DISTANCES:
            welded_stated: list[str] = []
            welding = _weld(vertices, faces, share * size)
            try:
                welded = None if welding is None else _make_manifold(*welding, welded_stated)
            except InvalidMeshError:
                continue
            if welded is not None and not len(mesh_topology.link_faces(welded[1]).open):
                repairs += [*welded_stated, f"welded cracks up to {1e6 * share * size:.2g} um wide"]
                return welded
    repairs += stated
    return connected


def _merge(vertices: FloatArray, faces: IntArray, distance: float) -> tuple[FloatArray, IntArray]:
    """Merges vertices that round to the same multiple of `distance`; drops unused ones."""
    used = np.unique(faces)
    cell = np.round((vertices[used] - vertices[used].min(axis=0)) / distance).astype(np.int64)
    order = np.lexsort(cell.T)
    new = np.concatenate([[True], np.any(np.diff(cell[order], axis=0) != 0, axis=1)])
    index = np.empty(len(used), dtype=np.int64)
    index[order] = np.cumsum(new) - 1
    everywhere = np.zeros(len(vertices), dtype=np.int64)
    everywhere[used] = index
    return vertices[used[order[new]]], everywhere[faces]


def _weld(vertices: FloatArray, faces: IntArray, distance: float) -> tuple[FloatArray, IntArray] | None:
    """Merges vertices that chains of steps up to `distance` connect; None if there are too many such pairs."""
    tree = scipy.spatial.cKDTree(vertices)
    if tree.count_neighbors(tree, distance) > _MOST_NEIGHBOURS * len(vertices):
        return None
    label = mesh_topology.connected(len(vertices), *tree.query_pairs(distance, output_type="ndarray").T)
    first = np.unique(label, return_index=True)[1]
    return vertices[first], label[faces]


def _make_manifold(vertices: FloatArray, faces: IntArray, repairs: list[str]) -> tuple[FloatArray, IntArray]:
    """Removes degenerate and repeated faces, makes orientations consistent, and separates bodies that touch."""
    collapsed = np.any(faces == np.roll(faces, 1, axis=1), axis=1)
    if collapsed.any():
        repairs.append(f"removed {counted(collapsed.sum(), 'face', 'faces')} with two corners in one place")
        faces = faces[~collapsed]
        if not len(faces):
            raise InvalidMeshError("must have faces with an area, but all are degenerate.")
    faces = _without_repeated_faces(faces, repairs)
    links = mesh_topology.link_faces(faces)
    faces, turned = mesh_topology.agree_on_sides(faces, links.pairs)
    if turned:
        repairs.append(f"turned {counted(turned, 'face', 'faces')} to show the same side as the others")
        links = mesh_topology.link_faces(faces)
    pairs = links.pairs
    if links.crowded:
        resolved = [mesh_topology.pair_around_edge(vertices, faces, crowd) for crowd in links.crowded]
        pairs = np.concatenate([pairs, *resolved])
        repairs.append(f"separated bodies that touch along {counted(len(resolved), 'edge', 'edges')}")
    half_edges = mesh_topology.edge_labels(len(faces), pairs)
    faces, old = mesh_topology.split_vertices(faces, pairs)
    return (
        mesh_topology.split_repeated_edges(vertices[old], faces, half_edges)
        if links.crowded
        else (vertices[old], faces)
    )


def _without_repeated_faces(faces: IntArray, repairs: list[str]) -> IntArray:
    """Drops faces that repeat an earlier one, and the second sides of doubled sheets that are no two bodies' faces."""
    first_corner = np.argmin(faces, axis=1)
    rolled = np.take_along_axis(faces, (first_corner[:, None] + np.arange(3)) % 3, axis=1)
    _, kept = np.unique(rolled, axis=0, return_index=True)
    faces = faces[np.sort(kept)]
    faces = faces[~mesh_topology.second_sides(faces)]
    dropped = len(rolled) - len(faces)
    if dropped:
        repairs.append(f"removed {counted(dropped, 'repeated face', 'repeated faces')}")
    return faces


def _compact(vertices: FloatArray, faces: IntArray) -> tuple[FloatArray, IntArray]:
    """Drops unused vertices."""
    used, index = np.unique(faces, return_inverse=True)
    return vertices[used], index.reshape(-1, 3).astype(np.int64)
