"""Holes of open meshes: found, measured, and closed if inside and outside are distinguishable without the lids."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tactopose_drake.core.mesh import bodies as mesh_bodies
from tactopose_drake.core.mesh import topology as mesh_topology
from tactopose_drake.core.mesh.bodies import DebrisParams
from tactopose_drake.core.mesh.topology import IntArray
from tactopose_drake.core.mesh.winding_kernels import winding_numbers
from tactopose_drake.core.plain_values import counted
from tactopose_drake.core.validation import FloatArray
from tactopose_drake.errors import InvalidMeshError

_NO_AREA = 1e-9  # tolerance for rounding, as a share of the squared size
_STATED_HOLES = 5  # most holes listed in a message
_DEBRIS = DebrisParams()


@dataclass(frozen=True, kw_only=True)
class HoleParams:
    """When inside and outside are distinguishable without the lids."""

    agreement: float = 0.98  # share of the nodes near the surface at which views from six sides must agree
    voting_nodes: int = 200_000  # number of nodes of the grid that is evaluated


def close_holes(
    vertices: FloatArray,
    faces: IntArray,
    size: float,
    repairs: list[str],
    params: HoleParams = HoleParams(),
) -> tuple[FloatArray, IntArray]:
    """Closes every hole by a fan of faces around the centre of its rim; drops open pieces without volume.

    Raises:
        InvalidMeshError: if nothing encloses a volume, or inside and outside are not distinguishable.
    """
    if not len(mesh_topology.link_faces(faces).open):
        return vertices, faces
    faces = _without_open_debris(vertices, faces, repairs)
    loops, closed_vertices, closed_faces = _with_lids(vertices, faces)
    if not loops:
        return vertices, faces
    lid_of = closed_faces[len(faces) :, 2] - len(vertices)
    lid_area = mesh_bodies.face_areas(closed_vertices, closed_faces[len(faces) :])
    wide = np.bincount(lid_of, weights=lid_area) > _NO_AREA * size**2
    if not wide.all():
        repairs.append(
            f"closed {counted((~wide).sum(), 'crack', 'cracks')} without area, where an edge meets a vertex midway"
        )
    if wide.any():
        holes = _describe(vertices, [loop for loop, is_wide in zip(loops, wide, strict=True) if is_wide])
        agreement = _agreement(closed_vertices, faces, closed_faces, size, params.voting_nodes)
        if agreement < params.agreement:
            raise InvalidMeshError(
                f"is open, and inside cannot be told from outside: views from six sides must agree on at least "
                f"{100 * params.agreement:.0f} % of the surface, not {math.floor(100 * agreement)} %. {holes}."
            )
        repairs.append(f"closed the open mesh. {holes}")
    return closed_vertices, closed_faces


def _with_lids(vertices: FloatArray, faces: IntArray) -> tuple[list[IntArray], FloatArray, IntArray]:
    """The rims of all holes, and the mesh with a fan on each, whose centres are appended to the vertices."""
    loops = mesh_topology.boundary_loops(faces, mesh_topology.link_faces(faces).open)
    middles = [vertices[loop].mean(axis=0, keepdims=True) for loop in loops]
    lids = [
        np.stack([np.roll(loop, -1), loop, np.full(len(loop), len(vertices) + n)], axis=1)
        for n, loop in enumerate(loops)
    ]
    return loops, np.concatenate([vertices, *middles]), np.concatenate([faces, *lids])


def _without_open_debris(vertices: FloatArray, faces: IntArray, repairs: list[str]) -> IntArray:
    """Drops open pieces that are debris even with lids."""
    _, closed_vertices, closed_faces = _with_lids(vertices, faces)
    body = mesh_topology.body_labels(closed_faces)
    volume = np.abs(mesh_bodies.volumes(closed_vertices, closed_faces, body))
    debris = np.zeros(len(volume), dtype=bool)
    debris[body[len(faces) :]] = True
    debris &= mesh_bodies.is_debris(volume, _DEBRIS)
    if not np.any(volume):
        pieces = counted(len(volume), "piece", "pieces")
        raise InvalidMeshError(f"must enclose a volume, but of its {pieces} none does.")
    if debris.any():
        repairs.append(
            f"dropped {counted(debris.sum(), 'open piece', 'open pieces')} around less than "
            f"{100 * _DEBRIS.share:g} % of the volume"
        )
    return faces[~debris[body[: len(faces)]]]


def _describe(vertices: FloatArray, loops: list[IntArray]) -> str:
    """Lists the positions and sizes of the largest holes."""
    middles = [vertices[loop].mean(axis=0) for loop in loops]
    across = [_diameter(vertices[loop]) for loop in loops]
    largest = np.argsort(across)[::-1][:_STATED_HOLES]
    places = "; ".join(
        f"at {np.round(middles[n], 4).tolist()} m, {1e3 * across[n]:.3g} mm across, rim of {len(loops[n])} edges"
        for n in largest
    )
    more = f"; and {len(loops) - len(largest)} smaller" if len(loops) > len(largest) else ""
    return f"Holes: {places}{more}"


def _diameter(rim: FloatArray) -> float:
    """The approximate diameter of a rim with vertices (n, 3), m: from the vertex farthest from their centroid."""
    farthest = rim[np.argmax(np.linalg.norm(rim - rim.mean(axis=0), axis=1))]
    return float(np.linalg.norm(rim - farthest, axis=1).max())


def _agreement(vertices: FloatArray, faces: IntArray, closed_faces: IntArray, size: float, nodes: int) -> float:
    """The share of nodes near the surface at which five of the six axis directions agree on inside or outside.

    Each direction counts signed crossings from its far end. A hole corrupts the columns that pass through it in one
    direction; if the opposite side is open too, in both.
    """
    lower, upper = vertices.min(axis=0), vertices.max(axis=0)
    extent = upper - lower + 0.04 * size
    spacing = math.cbrt(np.prod(extent) / nodes)
    nx, ny, nz = (int(n) for n in np.ceil(extent / spacing) + 1)
    # Slightly shifted columns, which miss the vertices of regular meshes.
    origin = lower - 0.02 * size + spacing * np.array([1.3e-4, 2.7e-4, 1.9e-4])
    body = mesh_topology.body_labels(closed_faces)
    inverted = mesh_bodies.volumes(vertices, closed_faces, body)[body[: len(faces)]] < 0
    outward = np.where(inverted[:, None], faces[:, ::-1], faces).astype(np.int32)
    votes = np.zeros((nx, ny, nz), dtype=np.int64)
    near = np.zeros((nx, ny, nz), dtype=bool)
    for axis in range(3):
        turn = [(axis + 1) % 3, (axis + 2) % 3, axis]
        shape = ((nx, ny, nz)[turn[0]], (nx, ny, nz)[turn[1]], (nx, ny, nz)[turn[2]])
        winding, rest = winding_numbers(np.ascontiguousarray(vertices[:, turn]), outward, origin[turn], spacing, shape)
        back = np.argsort(turn)
        from_below = (winding >= 1).transpose(back)
        from_above = (winding - rest[..., None] >= 1).transpose(back)
        votes += from_below
        votes += from_above
        crossing = np.diff(winding, axis=2) != 0
        near |= np.pad(crossing, [(0, 0), (0, 0), (0, 1)]).transpose(back)
        near |= np.pad(crossing, [(0, 0), (0, 0), (1, 0)]).transpose(back)
    return float(np.mean((votes >= 5) | (votes <= 1), where=near)) if near.any() else 0.0
