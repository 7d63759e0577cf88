"""Normals averaged around vertices, and interpolated at the nodes of a grid, compiled."""

import numpy as np

from tactopose_drake.core.compilation import kernel
from tactopose_drake.core.kernel_types import Floats1, Floats2, Floats3, Ints3, Longs1, OutFloats3, OutSingles4
from tactopose_drake.core.shape.distance_kernels import closest_weights

# Most faces averaged around one vertex: all pairs would take minutes in a fan of 10^5 faces.
_MOST_AVERAGED = 1000


@kernel
def average_around_vertices(
    order: Longs1, first: Longs1, face_normals: Floats2, angles: Floats2, crease_cosine: float, normals: OutFloats3
) -> None:
    """For each corner, the mean of the normals of its vertex's faces, weighted by angle, except across creases.

    In a fan of thousands each corner averages an even subset of the faces, including its own.
    """
    for vertex in range(len(first) - 1):
        stride = 1 + (first[vertex + 1] - first[vertex]) // _MOST_AVERAGED
        for a in range(first[vertex], first[vertex + 1]):
            face, corner = order[a] // 3, order[a] % 3
            x, y, z = 0.0, 0.0, 0.0
            n = face_normals[face]
            for b in range(first[vertex] + (a - first[vertex]) % stride, first[vertex + 1], stride):
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


@kernel
def interpolate(
    values: OutSingles4,
    packed: Floats2,
    nearest: Ints3,
    corners: Floats3,
    origin: Floats1,
    spacing: float,
    cosine: float,
) -> None:
    """Replaces gradients by the interpolated normal of the closest point, where the two have about the same direction.

    Beside a crease the gradient fans out between the two faces, as the normal of a contact on the edge does: it stays.
    """
    nx, ny, nz = nearest.shape
    n = np.empty(3)
    for i in range(nx):
        for j in range(ny):
            for k in range(nz):
                face = nearest[i, j, k]
                v, w = closest_weights(
                    packed[face], origin[0] + i * spacing, origin[1] + j * spacing, origin[2] + k * spacing
                )
                a, b, c = corners[face, 0], corners[face, 1], corners[face, 2]
                for axis in range(3):
                    n[axis] = (1.0 - v - w) * a[axis] + v * b[axis] + w * c[axis]
                length = np.sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2])
                g = values[i, j, k]
                if n[0] * g[1] + n[1] * g[2] + n[2] * g[3] > cosine * length:
                    g[1], g[2], g[3] = n[0] / length, n[1] / length, n[2] / length
