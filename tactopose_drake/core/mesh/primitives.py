"""Meshes of simple bodies centred on the origin, fine enough that no touch tells them from the exact bodies."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from tactopose_drake.core.validation import finite_array, positive_number

if TYPE_CHECKING:
    import trimesh

_SECTIONS = 96  # around a cylinder: its facets lie 0.05 % of the radius inside it


def box_mesh(size: ArrayLike) -> trimesh.Trimesh:
    """A box of these sides, shape (3,), m."""
    sides = [positive_number(f"size[{i}]", side) for i, side in enumerate(finite_array("size", size, (3,)).tolist())]
    mesh: trimesh.Trimesh = _creation().box(sides)
    return mesh


def cylinder_mesh(radius: float, length: float) -> trimesh.Trimesh:
    """A cylinder along z, m."""
    radius, length = positive_number("radius", radius), positive_number("length", length)
    larger = _whole_scale(radius)
    mesh = _creation().cylinder(radius=larger * radius, height=larger * length, sections=_SECTIONS)
    return _scaled(mesh, 1.0 / larger)


def sphere_mesh(radius: float) -> trimesh.Trimesh:
    """A sphere, m."""
    mesh: trimesh.Trimesh = _creation().icosphere(subdivisions=4, radius=positive_number("radius", radius))
    return mesh


def capsule_mesh(radius: float, length: float) -> trimesh.Trimesh:
    """A cylinder of this length with hemispherical ends, along z, m."""
    radius, length = positive_number("radius", radius), positive_number("length", length)
    larger = _whole_scale(radius)
    mesh = _creation().capsule(height=larger * length, radius=larger * radius, count=[_SECTIONS, _SECTIONS])
    mesh.apply_translation(-np.asarray(mesh.bounds).mean(axis=0))
    return _scaled(mesh, 1.0 / larger)


def _whole_scale(radius: float) -> float:
    """The factor by which a solid of revolution is made larger, as trimesh omits faces below 1e-8 m^2, as at poles.

    It is a power of two, so that scaling back is exact.
    """
    return float(2.0 ** (1 - np.frexp(radius)[1]))


def _scaled(mesh: trimesh.Trimesh, scale: float) -> trimesh.Trimesh:
    import trimesh

    return trimesh.Trimesh(scale * mesh.vertices, mesh.faces, process=False)


def _creation() -> Any:
    import trimesh.creation  # Deferred as in `loading`.

    return trimesh.creation
