"""The closed bodies of a mesh: finds which are inside out, cavities or debris, and unites those that overlap."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import manifold3d
import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.mesh import topology as mesh_topology
from tactopose_drake.core.mesh.topology import AnyIntArray, IntArray
from tactopose_drake.core.plain_values import counted
from tactopose_drake.core.validation import FloatArray
from tactopose_drake.errors import InvalidMeshError

_SAME = 1e-6  # relative tolerance of volumes and areas
_TOUCHING = 1e-9  # tolerance of gaps, as a share of the size
_SLIVER = 5e-13  # area of a degenerate face, as a share of all
# Limits beyond which time or memory would be exhausted.
_MOST_FACES_OF_UNION = 10  # as a multiple of the bodies' faces
_MOST_BODIES = 5000
_MOST_ENCLOSED_FACES = 20_000_000  # solid angles that are summed to find which body is inside which


@dataclass(frozen=True, kw_only=True)
class DebrisParams:
    """Which pieces of a mesh are debris."""

    share: float = 1e-3  # of the largest piece's volume, below which a piece is debris
    total_share: float = 1e-2  # of the total volume, above which such pieces together are not debris but the object


def cross_products(vertices: FloatArray, faces: AnyIntArray) -> FloatArray:
    """Outward normals of the faces, of length twice the area, shape (f, 3), m^2."""
    a, b, c = vertices[faces[:, 0]], vertices[faces[:, 1]], vertices[faces[:, 2]]
    cross: FloatArray = np.cross(b - a, c - a)
    return cross


def face_areas(vertices: FloatArray, faces: AnyIntArray) -> FloatArray:
    """Areas of the faces, shape (f,), m^2."""
    areas: FloatArray = 0.5 * np.linalg.norm(cross_products(vertices, faces), axis=1)
    return areas


def volumes(vertices: FloatArray, faces: AnyIntArray, body: IntArray | None = None) -> FloatArray:
    """Signed volume of each body, shape (bodies,), m^3; of all faces together, shape (1,), without labels."""
    corners = vertices[faces] - vertices[faces[0, 0]]
    signed = np.einsum("fi,fi->f", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6.0
    label = np.zeros(len(faces), dtype=np.int64) if body is None else body
    return np.bincount(label, weights=signed).astype(np.float64)


def is_debris(volume: FloatArray, params: DebrisParams) -> NDArray[np.bool_]:
    """Which pieces with these volumes (unsigned, m^3) are debris, shape (pieces,).

    None is if the small pieces together have much of the volume: then the object consists of them.
    """
    debris: NDArray[np.bool_] = volume < params.share * volume.max()
    if volume[debris].sum() > params.total_share * volume.sum():
        debris = volume == 0.0
    return debris


def arrange(
    vertices: FloatArray, faces: IntArray, repairs: list[str], params: DebrisParams = DebrisParams()
) -> tuple[FloatArray, IntArray]:
    """Turns closed bodies into one solid whose winding number is one inside and zero outside.

    Debris is dropped (see `is_debris`); inside-out bodies are flipped unless they are cavities (inside-out shells
    within a body); those that overlap, or touch along faces, are united, as nobody can touch the faces between them.
    Each step except for cavities is stated.

    Args:
        vertices: shape (v, 3), m.
        faces: closed, linked faces with consistent orientation, shape (f, 3).
        repairs: statements are appended to it.
        params: what is debris.

    Raises:
        InvalidMeshError: if there is no volume, there are too many bodies, or overlapping ones cannot be united.
    """
    body = mesh_topology.body_labels(faces)
    volume = volumes(vertices, faces, body)
    if not np.any(volume):
        raise InvalidMeshError("must enclose a volume, but is flat.")
    debris = is_debris(np.abs(volume), params)
    if len(volume) - debris.sum() > _MOST_BODIES:
        raise InvalidMeshError(f"must have at most {_MOST_BODIES} separate bodies, not {len(volume)}.")
    if debris.any():
        repairs.append(
            f"dropped {counted(debris.sum(), 'separate piece', 'separate pieces')} of less than "
            f"{100 * params.share:g} % of the volume"
        )
        faces = faces[~debris[body]]
        body = mesh_topology.body_labels(faces)
        volume = volumes(vertices, faces, body)
    parents = _enclosing_bodies(vertices, faces, body)
    inverted = _inverted(volume, parents)
    if inverted.any():
        bodies = "the mesh" if inverted.all() else counted(inverted.sum(), "body", "bodies")
        repairs.append(f"flipped {bodies}, turned inside out")
        faces = np.where(inverted[body][:, None], faces[:, ::-1], faces)
        volume = np.where(inverted, -volume, volume)
    solids = np.flatnonzero(volume > 0)
    if len(solids) > 1:
        united = _unite(vertices, faces, body, volume, parents)
        if united is not None:
            repairs.append(f"united {len(solids)} {united.kind} bodies")
            return united.vertices, united.faces
        repairs.append(f"kept {len(solids)} separate bodies as one rigid object")
    return vertices, faces


def without_cavities(vertices: FloatArray, faces: IntArray, repairs: list[str]) -> IntArray:
    """Drops the faces (f, 3) of bodies within others: the walls of sealed cavities, and what is in these.

    Args:
        vertices: shape (v, 3), m.
        faces: of separate bodies and their cavities, as `arrange` leaves them.
        repairs: a statement is appended to it if there are cavities.
    """
    body = mesh_topology.body_labels(faces)
    is_within = np.array([len(enclosing) > 0 for enclosing in _enclosing_bodies(vertices, faces, body)])
    if not is_within.any():
        return faces
    cavities = int(np.count_nonzero(volumes(vertices, faces, body)[is_within] < 0.0))
    repairs.append(f"left out the walls of {counted(cavities, 'sealed cavity', 'sealed cavities')}")
    outside: IntArray = faces[~is_within[body]]
    return outside


def _inverted(volume: FloatArray, parents: list[IntArray]) -> NDArray[np.bool_]:
    """Which bodies are inside out: those at even depth, outermost or within a cavity, should have positive volume.

    A mesh that is inside out as a whole is flipped as a whole, so that its cavities stay cavities.
    """
    whole = volume.sum() < 0
    sign = np.where(whole, -volume, volume)
    depth = np.array([len(enclosing) for enclosing in parents])
    flip = (sign < 0) & (depth % 2 == 0)
    result: NDArray[np.bool_] = flip ^ whole
    return result


def _faces_of_bodies(body: IntArray) -> list[NDArray[np.intp]]:
    """Indices of the faces of each body, from each face's body."""
    return np.split(np.argsort(body, kind="stable"), np.cumsum(np.bincount(body))[:-1])


def _enclosing_bodies(vertices: FloatArray, faces: IntArray, body: IntArray) -> list[IntArray]:
    """For each body, the bodies that enclose a point of it, by winding number.

    Raises:
        InvalidMeshError: if so many bounding boxes are nested that it would take too long.
    """
    count = int(body.max()) + 1
    if count == 1:
        return [np.empty(0, dtype=np.int64)]
    lower, upper = _boxes(vertices, faces, body)
    boxes = [np.flatnonzero(np.all((lower < lower[n]) & (upper > upper[n]), axis=1)) for n in range(count)]
    of_body = _faces_of_bodies(body)
    work = sum(len(of_body[outer]) for outers in boxes for outer in outers)
    if work > _MOST_ENCLOSED_FACES:
        raise InvalidMeshError(f"has {count} bodies, too many of them within others to tell which are cavities.")
    enclosing = []
    for inner in range(count):
        point = vertices[faces[of_body[inner][0]]].mean(axis=0)
        found = [outer for outer in boxes[inner] if abs(_winding_number(point, vertices, faces[of_body[outer]])) > 0.5]
        enclosing.append(np.array(found, dtype=np.int64))
    return enclosing


def _boxes(vertices: FloatArray, faces: IntArray, body: IntArray) -> tuple[FloatArray, FloatArray]:
    """Lower and upper corners of the bodies' bounding boxes, each of shape (bodies, 3), m."""
    count = int(body.max()) + 1
    lower, upper = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    for corner in range(3):
        np.minimum.at(lower, body, vertices[faces[:, corner]])
        np.maximum.at(upper, body, vertices[faces[:, corner]])
    return lower, upper


def _winding_number(point: FloatArray, vertices: FloatArray, faces: IntArray) -> float:
    """How often a closed surface winds around a point: the sum of its faces' solid angles over 4 pi."""
    a, b, c = np.moveaxis(vertices[faces] - point, 1, 0)
    la, lb, lc = (np.linalg.norm(corner, axis=1) for corner in (a, b, c))
    triple = np.einsum("fi,fi->f", a, np.cross(b, c))
    dots = la * lb * lc + np.sum(a * b, axis=1) * lc + np.sum(b * c, axis=1) * la + np.sum(c * a, axis=1) * lb
    return float(np.arctan2(triple, dots).sum() / (2 * np.pi))


class _United(NamedTuple):
    """The mesh of a union, and the relation of its bodies: "overlapping", or "touching" along faces."""

    vertices: FloatArray
    faces: IntArray
    kind: str


def _unite(
    vertices: FloatArray, faces: IntArray, body: IntArray, volume: FloatArray, parents: list[IntArray]
) -> _United | None:
    """The union of the solids, each without its cavities; None if they are separate already."""
    solids = np.flatnonzero(volume > 0)
    lower, upper = _boxes(vertices, faces, body)
    upper = upper + _TOUCHING * float(np.ptp(vertices[faces], axis=(0, 1)).max())
    if all(
        np.count_nonzero(np.all((lower[solids] < upper[n]) & (upper[solids] > lower[n]), axis=1)) == 1 for n in solids
    ):
        return None
    # A cavity belongs to the smallest solid around it.
    shells = {int(solid): [int(solid)] for solid in solids}
    for cavity in np.flatnonzero(volume < 0):
        around = [int(outer) for outer in parents[cavity] if volume[outer] > 0]
        if not around:
            raise InvalidMeshError("has a body that is turned inside out, and none around it whose cavity it could be.")
        shells[min(around, key=lambda outer: volume[outer])].append(int(cavity))
    of_body = _faces_of_bodies(body)
    parts = [_manifold(vertices, faces[np.concatenate([of_body[n] for n in shell])]) for shell in shells.values()]
    union = _union(parts)
    if union.status() != manifold3d.Error.NoError or union.is_empty():
        raise InvalidMeshError(f"has overlapping bodies that cannot be united ({union.status().name}).")
    overlap = abs(union.volume() - volume.sum()) > _SAME * volume.sum()
    area = float(face_areas(vertices, faces).sum())
    if not overlap and union.surface_area() >= (1.0 - _SAME) * area:
        return None
    mesh = union.to_mesh64()
    united = _United(
        np.array(mesh.vert_properties[:, :3]),
        np.array(mesh.tri_verts).astype(np.int64),
        "overlapping" if overlap else "touching",
    )
    # Faces that coincide up to rounding may leave slivers: such bodies are not united.
    slivers = face_areas(united.vertices, united.faces) <= _SLIVER * area
    return None if not overlap and slivers.any() else united


def _union(parts: list[manifold3d.Manifold]) -> manifold3d.Manifold:
    """The union of solids, computed pairwise.

    Raises:
        InvalidMeshError: if it has so many faces that the bodies must intersect themselves all over.
    """
    most = _MOST_FACES_OF_UNION * sum(part.num_tri() for part in parts)
    while len(parts) > 1:
        united = [a + b for a, b in zip(parts[::2], parts[1::2], strict=False)]
        parts = united + parts[len(united) * 2 :]
        if sum(part.num_tri() for part in parts) > most:
            raise InvalidMeshError(
                "has overlapping bodies that pass through themselves, so that they cannot be united."
            )
    return parts[0]


def _manifold(vertices: FloatArray, faces: IntArray) -> manifold3d.Manifold:
    """Converts a body for boolean operations.

    Raises:
        InvalidMeshError: if it is rejected.
    """
    used, index = np.unique(faces, return_inverse=True)
    solid = manifold3d.Manifold(
        manifold3d.Mesh64(np.ascontiguousarray(vertices[used]), index.reshape(faces.shape).astype(np.uint64))
    )
    if solid.status() != manifold3d.Error.NoError:
        raise InvalidMeshError(f"has overlapping bodies, one of which cannot be united ({solid.status().name}).")
    return solid
