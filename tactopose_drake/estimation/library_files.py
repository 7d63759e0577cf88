"""The content of a library of objects: the meshes of a folder, or the entries of a manifest.

An object that cannot be used is skipped with a reason, and the others are used.
"""

import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
import yaml

from tactopose_drake.core.shape.model_options import NUMBERS
from tactopose_drake.core.shape.symmetry import RotationalSymmetry, symmetry_group
from tactopose_drake.core.validation import finite_array
from tactopose_drake.errors import InvalidFileError, InvalidInputError
from tactopose_drake.estimation.data_checks import check_keys
from tactopose_drake.resources.yaml_files import plain_data, read_yaml, shown

MANIFEST = "library.yaml"
"""The manifest of a folder."""

_MESHES = frozenset({".3mf", ".dae", ".glb", ".gltf", ".obj", ".off", ".ply", ".stl"})
_OPTIONAL_KEYS = ("scale", "mass", "symmetry", "surface_sigma", "scale_sigma")
_SYMMETRY_KEYS = ("axis", "point", "order")
_HIGHEST_ORDER = 60  # the largest number of poses in a symmetry group

Axis = tuple[tuple[float, ...], tuple[float, ...], int]
"""Axis, a point on it (m), and order of a symmetry."""


class LibraryEntry(NamedTuple):
    """A library's data on one object.

    Attributes:
        name: the object's name.
        mesh: its mesh file.
        mass: mass, kg; None if it is not given.
        symmetry: "auto", "none", or the axes.
        scale: metres per unit of the mesh.
        surface_sigma: standard deviation of the surface, m, as in `ObjectModel.from_mesh`.
        scale_sigma: relative standard deviation of the scale, likewise.
    """

    name: str
    mesh: Path
    mass: float | None = None
    symmetry: Literal["auto", "none"] | tuple[Axis, ...] = "auto"
    scale: float = 1.0
    surface_sigma: float = 0.0
    scale_sigma: float = 0.0


class SkippedObject(NamedTuple):
    """An object that was skipped.

    Attributes:
        name: the object's name.
        reason: why it was skipped.
    """

    name: str
    reason: str

    def __str__(self) -> str:
        return f"{self.name} is left out: {self.reason}"


def read_library(path: Path) -> tuple[list[LibraryEntry], list[SkippedObject]]:
    """The usable objects of a folder or manifest, and the skipped ones; no mesh is read.

    A manifest is a YAML file, or the file `library.yaml` of a folder:

        mug: {mesh: mug.obj, mass: 0.32}
        nut: {mesh: hardware/nut.stl, symmetry: [{axis: [0, 0, 1], point: [0, 0, 0], order: 6}]}

    Paths of meshes are relative to the manifest's folder. `scale` (metres per unit of the mesh), `mass` (kg),
    `symmetry` ("auto", "none", or axes with points in metres; order 0 is a solid of revolution), `surface_sigma` (m)
    and `scale_sigma` are optional. Without a manifest, every mesh in the folder that is not hidden is an object with
    its file's name.

    Raises:
        InvalidFileError: if there is no such folder or file, it is a mesh, or the manifest is not a mapping.
    """
    if os.path.isdir(path):
        return _read_manifest(path / MANIFEST) if os.path.isfile(path / MANIFEST) else _read_folder(path)
    if os.path.isfile(path):
        if path.suffix.lower() in _MESHES:
            raise InvalidFileError(f"{path} must be a folder of meshes, or a YAML file that lists some, not a mesh.")
        return _read_manifest(path)
    raise InvalidFileError(f"{path}: there is no such folder or manifest.")


def _read_folder(folder: Path) -> tuple[list[LibraryEntry], list[SkippedObject]]:
    entries: dict[str, LibraryEntry] = {}
    skipped = []
    # Skip hidden files, such as those that macOS puts beside each file of an archive.
    files = [file for file in folder.iterdir() if not file.name.startswith(".")]
    for mesh in sorted(file for file in files if file.suffix.lower() in _MESHES and file.is_file()):
        if mesh.stem in entries:
            skipped.append(
                SkippedObject(mesh.name, f"the name {mesh.stem!r} is that of {entries[mesh.stem].mesh.name}")
            )
        else:
            entries[mesh.stem] = LibraryEntry(mesh.stem, mesh)
    return list(entries.values()), skipped


def _read_manifest(path: Path) -> tuple[list[LibraryEntry], list[SkippedObject]]:
    root = read_yaml(path)
    if not isinstance(root, yaml.MappingNode):
        raise InvalidFileError(f"{path} must be a mapping of names to objects.")
    entries = []
    skipped = []
    for key, value in root.value:
        try:
            entries.append(_entry(path.parent, key.value, plain_data(value)))
        except InvalidInputError as error:
            skipped.append(SkippedObject(key.value, str(error)))
    return entries, skipped


def _entry(folder: Path, name: str, value: Any) -> LibraryEntry:
    known = check_keys(name, value, ("mesh",), _OPTIONAL_KEYS)
    if not isinstance(known["mesh"], str):
        raise InvalidInputError(f"{name}.mesh must be the path of a file, not {shown(known['mesh'])}.")
    symmetry = _symmetry(name, known.get("symmetry", "auto"))
    numbers = {key: check(f"{name}.{key}", known[key]) for key, check in NUMBERS.items() if known.get(key) is not None}
    return LibraryEntry(name, folder / known["mesh"], symmetry=symmetry, **numbers)


def _symmetry(name: str, value: Any) -> Literal["auto", "none"] | tuple[Axis, ...]:
    if value == "auto":
        return "auto"
    if value == "none":
        return "none"
    if not isinstance(value, list):
        raise InvalidInputError(f"{name}.symmetry must be auto, none or a list of axes, not {shown(value)}.")
    axes = []
    for i, row in enumerate(value):
        where = f"{name}.symmetry[{i}]"
        axis = check_keys(where, row, _SYMMETRY_KEYS)
        order = axis["order"]
        if not isinstance(order, int) or isinstance(order, bool) or order == 1 or not 0 <= order <= _HIGHEST_ORDER:
            raise InvalidInputError(
                f"{where}.order must be 0 or an integer from 2 to {_HIGHEST_ORDER}, not {shown(order)}."
            )
        vectors = (finite_array(f"{where}.{key}", axis[key], (3,)) for key in ("axis", "point"))
        direction, point = (tuple(vector.tolist()) for vector in vectors)
        axes.append((direction, point, order))
    symmetry_group(make_symmetries(axes))
    return tuple(axes)


def make_symmetries(axes: Iterable[Axis]) -> list[RotationalSymmetry]:
    """The symmetries about axes.

    Raises:
        InvalidInputError: if an axis is no unit vector, or an order is 1 or below 0.
    """
    return [RotationalSymmetry(np.array(axis), np.array(point), order) for axis, point, order in axes]
