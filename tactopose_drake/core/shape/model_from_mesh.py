"""The ways to make a model: of a mesh, or of a box, cylinder, sphere or capsule, whose meshes are generated."""

from __future__ import annotations

import json
import warnings
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, Literal, Self

from numpy.typing import ArrayLike

from tactopose_drake.core.mesh.loading import MeshSource, mesh_name
from tactopose_drake.core.mesh.primitives import box_mesh, capsule_mesh, cylinder_mesh, sphere_mesh
from tactopose_drake.core.mesh.repair import MeshRepairWarning
from tactopose_drake.core.shape.model_building import arrays_of
from tactopose_drake.core.shape.model_cache import Arrays
from tactopose_drake.core.shape.model_options import ModelOptions
from tactopose_drake.core.shape.symmetry import RotationalSymmetry
from tactopose_drake.core.shape.symmetry_judge import SymmetryDetectionParams


class MadeFromMesh(ABC):
    """What makes the models of a class out of meshes."""

    @classmethod
    @abstractmethod
    def _of(cls, arrays: Arrays, repairs: tuple[str, ...], options: ModelOptions) -> Self:
        """The model from arrays built from a mesh, the sentences on what was repaired in it, and the options."""

    @classmethod
    def from_mesh(
        cls,
        mesh: MeshSource,
        *,
        name: str | None = None,
        scale: float = 1.0,
        mass: float | None = None,
        center_of_mass: ArrayLike | None = None,
        symmetry: Literal["auto", "none"] | Sequence[RotationalSymmetry] = "auto",
        symmetry_tolerance: float = SymmetryDetectionParams().tolerance,
        samples: int = 3000,
        spacing: float | None = None,
        max_grid_bytes: int = 64 * 2**20,
        surface_sigma: float = 0.0,
        scale_sigma: float = 0.0,
        cache: bool = True,
    ) -> Self:
        """Builds the model of a mesh, or loads it from the cache, by the mesh's content.

        Args:
            mesh: a file (obj, stl, ply, off, glb, gltf, dae, zae, 3mf or xaml), a `trimesh.Trimesh`, or a
                `trimesh.Scene`, whose meshes are joined.
            name: of the object.
            scale: the mesh's unit in metres: 0.001 for millimetres. A dae, zae or 3mf file states its unit and is
                converted to metres anyway; the scale is applied in addition.
            mass: kg.
            center_of_mass: in O, shape (3,), m; in the bounding box, or outside of it by no more than the size.
            symmetry: "auto" detects the rotations that leave the object unchanged, "none" assumes that there are none,
                a list gives them.
            symmetry_tolerance: how far the turned surface may be off, as a share of the size (see
                `detect_symmetries`).
            samples: number of surface samples, at least 100.
            spacing: of the distance grid, m, up to the size; by default chosen from that and the walls' thickness.
            max_grid_bytes: the largest size of the distance grid, bytes.
            surface_sigma: standard deviation of the surface's distance from the mesh, along its normal, m, for scans or
                worn objects. It is added to the contacts' errors.
            scale_sigma: relative standard deviation of the mesh's scale: 0.03 if it may be 3 % too small.
            cache: whether to cache the result on disk (in `TACTOPOSE_CACHE_DIR`).

        Raises:
            InvalidFileError: if a file is missing or cannot be read as a mesh.
            UnknownNameError: if a file's format or `symmetry` is unknown.
            InvalidMeshError: if the mesh is empty, not finite, not manifold, flat, too open to have an inside, passes
                through itself so that its inertia is that of no body, or lies far from its frame's origin.
            MeshUnitsError: if the mesh is evidently not in metres.
            InvalidInputError: if an option is out of its range.

        Warns:
            MeshRepairWarning: once for each repair; see `repair_mesh`.
        """
        options = ModelOptions(
            name=mesh_name(mesh) if name is None else name,
            scale=scale,
            mass=mass,
            center_of_mass=center_of_mass,
            symmetry=symmetry,
            symmetry_tolerance=symmetry_tolerance,
            samples=samples,
            spacing=spacing,
            max_grid_bytes=max_grid_bytes,
            surface_sigma=surface_sigma,
            scale_sigma=scale_sigma,
            is_kept=cache,
        )
        arrays = arrays_of(mesh, options)
        repairs = tuple(json.loads(arrays["repairs"].tobytes()))
        for repair in repairs:
            warnings.warn(f"{options.name}: {repair}.", MeshRepairWarning, stacklevel=2)
        return cls._of(arrays, repairs, options)

    @classmethod
    def from_box(cls, size: ArrayLike, **options: Any) -> Self:
        """A box centred on O's origin, along its axes.

        Args:
            size: its sides, shape (3,), m.
            options: as of `ObjectModel.from_mesh`.
        """
        return cls.from_mesh(box_mesh(size), **{"name": "box"} | options)

    @classmethod
    def from_cylinder(cls, radius: float, length: float, **options: Any) -> Self:
        """A cylinder along z, centred on O's origin.

        Args:
            radius: m.
            length: m.
            options: as of `ObjectModel.from_mesh`.
        """
        return cls.from_mesh(cylinder_mesh(radius, length), **{"name": "cylinder"} | options)

    @classmethod
    def from_sphere(cls, radius: float, **options: Any) -> Self:
        """A sphere centred on O's origin.

        Args:
            radius: m.
            options: as of `ObjectModel.from_mesh`.
        """
        return cls.from_mesh(sphere_mesh(radius), **{"name": "sphere"} | options)

    @classmethod
    def from_capsule(cls, radius: float, length: float, **options: Any) -> Self:
        """A cylinder with hemispherical ends along z, centred on O's origin.

        Args:
            radius: m.
            length: of the cylinder, m.
            options: as of `ObjectModel.from_mesh`.
        """
        return cls.from_mesh(capsule_mesh(radius, length), **{"name": "capsule"} | options)
