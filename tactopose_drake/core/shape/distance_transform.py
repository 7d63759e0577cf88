"""Exact distances from the nodes of a regular grid to a triangle mesh, compiled by numba.

Three passes. A band around the surface is tested face by face, so its distances are exact. Sweeps over the grid then
propagate the nearest face outwards and inwards, comparing candidates by their exact distance ([T03], with triangles
instead of points). The sign comes from counting signed crossings along one grid direction: a node is inside if the
winding number is at least one.

Sources: [E05] C. Ericson, Real-Time Collision Detection, 2005, section 5.1.5; [T03] Y. Tsai, Rapid and accurate
computation of the distance function using grids, J. Comput. Phys., 2002.
"""

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.shape.distance_kernels import fill_band, sweep
from tactopose_drake.core.validation import FloatArray


def pack_triangles(triangles: FloatArray) -> FloatArray:
    """Packs the data of distances to triangles: corner a, edges ab and ac, their products, the unit normal: (f, 15).

    Args:
        triangles: corners, shape (f, 3, 3), m.
    """
    a = triangles[:, 0]
    ab, ac = triangles[:, 1] - a, triangles[:, 2] - a
    products = np.stack([np.sum(ab * ab, axis=1), np.sum(ab * ac, axis=1), np.sum(ac * ac, axis=1)], axis=1)
    normal = np.cross(ab, ac)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return np.ascontiguousarray(np.concatenate([a, ab, ac, products, normal], axis=1))


def nearest_faces(
    packed: FloatArray, origin: FloatArray, spacing: float, shape: tuple[int, int, int], band: float
) -> NDArray[np.int32]:
    """The nearest face of every node, shape `shape`: exact within the band about the surface, approximate elsewhere.

    Args:
        packed: the triangles, from `pack_triangles`.
        origin: position of node (0, 0, 0), shape (3,), m.
        spacing: distance between nodes, m.
        shape: number of nodes along x, y and z.
        band: half width of the band of exact distances, in grid spacings.
    """
    nx, ny, nz = shape
    nearest = np.full((nx + 2, ny + 2, nz + 2), -1, dtype=np.int32)
    distance = np.full(nearest.shape, np.inf)
    width = band * spacing
    inner = (slice(1, -1),) * 3
    near, exact = np.full(shape, -1, dtype=np.int32), np.full(shape, np.inf)
    fill_band(packed, origin, spacing, width, near, exact)
    nearest[inner], distance[inner] = near, exact
    sweep(packed, origin - spacing, spacing, width, nearest, distance)
    return np.ascontiguousarray(nearest[inner])
