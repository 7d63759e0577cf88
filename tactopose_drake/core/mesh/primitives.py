"""Meshes of simple bodies about their own middle, fine enough that no touch tells them from the true ones."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from tactopose_drake.core.validation import finite_array, positive_number

if TYPE_CHECKING:
    import trimesh

_SECTIONS = 96  # around a cylinder: its facets lie 0.05 % of its radius below it


def box_mesh(size: ArrayLike) -> trimesh.Trimesh:
    """A box of these sides, shape (3,), m."""
    sides = [positive_number(f"size[{i}]", side) for i, side in enumerate(finite_array("size", size, (3,)).tolist())]
    mesh: trimesh.Trimesh = _creation().box(sides)
    return mesh


def cylinder_mesh(radius: float, length: float) -> trimesh.Trimesh:
    """A cylinder along z, m."""
    radius, length = positive_number("radius", radius), positive_number("length", length)
    mesh: trimesh.Trimesh = _creation().cylinder(radius=radius, height=length, sections=_SECTIONS)
    return mesh


def sphere_mesh(radius: float) -> trimesh.Trimesh:
    """A sphere, m."""
    mesh: trimesh.Trimesh = _creation().icosphere(subdivisions=4, radius=positive_number("radius", radius))
    return mesh


def capsule_mesh(radius: float, length: float) -> trimesh.Trimesh:
    """Hemispheres on a cylinder of this length along z, m."""
    radius, length = positive_number("radius", radius), positive_number("length", length)
    mesh: trimesh.Trimesh = _creation().capsule(height=length, radius=radius, count=[_SECTIONS, _SECTIONS])
    mesh.apply_translation(-np.asarray(mesh.bounds).mean(axis=0))
    return mesh


def _creation() -> Any:
    import trimesh.creation  # As late as in `loading`.

    return trimesh.creation
