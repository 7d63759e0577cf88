"""From a signed distance field to a closed triangle mesh of a wanted size."""

import numpy as np
import trimesh
from manifold3d import Manifold, Mesh
from numpy.typing import ArrayLike, NDArray
from skimage.measure import marching_cubes

from .fields import Field

Array = NDArray[np.float64]


def sculpt(field: Field, bounds: ArrayLike, step: float, tolerance: float) -> trimesh.Trimesh:
    """The surface of a field, with large triangles where it is flat and small ones where it bends.

    Args:
        field: signed distance, negative inside.
        bounds: lowest and highest corner of a box around the whole surface, shape (2, 3), m.
        step: of the marching cubes' grid, m.
        tolerance: how far the thinning may move the surface, m.

    Returns:
        A closed mesh, outward faces.

    Raises:
        ValueError: the surface leaves the bounds or is not one closed piece.
    """
    low, high = np.asarray(bounds, dtype=float)
    axes = [np.arange(a, b + step, step) for a, b in zip(low, high, strict=True)]
    values = field(np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1))
    shell = np.ones(values.shape, dtype=bool)
    shell[1:-1, 1:-1, 1:-1] = False
    if values[shell].min() <= 0:
        raise ValueError("field: its surface leaves the bounds.")
    # A node exactly on the surface would make triangles without area.
    values = np.where(np.abs(values) < 1e-3 * step, 1e-3 * step, values)
    vertices, faces, _, _ = marching_cubes(values, 0.0, gradient_direction="descent", allow_degenerate=False)
    points = onto_surface(field, low + step * vertices.astype(float), step)
    mesh = thin(trimesh.Trimesh(points, faces, process=False), tolerance)
    if not mesh.is_watertight or mesh.body_count != 1:
        raise ValueError(f"field: makes {mesh.body_count} bodies, watertight: {mesh.is_watertight}; one is wanted.")
    return mesh


def gradient(field: Field, points: Array, step: float) -> Array:
    """The field's gradient by central differences, shape (n, 3)."""
    offsets = step * np.eye(3)
    return np.stack([field(points + e) - field(points - e) for e in offsets], axis=-1) / (2 * step)


def onto_surface(field: Field, points: Array, step: float) -> Array:
    """Moves points that are within a cell of the surface onto it, by Newton steps along the gradient."""
    moved = points
    for _ in range(3):
        slope = gradient(field, moved, 1e-5)
        move = field(moved)[:, None] * slope / np.maximum(np.sum(slope**2, axis=1, keepdims=True), 0.25)
        moved = points + np.clip(moved - move - points, -step / 4, step / 4)
    return moved


def thin(mesh: trimesh.Trimesh, tolerance: float) -> trimesh.Trimesh:
    """Drops the vertices without which the surface stays within a tolerance (m)."""
    solid = Manifold(Mesh(mesh.vertices.astype(np.float32), mesh.faces.astype(np.uint32)))
    solid = solid.simplify(tolerance)
    result = solid.to_mesh()
    return trimesh.Trimesh(
        result.vert_properties[:, :3].astype(float), result.tri_verts.astype(np.int64), process=False
    )
