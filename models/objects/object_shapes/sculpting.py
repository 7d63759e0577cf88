"""Converts a signed distance field to a closed mesh of well-shaped triangles, small where the curvature is high.

Sizes follow [DBP13] Dunyach et al., Adaptive remeshing for real-time mesh deformation, 2013. Positions are rounded
after every array operation, so that the result does not depend on the last bits, in which processors differ.
"""

import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray
from skimage.measure import marching_cubes

from .fields import Field, length
from .remeshing import Remesher

Array = NDArray[np.float64]
Faces = NDArray[np.int64]

GRAIN = 7  # decimals of the rounded positions: 0.1 um


def sculpt(
    field: Field, bounds: ArrayLike, step: float, tolerance: float, edges: tuple[float, float], rounds: int = 6
) -> trimesh.Trimesh:
    """The mesh of a field's surface.

    Args:
        field: signed distance, negative inside.
        bounds: lowest and highest corner of a box around the whole surface, shape (2, 3), m.
        step: spacing of the marching cubes' grid, m; less than the thinnest wall.
        tolerance: wanted distance of the triangles from a curved surface, m.
        edges: shortest and longest wanted edge, m.
        rounds: number of remeshing rounds.

    Returns:
        A closed mesh, outward faces.

    Raises:
        ValueError: the surface leaves the bounds or is not one closed piece.
    """
    points, faces = _march(field, bounds, step)
    for _ in range(rounds):
        lengths = _wanted_lengths(field, points, faces, tolerance, edges)
        remesher = Remesher(
            [tuple(p) for p in points.tolist()], [tuple(f) for f in faces.tolist()], np.round(lengths, GRAIN).tolist()
        )
        remesher.split_long_edges()
        remesher.collapse_short_edges()
        remesher.flip_edges()
        points, faces = _compact(remesher)
        points = _relax(field, points, faces)
    mesh = trimesh.Trimesh(points, faces, process=False)
    if not mesh.is_watertight or mesh.body_count != 1:
        raise ValueError(f"field: makes {mesh.body_count} bodies, watertight: {mesh.is_watertight}; one is wanted.")
    return mesh


def _march(field: Field, bounds: ArrayLike, step: float) -> tuple[Array, Faces]:
    low, high = np.asarray(bounds, dtype=float)
    axes = [np.arange(a, b + step, step) for a, b in zip(low, high, strict=True)]
    values = np.round(field(np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)), 9)
    shell = np.ones(values.shape, dtype=bool)
    shell[1:-1, 1:-1, 1:-1] = False
    if values[shell].min() <= 0:
        raise ValueError("field: its surface leaves the bounds.")
    # A node on the surface itself would make triangles without area.
    values = np.where(np.abs(values) < 0.02 * step, 0.02 * step, values)
    vertices, faces, _, _ = marching_cubes(values, 0.0, gradient_direction="descent", allow_degenerate=False)
    return np.round(low + step * vertices.astype(float), GRAIN), faces.astype(np.int64)


def _compact(remesher: Remesher) -> tuple[Array, Faces]:
    """The vertices and faces that are still in use, renumbered."""
    living = [i for i, around in enumerate(remesher.around) if around]
    renumbered = np.full(len(remesher.points), -1)
    renumbered[living] = np.arange(len(living))
    return np.array([remesher.points[i] for i in living]), renumbered[np.array(list(remesher.faces.values()))]


def gradient(field: Field, points: Array, step: float = 1e-5) -> Array:
    """The field's gradient by central differences, shape (n, 3)."""
    return np.stack([field(points + e) - field(points - e) for e in step * np.eye(3)], axis=-1) / (2 * step)


def _unit(vectors: Array) -> Array:
    return vectors / np.maximum(length(vectors)[..., None], 1e-12)


def _wanted_lengths(field: Field, points: Array, faces: Faces, tolerance: float, edges: tuple[float, float]) -> Array:
    """Wanted edge lengths at the vertices, from the local curvature, that increase gradually away from bends."""
    reach = 0.5 * edges[0]
    turn = np.stack(
        [_unit(gradient(field, points + e)) - _unit(gradient(field, points - e)) for e in reach * np.eye(3)], axis=-1
    )
    curvature = np.linalg.norm(turn, axis=(1, 2)) / (2 * reach)
    # [DBP13] eq. 3: edges of this length keep the triangles within the tolerance of a sphere of this curvature.
    lengths = np.sqrt(np.maximum(6 * tolerance / np.maximum(curvature, 1e-3) - 3 * tolerance**2, 0.0))
    lengths = np.clip(lengths, *edges)
    sides = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    spans = np.linalg.norm(points[sides[:, 0]] - points[sides[:, 1]], axis=1)
    for _ in range(30):
        grown = lengths.copy()
        np.minimum.at(grown, sides[:, 0], lengths[sides[:, 1]] + 0.3 * spans)
        np.minimum.at(grown, sides[:, 1], lengths[sides[:, 0]] + 0.3 * spans)
        lengths = grown
    return lengths


def _relax(field: Field, points: Array, faces: Faces, passes: int = 4) -> Array:
    """Moves the vertices along the surface towards the mean of their neighbours, and back onto the surface."""
    sides = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    degree = np.bincount(sides[:, 0], minlength=len(points))[:, None]
    for _ in range(passes):
        middle = np.zeros_like(points)
        np.add.at(middle, sides[:, 0], points[sides[:, 1]])
        move = middle / degree - points
        normal = _unit(gradient(field, points))
        points = points + 0.5 * (move - np.sum(move * normal, axis=1, keepdims=True) * normal)
        points = np.round(_onto_surface(field, points), GRAIN)
    return points


def _onto_surface(field: Field, points: Array) -> Array:
    """Moves points near the surface onto it, by Newton steps along the gradient."""
    for _ in range(2):
        slope = gradient(field, points)
        step = field(points)[:, None] * slope / np.maximum(np.sum(slope**2, axis=1, keepdims=True), 0.25)
        points = points - np.clip(step, -1e-3, 1e-3)
    return points
