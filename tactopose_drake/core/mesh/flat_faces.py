"""Removes faces without area from a closed mesh, which stays closed.

If two corners coincide up to rounding, they are merged. Otherwise such a face has a corner on its longest edge.
Flipping this edge, so that it runs from that corner to the opposite corner of the adjacent face, leaves two faces that
cover the same surface.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.mesh.bodies import face_areas
from tactopose_drake.core.mesh.topology import IntArray, half_edges
from tactopose_drake.core.plain_values import counted
from tactopose_drake.core.validation import FloatArray
from tactopose_drake.errors import InvalidMeshError

# Tolerances for rounding.
_FLAT_FACE = 1e-14  # area as a share of the squared size
_ONE_PLACE = 1e-6  # length as a share of the size
_MOST_ROUNDS = 60  # after which a mesh is rejected: edges may be flipped back and forth without end


def without_flat_faces(vertices: FloatArray, faces: IntArray, size: float, repairs: list[str]) -> IntArray:
    """Removes the faces without area from a closed mesh; states what was done.

    Args:
        vertices: shape (v, 3), m.
        faces: shape (f, 3); every edge belongs to two faces, once in each direction.
        size: diagonal of the mesh's box, m.
        repairs: the statement is appended to it.

    Raises:
        InvalidMeshError: if some cannot be removed.
    """
    flat = _flat(vertices, faces, size)
    count = int(flat.sum())
    if not count:
        return faces
    for _ in range(_MOST_ROUNDS):
        fewer = _merge_short_edges(vertices, faces, flat, size)
        turned = _flip_longest_edges(vertices, faces, flat) if fewer is None else fewer
        if turned is None or not len(turned):
            break
        faces = turned
        flat = _flat(vertices, faces, size)
        if not flat.any():
            repairs.append(f"removed {counted(count, 'face', 'faces')} without area")
            return faces
    place = np.round(vertices[faces[flat][0]].mean(axis=0), 4).tolist()
    raise InvalidMeshError(
        f"must have faces whose corners do not lie on one line, but {int(flat.sum())}, one of them at {place} m, have "
        "no area and cannot be removed."
    )


def _flat(vertices: FloatArray, faces: IntArray, size: float) -> NDArray[np.bool_]:
    flat: NDArray[np.bool_] = face_areas(vertices, faces) <= _FLAT_FACE * size**2
    return flat


def _flip_longest_edges(vertices: FloatArray, faces: IntArray, flat: NDArray[np.bool_]) -> IntArray | None:
    """Flips the longest edges of flat faces, with each face changed at most once; None if there is none to flip."""
    start, end = half_edges(faces)
    stride = int(faces.max()) + 1
    code = start * stride + end
    order = np.argsort(code)
    candidates = np.flatnonzero(flat)
    corners = vertices[faces[candidates]]
    length = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
    edge = 3 * candidates + np.argmax(length, axis=1)
    beyond = order[np.searchsorted(code[order], end[edge] * stride + start[edge])]
    a, b = start[edge], end[edge]
    corner, far = _opposite(faces, edge), _opposite(faces, beyond)
    new = np.minimum(corner, far) * stride + np.maximum(corner, far)
    exists = np.isin(corner * stride + far, code) | np.isin(far * stride + corner, code) | (corner == far)
    result = faces.copy()
    touched: set[int] = set()
    made: set[int] = set()
    for n in np.flatnonzero(~exists):
        face, other = int(edge[n]) // 3, int(beyond[n]) // 3
        if face in touched or other in touched or int(new[n]) in made:
            continue
        touched |= {face, other}
        made.add(int(new[n]))
        result[face] = corner[n], a[n], far[n]
        result[other] = b[n], corner[n], far[n]
    return result if touched else None


def _opposite(faces: IntArray, half_edge: IntArray) -> IntArray:
    """The corners opposite to half edges in their faces."""
    opposite: IntArray = faces[half_edge // 3, (half_edge + 2) % 3]
    return opposite


def _merge_short_edges(vertices: FloatArray, faces: IntArray, flat: NDArray[np.bool_], size: float) -> IntArray | None:
    """Collapses edges of flat faces without length, no two of them adjacent; None if there is none to collapse.

    Two vertices may be merged if their only common neighbours are those of the edge's two faces.
    """
    corners = faces[flat]
    length = np.linalg.norm(vertices[np.roll(corners, -1, axis=1)] - vertices[corners], axis=2)
    short = length <= _ONE_PLACE * size
    edges = np.stack([corners[short], np.roll(corners, -1, axis=1)[short]], axis=1)
    neighbours: dict[int, set[int]] = {}
    for face in faces[np.isin(faces, edges).any(axis=1)].tolist():
        for vertex in face:
            neighbours.setdefault(vertex, set()).update(face)
    merged_into = np.arange(len(vertices))
    touched: set[int] = set()
    for kept, merged in edges.tolist():
        common, around = neighbours[kept] & neighbours[merged], neighbours[kept] | neighbours[merged]
        if len(common) == 4 and not around & touched:
            merged_into[merged] = kept
            touched |= around
    if not touched:
        return None
    moved = merged_into[faces]
    left: IntArray = moved[~np.any(moved == np.roll(moved, 1, axis=1), axis=1)]
    return left
