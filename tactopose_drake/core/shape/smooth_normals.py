"""The normal that a fingertip is expected to feel at each node of a grid, and its certainty.

A mesh's own normals are constant over each facet and jump at its edges. As a contact's position is known to about a
millimetre, its expected normal is an average over about that distance. Two averages are combined. The direction is that
of the smooth surface which the mesh approximates: normals interpolated over each face between those of its corners (as
in shading, [P75]), except across creases; so the facets of a tessellated cylinder do not seem to determine its spin.
The length is that of the average of the mesh's own normals: it is one where the surface is flat, and falls with their
spread, so that the normal at an edge of a box has little weight.

Source: [P75] B. T. Phong, Illumination for computer generated pictures, Commun. ACM 18(6), 1975.
"""

import math
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from tactopose_drake.core.shape.normal_kernels import average_around_vertices, interpolate
from tactopose_drake.core.validation import FloatArray


@dataclass(frozen=True, kw_only=True)
class NormalParams:
    """The neighbourhood over which normals are averaged."""

    crease: float = math.radians(30.0)  # angle between faces, rad, above which their common edge is a crease
    blur: float = 0.001  # standard deviation, m: about that of a contact's position
    wall_share: float = 0.25  # largest blur as a share of a wall's thickness, so as not to mix its two sides
    least_cells: float = 0.8  # smallest blur in cells of the grid


def smooth_normals(
    values: NDArray[np.float32],
    corners: FloatArray,
    packed: FloatArray,
    nearest: NDArray[np.int32],
    origin: FloatArray,
    spacing: float,
    wall: float,
    params: NormalParams,
) -> None:
    """Replaces the gradients values[..., 1:4] of a distance field by mean outward normals, of length at most one.

    Args:
        values: signed distance and unit gradient at each node, shape (nx, ny, nz, 4).
        corners: unit normals at each face's corners, from `corner_normals`, shape (f, 3, 3).
        packed: the triangles, from `distance_transform.pack_triangles`.
        nearest: the nearest face of each node, shape (nx, ny, nz).
        origin: position of node (0, 0, 0), shape (3,), m.
        spacing: distance between nodes, m.
        wall: thickness of the object's walls, m.
        params: the neighbourhood of the average.
    """
    blur = max(min(params.blur, params.wall_share * wall) / spacing, params.least_cells)
    spread_length = _blurred_length(values, blur)
    interpolate(values, packed, nearest, corners, origin, spacing, math.cos(0.5 * params.crease))
    for axis in range(1, 4):
        values[..., axis] = scipy.ndimage.gaussian_filter(values[..., axis], blur, mode="nearest")
    length = np.sqrt(np.einsum("ijkc,ijkc->ijk", values[..., 1:], values[..., 1:]))
    values[..., 1:] *= (np.minimum(spread_length, length) / np.maximum(length, 1e-6))[..., None]


def _blurred_length(values: NDArray[np.float32], blur: float) -> NDArray[np.float32]:
    square = np.zeros(values.shape[:3], dtype=np.float32)
    for axis in range(1, 4):
        square += scipy.ndimage.gaussian_filter(values[..., axis], blur, mode="nearest") ** 2
    return np.sqrt(square)


def corner_normals(
    vertices: FloatArray, faces: NDArray[np.int32], face_normals: FloatArray, crease_cosine: float
) -> FloatArray:
    """Unit normals (f, 3, 3) at each face's corners: the angle-weighted means of the faces that join smoothly there."""
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
    average_around_vertices(order, first, np.ascontiguousarray(face_normals), angles, crease_cosine, normals)
    return normals
