"""Grasp quality in Meshcat: projections of the wrench space, and where another contact would improve the grasp."""

from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import Meshcat, Rgba, Sphere
from pydrake.math import RigidTransform
from scipy.spatial import cKDTree

from tactopose_drake.core.grasping.improvement import ImprovementMap
from tactopose_drake.core.grasping.wrench_space import WrenchSpace
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import FloatArray

FORCE_RGBA, TORQUE_RGBA = Rgba(0.13, 0.62, 0.24, 0.45), Rgba(0.85, 0.16, 0.12, 0.45)
_WIRE_WIDTH = 1.0
_MARK_RADIUS = 0.0009
_MARK_RGBA = Rgba(0.05, 0.05, 0.05, 1.0)
# Red for worse, near white for equal, blue for better. [B16] figure 6.3
_COLOURS = np.array([[0.80, 0.09, 0.10], [0.93, 0.92, 0.90], [0.10, 0.25, 0.80]])
# Number of samples from which a vertex's colour is interpolated.
_NEIGHBOURS = 4


def draw_wrench_space(meshcat: Meshcat, path: str, space: WrenchSpace, *, scale: float = 0.1) -> None:
    """Draws the forces (green) and torques (red) that a grasp can exert, as two hulls about the path's origin.

    A hull without volume is not drawn.

    Args:
        meshcat: the display.
        path: parent path; `path/forces` and `path/torques` are added.
        space: the wrench space of the grasp.
        scale: drawn length of 1 N, m; torques are divided by the wrench space's length.
    """
    parts: tuple[tuple[Literal["force", "torque"], str, Rgba], ...] = (
        ("force", "forces", FORCE_RGBA),
        ("torque", "torques", TORQUE_RGBA),
    )
    for part, name, rgba in parts:
        at = f"{path}/{name}"
        meshcat.Delete(at)
        hull = space.projection(part)
        if hull is None:
            continue
        vertices, faces = scale * hull.vertices.T, hull.simplices.T
        meshcat.SetTriangleMesh(f"{at}/faces", vertices, faces, rgba)
        wire = Rgba(0.6 * rgba.r(), 0.6 * rgba.g(), 0.6 * rgba.b(), 1.0)
        meshcat.SetTriangleMesh(f"{at}/edges", vertices, faces, wire, wireframe=True, wireframe_line_width=_WIRE_WIDTH)


def draw_improvement(
    meshcat: Meshcat, path: str, model: ObjectModel, found: ImprovementMap, reachable: NDArray[np.bool_] | None = None
) -> None:
    """Draws an object in its frame O, red where a finger would make the grasp worse, and blue where better.

    Args:
        meshcat: the display.
        path: path of the object.
        model: the object.
        found: the quality for a contact at points of its surface.
        reachable: which of these points the finger reaches, shape (n,); they are marked with dots.
    """
    meshcat.Delete(path)
    meshcat.SetTriangleColorMesh(
        f"{path}/surface",
        model.vertices.T,
        model.faces.T,
        _linear(level_colours(vertex_levels(model, found))).T,
    )
    if reachable is not None:
        for row in np.flatnonzero(reachable):
            meshcat.SetObject(f"{path}/reachable/{row}", Sphere(_MARK_RADIUS), _MARK_RGBA)
            meshcat.SetTransform(f"{path}/reachable/{row}", RigidTransform(found.p_OQ[row]))


def vertex_levels(model: ObjectModel, found: ImprovementMap) -> FloatArray:
    """The map's levels at the mesh's vertices, shape (v,), from the nearest points on the same side of the surface."""
    tree = cKDTree(_place(model, found.p_OQ, found.n_OQ))
    count = min(_NEIGHBOURS, len(found.p_OQ))
    _, normals = model.grid.distance_and_normal(model.vertices)
    distance, row = tree.query(_place(model, model.vertices, normals), k=np.arange(1, count + 1))
    weight = 1.0 / np.maximum(distance, 1e-9)
    levels: FloatArray = np.sum(weight * found.level[row], axis=1) / weight.sum(axis=1)
    return levels


def level_colours(level: FloatArray) -> FloatArray:
    """RGB from levels -1 to 1, shape (n, 3)."""
    return np.column_stack([np.interp(level, [-1.0, 0.0, 1.0], channel) for channel in _COLOURS.T])


def _linear(colours: FloatArray) -> FloatArray:
    """Converts sRGB colours to linear ones, which Meshcat expects of vertices."""
    light: FloatArray = np.where(colours <= 0.04045, colours / 12.92, ((colours + 0.055) / 1.055) ** 2.4)
    return light


def _place(model: ObjectModel, points: FloatArray, normals: FloatArray) -> FloatArray:
    """Coordinates (n, 6) in which points with opposite normals, as on the two sides of a wall, are far apart."""
    return np.concatenate([points, 0.1 * model.size * normals], axis=1)
