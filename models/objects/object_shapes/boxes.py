"""Boxes with rounded edges."""

import numpy as np
import trimesh
from numpy.typing import NDArray


def _axis_levels(half: float, radius: float, step: float) -> NDArray[np.float64]:
    """Coordinates of the grid lines along one edge: dense over the rounding, uniform between, shape (n,), m."""
    inner = np.linspace(-(half - radius), half - radius, max(1, round(2 * (half - radius) / step)) + 1)
    # Equal angles on the rounded edge: the point at angle a from the face's normal stems from the face at tan(a).
    round_off = radius * np.tan(np.linspace(0, np.pi / 4, 3))[1:]
    return np.concatenate([-(half - radius) - round_off[::-1], inner, half - radius + round_off])


def rounded_box(size: tuple[float, float, float], radius: float, step: float) -> trimesh.Trimesh:
    """A box that stands on z = 0, centred on the z axis, with its edges rounded.

    Args:
        size: edge lengths along x, y, z, m.
        radius: radius of the rounded edges, m.
        step: approximate edge length of the triangles on the flat faces, m.

    Returns:
        A closed mesh, outward faces.
    """
    half = np.array(size) / 2
    levels = [_axis_levels(h, radius, step) for h in half]
    vertices, faces, offset = [], [], 0
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        a, b = np.meshgrid(levels[u], levels[v], indexing="ij")
        index = np.arange(a.size).reshape(a.shape)
        quads = np.stack([index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]], axis=-1).reshape(-1, 4)
        for side in (-1, 1):
            points = np.zeros((a.size, 3))
            points[:, u], points[:, v], points[:, axis] = a.ravel(), b.ravel(), side * half[axis]
            order = quads if side > 0 else quads[:, ::-1]
            vertices.append(points)
            faces += [order[:, [0, 1, 2]] + offset, order[:, [0, 2, 3]] + offset]
            offset += a.size
    cube = np.concatenate(vertices)
    core = np.clip(cube, -(half - radius), half - radius)
    outward = cube - core
    points = core + radius * outward / np.linalg.norm(outward, axis=1, keepdims=True)
    points[:, 2] += half[2]
    mesh = trimesh.Trimesh(points, np.concatenate(faces), process=False)
    mesh.merge_vertices(digits_vertex=7)
    return mesh
