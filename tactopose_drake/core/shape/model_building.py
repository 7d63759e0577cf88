"""Builds all that a model derives from a mesh, once: the arrays that are cached on disk."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.mesh.loading import MeshSource, RawMesh, load_mesh, mesh_file
from tactopose_drake.core.mesh.repair import repair_mesh
from tactopose_drake.core.shape import model_cache
from tactopose_drake.core.shape.coarse_field import coarsen
from tactopose_drake.core.shape.model_arrays import content_hash, describe_a_model
from tactopose_drake.core.shape.model_cache import Arrays
from tactopose_drake.core.shape.model_options import ModelOptions
from tactopose_drake.core.shape.model_symmetries import misfits
from tactopose_drake.core.shape.signed_distance import build_grid
from tactopose_drake.core.shape.surface_samples import sample_surface
from tactopose_drake.core.shape.symmetry import RotationalSymmetry, symmetry_group
from tactopose_drake.core.shape.symmetry_detection import detect_likenesses, detect_near_symmetries, detect_symmetries
from tactopose_drake.core.shape.symmetry_judge import JudgedShape, SymmetryDetectionParams
from tactopose_drake.errors import InvalidFileError

# Formats with all geometry in one file, whose bytes therefore identify the mesh without parsing it.
_SELF_CONTAINED = {".obj", ".off", ".ply", ".stl"}


def file_content(path: str | Path) -> tuple[bytes, str] | None:
    """The bytes of a mesh file and its ending, if they alone define the mesh."""
    file = mesh_file(path)
    if file.suffix.lower() not in _SELF_CONTAINED:
        return None
    try:
        return file.read_bytes(), file.suffix.lower()
    except OSError as error:
        raise InvalidFileError(f"{file} cannot be read ({error.strerror}).") from error


def _scaled(raw: RawMesh, scale: float) -> RawMesh:
    """Converts triangles to metres; `scale` is the mesh's unit in metres."""
    return raw if scale == 1.0 else RawMesh(scale * raw.vertices, raw.faces)


def arrays_of(mesh: MeshSource, options: ModelOptions) -> Arrays:
    """All that follows from the mesh alone, as arrays, loaded from disk or built.

    Args:
        mesh: as for `ObjectModel.from_mesh`.
        options: how the model is built.
    """
    content = file_content(mesh) if isinstance(mesh, str | Path) else None
    raw = _scaled(load_mesh(mesh), options.scale) if content is None else None

    def build() -> Arrays:
        label = str(mesh) if isinstance(mesh, str | Path) else options.name
        return build_arrays(raw or _scaled(load_mesh(mesh), options.scale), label, options)

    if not options.is_kept:
        return build()
    identity = content if raw is None else (raw.vertices, raw.faces)
    told = f"{options.tolerance} {options.samples} {options.spacing} {options.max_grid_bytes}"
    if content is not None and options.scale != 1.0:
        told += f" {options.scale!r}"
    key = model_cache.content_key(*(identity or ()), told)
    arrays = model_cache.load_or_make(key, lambda arrays: describe_a_model(arrays, options.samples), build)
    options.check_fit(arrays["vertices"])
    return arrays


def build_arrays(raw: RawMesh, label: str, options: ModelOptions) -> Arrays:
    """Builds all that follows from the mesh alone, as arrays; the checks come before the expensive steps.

    Args:
        raw: the unrepaired mesh.
        label: its name in errors.
        options: how the model is built.
    """
    mesh = repair_mesh(raw, label)
    options.check_fit(mesh.vertices)
    centroid, inertia = mesh.properties.centroid, mesh.properties.inertia
    grid = build_grid(mesh.vertices, mesh.faces, spacing=options.spacing, max_bytes=options.max_grid_bytes)
    surface = sample_surface(mesh.vertices, mesh.faces, options.samples)
    shape = JudgedShape(surface, grid, centroid, inertia, size=float(np.linalg.norm(np.ptp(mesh.vertices, axis=0))))
    found: tuple[RotationalSymmetry, ...] = ()
    near: tuple[RotationalSymmetry, ...] = ()
    if options.tolerance is not None:
        params = SymmetryDetectionParams(tolerance=options.tolerance)
        found = detect_symmetries(shape, params)
        near = detect_near_symmetries(shape, found, params)
    poses = symmetry_group(found)
    arrays: dict[str, NDArray[Any]] = {
        "vertices": mesh.vertices,
        "faces": mesh.faces,
        "distances": grid.values,
        "grid_origin": grid.origin,
        "grid_spacing": np.array(grid.spacing),
        "coarse_values": coarsen(grid).values,
        "sample_points": surface.points,
        "sample_normals": surface.normals,
        "volume": np.array(mesh.properties.volume),
        "centroid": centroid,
        "inertia": inertia,
        "axes": np.array([symmetry.axis for symmetry in found]).reshape(-1, 3),
        "orders": np.array([symmetry.order for symmetry in found], dtype=np.int64),
        "near_axes": np.array([symmetry.axis for symmetry in near]).reshape(-1, 3),
        "symmetry_poses": poses,
        "symmetry_misfits": misfits(grid, surface, poses),
        "likenesses": detect_likenesses(shape, found),
        "repairs": np.frombuffer(json.dumps(mesh.repairs).encode(), dtype=np.uint8),
        "content_hash": np.frombuffer(content_hash(mesh.vertices, mesh.faces).encode(), dtype=np.uint8),
    }
    return arrays
