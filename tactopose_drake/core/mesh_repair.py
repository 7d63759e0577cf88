"""From a mesh file or object to a closed, consistently oriented mesh in metres: loaded, checked, repaired."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray

from tactopose_drake.core.validation import FloatArray
from tactopose_drake.errors import InvalidFileError, InvalidMeshError, MeshUnitsError

LARGEST_SIZE = 3.0
SMALLEST_SIZE = 0.002


class MeshRepairWarning(UserWarning):
    """A mesh that could be used only after the repair that the message states."""


@dataclass(frozen=True, eq=False)
class RepairedMesh:
    """A closed mesh and what was done to it.

    Attributes:
        vertices: shape (v, 3), m.
        faces: vertex indices, anticlockwise seen from outside, shape (f, 3); none of zero area.
        repairs: one sentence for each repair.
    """

    vertices: FloatArray
    faces: NDArray[np.int32]
    repairs: tuple[str, ...]


def load_mesh(source: str | Path | trimesh.Trimesh | trimesh.Scene) -> tuple[str, FloatArray, NDArray[np.int64]]:
    """The name, vertices (v, 3) and faces (f, 3) of a mesh file, mesh or scene (its meshes joined)."""
    if isinstance(source, trimesh.Scene):
        mesh = source.to_mesh()
        return "mesh", np.array(mesh.vertices, dtype=np.float64), np.array(mesh.faces, dtype=np.int64)
    if isinstance(source, trimesh.Trimesh):
        return "mesh", np.array(source.vertices, dtype=np.float64), np.array(source.faces, dtype=np.int64)
    path = Path(source)
    if not path.is_file():
        raise InvalidFileError(f"{path}: there is no such file.")
    try:
        mesh = trimesh.load_mesh(path, process=False)
    except Exception as error:
        raise InvalidFileError(f"{path}: cannot be read as a mesh ({error}).") from error
    return path.stem, np.array(mesh.vertices, dtype=np.float64), np.array(mesh.faces, dtype=np.int64)


def repair_mesh(vertices: FloatArray, faces: NDArray[np.int64], name: str = "mesh") -> RepairedMesh:
    """Checks a mesh and repairs what can be repaired."""
    if not len(faces):
        raise InvalidMeshError(f"{name}: has no faces.")
    if not np.all(np.isfinite(vertices[faces])):
        raise InvalidMeshError(f"{name}: has a vertex that is not a finite number.")
    size = float(np.linalg.norm(np.ptp(vertices[faces].reshape(-1, 3), axis=0)))
    if not SMALLEST_SIZE <= size <= LARGEST_SIZE:
        raise MeshUnitsError(f"{name}: has a bounding box diagonal of {size:g} m.")
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    mesh.merge_vertices(merge_tex=True, merge_norm=True)
    mesh.update_faces(mesh.area_faces > 1e-14 * size**2)
    mesh.remove_unreferenced_vertices()
    if not mesh.is_watertight:
        raise InvalidMeshError(f"{name}: is open.")
    repairs = []
    if not mesh.is_winding_consistent:
        trimesh.repair.fix_winding(mesh)  # type: ignore[no-untyped-call]
        repairs.append("faces turned to agree with their neighbours")
    if mesh.volume < 0:
        mesh.invert()
        repairs.append("inside-out: all faces flipped")
    return RepairedMesh(np.array(mesh.vertices), np.array(mesh.faces, dtype=np.int32), tuple(repairs))
