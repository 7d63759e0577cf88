"""Triangle meshes from files, in any format trimesh reads, or from trimesh's own objects."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray

from tactopose_drake.core.validation import FloatArray
from tactopose_drake.errors import InvalidFileError, InvalidInputError, UnknownNameError

MeshSource = str | Path | trimesh.Trimesh | trimesh.Scene


@dataclass(frozen=True, eq=False)
class RawMesh:
    """The triangles of a source as they are, nothing checked.

    Attributes:
        vertices: shape (v, 3).
        faces: vertex indices, shape (f, 3).
    """

    vertices: FloatArray
    faces: NDArray[np.int64]


def mesh_name(source: MeshSource) -> str:
    """What to call the object: the file's name without its ending, or "mesh"."""
    return Path(source).stem if isinstance(source, str | Path) else "mesh"


def mesh_file(source: str | Path) -> Path:
    """The path of a mesh file that exists and whose format is known.

    Raises:
        InvalidFileError: if there is no such file.
        UnknownNameError: if no reader is known for the file name's ending.
    """
    path = Path(source).expanduser()
    if not path.is_file():
        raise InvalidFileError(f"{path}: there is no such file.")
    formats = {f for f in trimesh.available_formats() if "." not in f}
    if path.suffix.lower().lstrip(".") not in formats:
        raise UnknownNameError(f"{path}: mesh format", path.suffix, sorted(f".{name}" for name in formats))
    return path


def load_mesh(source: MeshSource) -> RawMesh:
    """Reads a mesh file, or takes over a mesh or a scene (its meshes placed and joined).

    Raises:
        InvalidFileError: if a file is missing or cannot be read as a mesh.
        UnknownNameError: if a file's format is not one that can be read.
        InvalidInputError: if the source is of another type.
    """
    if isinstance(source, trimesh.Scene):
        mesh = source.to_mesh()
    elif isinstance(source, trimesh.Trimesh):
        mesh = source
    elif isinstance(source, str | Path):
        path = mesh_file(source)
        try:
            mesh = trimesh.load_mesh(path, process=False)
        except Exception as error:  # the readers raise whatever their parsing stumbles over
            reason = f"{type(error).__name__}: {error}"
            raise InvalidFileError(f"{path}: cannot be read as a mesh ({reason}).") from error
    else:
        raise InvalidInputError(
            f"mesh: is a {type(source).__name__}; allowed are a file's path, a trimesh.Trimesh and a trimesh.Scene."
        )
    return RawMesh(
        np.array(mesh.vertices, dtype=np.float64).reshape(-1, 3), np.array(mesh.faces, dtype=np.int64).reshape(-1, 3)
    )
