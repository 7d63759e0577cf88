"""The model of an object: what its mesh says, in the forms that pose estimation needs."""

from __future__ import annotations

import hashlib
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray

from tactopose_drake.core.mesh_repair import MeshRepairWarning, load_mesh, repair_mesh
from tactopose_drake.core.signed_distance import DistanceGrid, build_grid
from tactopose_drake.core.surface_samples import SurfaceSamples, sample_surface
from tactopose_drake.core.symmetry import RotationalSymmetry, detect_symmetries, symmetry_group
from tactopose_drake.core.validation import FloatArray, finite_array, positive_number

DENSITY = 1000.0
"""Assumed density where no mass is given, kg/m^3."""


@dataclass(frozen=True, eq=False)
class ObjectModel:
    """A rigid object in its own frame O; all arrays are read-only."""

    name: str
    vertices: FloatArray
    faces: NDArray[np.int32]
    grid: DistanceGrid
    samples: SurfaceSamples
    volume: float
    mass: float
    center_of_mass: FloatArray
    inertia: FloatArray
    symmetries: tuple[RotationalSymmetry, ...]
    symmetry_poses: FloatArray
    size: float
    repairs: tuple[str, ...]
    content_hash: str

    @classmethod
    def from_mesh(
        cls,
        source: str | Path | trimesh.Trimesh | trimesh.Scene,
        *,
        mass: float | None = None,
        center_of_mass: ArrayLike | None = None,
        symmetry: Literal["auto", "none"] | Sequence[RotationalSymmetry] = "auto",
        cache: bool = True,
        samples: int = 3000,
        spacing: float | None = None,
        max_grid_bytes: int = 64 * 2**20,
    ) -> ObjectModel:
        """Builds the model of a mesh in metres."""
        name, vertices, faces = load_mesh(source)
        if mass is not None:
            mass = positive_number("mass", mass)
        given_center = None if center_of_mass is None else finite_array("center_of_mass", center_of_mass, (3,)).copy()
        mesh = repair_mesh(vertices, faces, name)
        for repair in mesh.repairs:
            warnings.warn(f"{name}: {repair}.", MeshRepairWarning, stacklevel=2)
        properties = trimesh.triangles.mass_properties(mesh.vertices[mesh.faces], density=DENSITY)
        volume = float(properties.volume)
        center = np.array(properties.center_mass if given_center is None else given_center, dtype=np.float64)
        scale = 1.0 if mass is None else mass / (DENSITY * volume)
        inertia = scale * np.array(properties.inertia, dtype=np.float64)
        for array in (mesh.vertices, mesh.faces, center, inertia):
            array.setflags(write=False)
        digest = hashlib.blake2b(digest_size=16)
        digest.update(mesh.vertices.tobytes())
        digest.update(mesh.faces.tobytes())
        grid = build_grid(mesh.vertices, mesh.faces, spacing=spacing, max_bytes=max_grid_bytes)
        surface = sample_surface(mesh.vertices, mesh.faces, samples)
        size = float(np.linalg.norm(np.ptp(mesh.vertices, axis=0)))
        symmetries: tuple[RotationalSymmetry, ...]
        if symmetry == "auto":
            symmetries = detect_symmetries(
                surface, grid, np.array(properties.center_mass), np.array(properties.inertia), size
            )
        else:
            symmetries = () if symmetry == "none" else tuple(symmetry)
        symmetry_poses = symmetry_group(symmetries)
        symmetry_poses.setflags(write=False)
        return cls(
            name=name,
            vertices=mesh.vertices,
            faces=mesh.faces,
            grid=grid,
            samples=surface,
            volume=volume,
            mass=DENSITY * volume if mass is None else mass,
            center_of_mass=center,
            inertia=inertia,
            symmetries=symmetries,
            symmetry_poses=symmetry_poses,
            size=size,
            repairs=mesh.repairs,
            content_hash=digest.hexdigest(),
        )
