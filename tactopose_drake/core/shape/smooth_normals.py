"""The normal that a fingertip feels at each node of a grid, and how sure it is.

A mesh's own normals are constant over each facet and jump at its edges. A contact is known to about a millimetre, so
what is expected of its normal is an average over about that much. Two averages are taken. The direction is that of the
smooth surface which the mesh samples: normals interpolated over each face between those of its corners (as in shading,
[P75]), except across creases; so a tessellated cylinder does not look as if its facets fixed its spin. The length is
that of the average of the mesh's own normals: it is one where the surface is flat, and falls with their spread, so that
at an edge of a box no normal is expected strongly.

Source: [P75] B. T. Phong, Illumination for computer generated pictures, Commun. ACM 18(6), 1975.
"""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from tactopose_drake.core.shape.distance_transform import closest_weights
from tactopose_drake.core.validation import FloatArray

CREASE = math.radians(30.0)
"""Faces that meet at a larger angle meet at a crease."""

BLUR = 0.001
"""Standard deviation of the blur, m: about that of a contact's position."""

# But no more of a wall's thickness, whose two sides it would mix, and no less in cells.
_WALL_SHARE, _LEAST_CELLS = 0.25, 0.8


def smooth_normals(
    values: NDArray[np.float32],
    vertices: FloatArray,
    faces: NDArray[np.int32],
    packed: FloatArray,
    nearest: NDArray[np.int32],
    origin: FloatArray,
    spacing: float,
    wall: float,
) -> None:
    """Replaces the gradients values[..., 1:4] of a distance field by mean outward normals, of length at most one.

    Args:
        values: signed distance and unit gradient at each node, shape (nx, ny, nz, 4).
        vertices: shape (v, 3), m.
        faces: vertex indices, shape (f, 3).
        packed: the triangles, from `distance_transform.pack_triangles`.
        nearest: the nearest face of each node, shape (nx, ny, nz).
        origin: position of node (0, 0, 0), shape (3,), m.
        spacing: distance between nodes, m.
        wall: thickness of the object's walls, m.
    """
    blur = max(min(BLUR, _WALL_SHARE * wall) / spacing, _LEAST_CELLS)
    spread_length = _blurred_length(values, blur)
    corners = corner_normals(vertices, faces, packed[:, 12:15], math.cos(CREASE))
    _interpolate(values, packed, nearest, corners, origin, spacing, math.cos(0.5 * CREASE))
    for axis in range(1, 4):
        values[..., axis] = gaussian_filter(values[..., axis], blur, mode="nearest")
    length = np.sqrt(np.einsum("ijkc,ijkc->ijk", values[..., 1:], values[..., 1:]))
    values[..., 1:] *= (np.minimum(spread_length, length) / np.maximum(length, 1e-6))[..., None]


def _blurred_length(values: NDArray[np.float32], blur: float) -> NDArray[np.float32]:
    square = np.zeros(values.shape[:3], dtype=np.float32)
    for axis in range(1, 4):
        square += gaussian_filter(values[..., axis], blur, mode="nearest") ** 2
    return np.sqrt(square)


def corner_normals(
    vertices: FloatArray, faces: NDArray[np.int32], face_normals: FloatArray, crease_cosine: float
) -> FloatArray:
    """Unit normals (f, 3, 3) at each face's corners, weighted by the angles of the faces that meet there smoothly."""
    corners = vertices[faces]
    forward = np.roll(corners, -1, axis=1) - corners
    backward = np.roll(corners, 1, axis=1) - corners
    angles = np.arctan2(
        np.linalg.norm(np.cross(forward, backward), axis=-1), np.einsum("fia,fia->fi", forward, backward)
    )
    flat = faces.ravel()
    order = np.argsort(flat, kind="stable")
    first = np.searchsorted(flat[order], np.arange(len(vertices) + 1))
    normals = np.empty((len(faces), 3, 3))
    _average_around_vertices(order, first, np.ascontiguousarray(face_normals), angles, crease_cosine, normals)
    return normals


@njit(cache=True)
def _average_around_vertices(order, first, face_normals, angles, crease_cosine, normals):  # type: ignore[no-untyped-def]
    """For each corner, the mean of its vertex's face normals, weighted by angle, leaving out those across a crease."""
    for vertex in range(len(first) - 1):
        for a in range(first[vertex], first[vertex + 1]):
            face, corner = order[a] // 3, order[a] % 3
            x, y, z = 0.0, 0.0, 0.0
            n = face_normals[face]
            for b in range(first[vertex], first[vertex + 1]):
                m = face_normals[order[b] // 3]
                if n[0] * m[0] + n[1] * m[1] + n[2] * m[2] > crease_cosine:
                    weight = angles[order[b] // 3, order[b] % 3]
                    x, y, z = x + weight * m[0], y + weight * m[1], z + weight * m[2]
            length = np.sqrt(x * x + y * y + z * z)
            normals[face, corner, 0], normals[face, corner, 1], normals[face, corner, 2] = (
                x / length,
                y / length,
                z / length,
            )


@njit(cache=True)
def _interpolate(values, packed, nearest, corners, origin, spacing, cosine):  # type: ignore[no-untyped-def]
    """Puts the interpolated normal of the closest point where the gradient points the same way.

    Beside a crease the gradient fans out between the two faces, as the normal of a contact on the edge does: it stays.
    """
    nx, ny, nz = nearest.shape
    for i in range(nx):
        for j in range(ny):
            for k in range(nz):
                face = nearest[i, j, k]
                v, w = closest_weights(
                    packed[face], origin[0] + i * spacing, origin[1] + j * spacing, origin[2] + k * spacing
                )
                n = (1.0 - v - w) * corners[face, 0] + v * corners[face, 1] + w * corners[face, 2]
                length = np.sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2])
                g = values[i, j, k]
                if n[0] * g[1] + n[1] * g[2] + n[2] * g[3] > cosine * length:
                    g[1], g[2], g[3] = n[0] / length, n[1] / length, n[2] / length
