"""Triangle meshes from files, in the formats of meshes that trimesh reads, or from trimesh's own objects.

Sizes are limited before the work: the file's size, the unpacked size of an archive, and the numbers of parts, vertices
and faces with every instance counted. A mesh file may refer only to buffers in its own folder or below.

Collada (dae, zae) and 3MF files state the unit of their numbers (millimetres by 3MF's specification if a file names
none), and are converted to metres. Files of other formats, and trimesh's own objects, are assumed to be in metres.

trimesh takes most of a second to load. This is deferred until a mesh must be read with it, which is not the case for a
file with a cached model, nor for plain OBJ files.
"""

from __future__ import annotations

import logging
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.mesh.mesh_documents import check_document
from tactopose_drake.core.mesh.plain_obj import LARGEST_PLAIN, plain_obj
from tactopose_drake.core.validation import FloatArray, kind_name, shown
from tactopose_drake.errors import InvalidFileError, InvalidInputError, InvalidMeshError, UnknownNameError

if TYPE_CHECKING:
    import trimesh

LARGEST_FILE = 256 * 2**20
"""Largest size of a mesh file, of the unpacked content of an archive, and of a buffer it refers to, bytes."""

MOST_FACES = 2_000_000
MOST_VERTICES = 3 * MOST_FACES

_FORMATS = (".3mf", ".dae", ".glb", ".gltf", ".obj", ".off", ".ply", ".stl", ".xaml", ".zae")
_WITH_MATERIALS = (".glb", ".gltf", ".obj", ".ply")  # whose readers can skip materials
_WITH_UNITS = (".3mf", ".dae", ".zae")  # whose files state the unit of their numbers
_LONGEST_REASON = 300

# Errors already contain what a reader fails on; without a handler it would also print a traceback.
logging.getLogger("trimesh").addHandler(logging.NullHandler())

MeshSource: TypeAlias = "str | Path | trimesh.Trimesh | trimesh.Scene"


@dataclass(frozen=True, eq=False)
class RawMesh:
    """The triangles of a source, unchecked.

    Attributes:
        vertices: shape (v, 3), m where the source states its unit, otherwise in the unit of the source.
        faces: vertex indices, shape (f, 3).
    """

    vertices: FloatArray
    faces: NDArray[np.int64]


def mesh_name(source: MeshSource) -> str:
    """The object's name: the file's name without its ending, or "mesh"."""
    return Path(source).stem if isinstance(source, str | Path) else "mesh"


def mesh_file(source: str | Path) -> Path:
    """The path of a mesh file that exists and whose format is known.

    Raises:
        InvalidFileError: if there is no such file, or it is a folder.
        UnknownNameError: if there is no reader for the file name's ending.
    """
    try:
        path = Path(source).expanduser()
        there, is_folder = path.is_file(), path.is_dir()
    except (OSError, RuntimeError, ValueError) as error:  # too long, no such home, or an invalid character
        reason = getattr(error, "strerror", None) or error
        raise InvalidFileError(f"mesh must be a file's path, not {shown(str(source))} ({reason}).") from None
    if is_folder:
        raise InvalidFileError(f"{path} must be a file, not a folder.")
    if not there:
        raise InvalidFileError(f"{path}: there is no such file.")
    if path.suffix.lower() not in _FORMATS:
        raise UnknownNameError(f"{path}: the mesh format", path.suffix, _FORMATS)
    size = path.stat().st_size
    if size > LARGEST_FILE:
        raise InvalidFileError(f"{path} must have at most {LARGEST_FILE} bytes, not {size}.")
    return path


def load_mesh(source: MeshSource) -> RawMesh:
    """Reads a mesh file, or converts a mesh or a scene (its meshes placed and joined).

    A file that states its unit (dae, zae, 3mf) is converted to metres.

    Raises:
        InvalidFileError: if a file is missing, too large, cannot be read as a mesh, or states a unit that is none.
        InvalidMeshError: if there are too many faces or vertices.
        UnknownNameError: if a file's format cannot be read.
        InvalidInputError: if the source is of another type.
    """
    if isinstance(source, str | Path):
        return _read(mesh_file(source))
    import trimesh

    if isinstance(source, trimesh.Scene | trimesh.Trimesh):
        return _joined(source, "mesh")
    raise InvalidInputError(
        f"mesh must be a file's path, a trimesh.Trimesh or a trimesh.Scene, not {kind_name(type(source))}."
    )


def _read(path: Path) -> RawMesh:
    """Reads a file with trimesh's reader for its format, or with that for plain OBJ files, which gives the same.

    The readers raise arbitrary errors while parsing, and numpy warns of numbers that overflow: both mean just that the
    file is damaged.
    """
    ending = path.suffix.lower()
    try:
        if ending == ".obj" and path.stat().st_size <= LARGEST_PLAIN:
            plain = plain_obj(path.read_bytes())
            if plain is not None:
                _check_counts(str(path), faces=len(plain[1]), vertices=len(plain[0]))
                return RawMesh(*plain)
        import trimesh

        from tactopose_drake.core.mesh.mesh_references import ReferencedFiles

        options: dict[str, Any] = {"skip_materials": True} if ending in _WITH_MATERIALS else {}
        check_document(path, LARGEST_FILE)
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            with path.open("rb") as file:
                scene = trimesh.load_scene(
                    file,
                    file_type=ending[1:],
                    resolver=ReferencedFiles(path.parent, LARGEST_FILE if ending == ".gltf" else 0),
                    process=False,
                    **options,
                )
            mesh = _joined(scene, str(path))
            return _in_metres(mesh, scene.units, path) if ending in _WITH_UNITS else mesh
    except InvalidInputError:
        raise
    except Exception as error:
        reason = " ".join(f"{type(error).__name__}: {error}".split())
        if len(reason) > _LONGEST_REASON:
            reason = f"{reason[:_LONGEST_REASON]}..."
        raise InvalidFileError(f"{path} cannot be read as a mesh ({reason}).") from error


def _in_metres(mesh: RawMesh, unit: str | None, path: Path) -> RawMesh:
    """Converts a file's triangles to metres from its unit, by trimesh's name; None stays as it is."""
    from trimesh.units import unit_conversion

    if unit is None:
        return mesh
    try:
        metres = unit_conversion(unit, "meters")
    except ValueError:
        metres = np.nan
    if not 0.0 < metres < np.inf:
        raise InvalidFileError(f"{path}: the unit must be one of length, such as millimeter, not {shown(unit)}.")
    return RawMesh(metres * mesh.vertices, mesh.faces)


def _check_counts(name: str, faces: int, vertices: int) -> None:
    for what, count, most in (("faces", faces, MOST_FACES), ("vertices", vertices, MOST_VERTICES)):
        if count > most:
            raise InvalidMeshError(f"{name} must have at most {most} {what}, not {count}.")


def _joined(source: trimesh.Trimesh | trimesh.Scene, name: str) -> RawMesh:
    """The triangles of a mesh, or of a scene's meshes, placed; their number is checked before anything is joined."""
    import trimesh

    if isinstance(source, trimesh.Scene):
        placed = [source.geometry[source.graph[node][1]] for node in source.graph.nodes_geometry]
        meshes = [mesh for mesh in placed if isinstance(mesh, trimesh.Trimesh)]
    else:
        meshes = [source]
    faces, vertices = (sum(len(getattr(mesh, what)) for mesh in meshes) for what in ("faces", "vertices"))
    _check_counts(name, faces, vertices)
    mesh = source.to_mesh() if isinstance(source, trimesh.Scene) else source
    return RawMesh(
        np.array(mesh.vertices, dtype=np.float64).reshape(-1, 3), np.array(mesh.faces, dtype=np.int64).reshape(-1, 3)
    )
