"""The meshes with which an object is drawn: a smooth solid, and a wireframe."""

from collections.abc import Sequence

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from tactopose_drake.core.poses import axes_across
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import FloatArray

CREASE = np.radians(35.0)
"""Edges sharper than this stay sharp when a surface is shaded."""

_MOST_FACES = 20000  # larger meshes are simplified for display
_EDGE = np.radians(60.0)  # edges sharper than this are wires
_MIDDLE, _END = 0.5001, 0.02  # places of sections along each axis; not 0.5, where planes may pass through many vertices
_RINGS = 0.26, 0.74  # places of further sections along the longest axis
_CAP = 0.4  # sections smaller than this share of the middle section's area are not drawn
_STEP = 0.03  # longest straight piece of a wire, as a share of the object's size
_BEND = np.cos(np.radians(12.0))  # a wire that bends more has a corner
_WIRE = 0.0025  # radius of a wire, as a share of the object's size
_THINNEST, _THICKEST = 0.0003, 0.0005  # limits of the radius of a wire, m
_DOUBLE = 0.04  # rings nearer than this share of the object's size are the two sides of one wall

Mesh = tuple[FloatArray, NDArray[np.int32]]


def smooth_mesh(model: ObjectModel) -> Mesh:
    """Vertices (v, 3), m, and faces (f, 3) in O, split at sharp edges, so that averaged normals shade it smoothly."""
    vertices, faces = simplified(model.vertices, model.faces, _MOST_FACES)
    shaded = trimesh.graph.smooth_shade(trimesh.Trimesh(vertices, faces, process=False), angle=CREASE)
    return np.array(shaded.vertices), np.array(shaded.faces, dtype=np.int32)


def wire_cage(model: ObjectModel) -> Mesh:
    """A wireframe in O: the object's sharp edges, and sections at its middle, its ends and along its longest axis."""
    vertices, faces = simplified(model.vertices, model.faces, _MOST_FACES)
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    longest = int(np.argmax(high - low))
    cuts = [(axis, share) for axis in range(3) for share in (_MIDDLE, _END, 1.0 - _END)]
    cuts += [(longest, share) for share in _RINGS]
    edges, apart, middle = _edges(mesh), _DOUBLE * model.size, np.zeros(3)
    pieces, drawn = [edges], [edges.reshape(-1, 3)] if len(edges) else []
    for axis, share in cuts:
        at = low[axis] + share * (high[axis] - low[axis])
        section = mesh.section(plane_origin=np.eye(3)[axis] * at, plane_normal=np.eye(3)[axis])
        lines = [] if section is None else _outer_sides(section.discrete, drawn, apart)
        if share == _MIDDLE:
            middle[axis] = max((_area(line, axis) for line in lines), default=0.0)
        # If a plane only cuts a cap off a bulge, the section does not show the object's shape.
        lines = [line for line in lines if _area(line, axis) > _CAP * middle[axis]]
        pieces += [_straightened(line, _STEP * model.size) for line in lines]
    return _tubes(np.concatenate(pieces), float(np.clip(_WIRE * model.size, _THINNEST, _THICKEST)))


def simplified(vertices: FloatArray, faces: NDArray[np.int32], most_faces: int) -> Mesh:
    """A mesh whose vertices are merged in the cells of a grid until it has at most `most_faces` faces."""
    extent = float(np.ptp(vertices, axis=0).max())
    cells = 256.0
    found = vertices, faces.astype(np.int32)
    while len(found[1]) > most_faces:
        key = np.floor((vertices - vertices.min(axis=0)) / (extent / cells)).astype(np.int64)
        _, owner, count = np.unique(key, axis=0, return_inverse=True, return_counts=True)
        joined = np.zeros((len(count), 3))
        np.add.at(joined, owner.ravel(), vertices)
        corner = owner.ravel()[faces]
        whole = (corner[:, 0] != corner[:, 1]) & (corner[:, 1] != corner[:, 2]) & (corner[:, 2] != corner[:, 0])
        _, first = np.unique(np.sort(corner[whole], axis=1), axis=0, return_index=True)
        found = joined / count[:, None], corner[whole][first].astype(np.int32)
        cells *= 0.8
    return found


def _edges(mesh: trimesh.Trimesh) -> FloatArray:
    """The mesh's sharp edges as segments, shape (n, 2, 3)."""
    sharp = mesh.face_adjacency_edges[mesh.face_adjacency_angles > _EDGE]
    segments: FloatArray = np.asarray(mesh.vertices)[sharp].reshape(-1, 2, 3)
    return segments


def _outer_sides(lines: Sequence[FloatArray], drawn: list[FloatArray], apart: float) -> list[FloatArray]:
    """Polylines (n, 3), the widest first, without those that stay nearer than `apart` to a drawn or a wider one."""
    kept: list[FloatArray] = []
    for line in sorted(lines, key=lambda points: -float(np.linalg.norm(np.ptp(points, axis=0)))):
        if not any(np.max(cKDTree(other).query(line)[0]) < apart for other in (*drawn, *kept)):
            kept.append(line)
    return kept


def _area(line: FloatArray, axis: int) -> float:
    """Area of the bounding rectangle, across an axis, of a polyline (n, 3), m^2."""
    return float(np.prod(np.delete(np.ptp(line, axis=0), axis)))


def _straightened(line: FloatArray, step: float) -> FloatArray:
    """The segments of a polyline (n, 3) without the points on its straight parts, shape (m, 2, 3)."""
    kept = [0]
    for row in range(1, len(line) - 1):
        before, after = line[row] - line[kept[-1]], line[row + 1] - line[row]
        lengths = np.linalg.norm(before) * np.linalg.norm(after)
        if np.linalg.norm(line[row + 1] - line[kept[-1]]) > step or before @ after < _BEND * lengths:
            kept.append(row)
    points = line[[*kept, len(line) - 1]]
    return np.stack([points[:-1], points[1:]], axis=1)


def _tubes(segments: FloatArray, radius: float) -> Mesh:
    """Three-sided prisms around segments (n, 2, 3)."""
    along = segments[:, 1] - segments[:, 0]
    length = np.linalg.norm(along, axis=1)
    segments, along = segments[length > 1e-9], along[length > 1e-9] / length[length > 1e-9, None]
    side, other = axes_across(along)
    angles = 2.0 * np.pi * np.arange(3) / 3
    around = radius * (np.cos(angles)[:, None, None] * side + np.sin(angles)[:, None, None] * other)
    # The prisms are slightly longer than the segments, so that there are no gaps at corners.
    ends = segments + 0.5 * radius * np.stack([-along, along], axis=1)
    vertices = (ends[:, :, None] + around.transpose(1, 0, 2)[:, None]).reshape(-1, 3)
    sides = np.array(
        [[k, (k + 1) % 3, 3 + k] for k in range(3)] + [[(k + 1) % 3, 3 + (k + 1) % 3, 3 + k] for k in range(3)]
    )
    faces = (sides[None] + 6 * np.arange(len(segments))[:, None, None]).reshape(-1, 3)
    return vertices, faces.astype(np.int32)
