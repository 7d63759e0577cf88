"""Models of boxes, cylinders, spheres and capsules, with generated meshes."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, Self

from numpy.typing import ArrayLike

from tactopose_drake.core.mesh.loading import MeshSource
from tactopose_drake.core.mesh.primitives import box_mesh, capsule_mesh, cylinder_mesh, sphere_mesh


class SimpleBodies(ABC):
    """Mixin that makes models of simple bodies for a class that makes models of meshes."""

    @classmethod
    @abstractmethod
    def from_mesh(cls, mesh: MeshSource, *args: Any, **options: Any) -> Self:
        """The model of a mesh."""

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
