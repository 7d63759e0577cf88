"""Winding numbers of the nodes of a regular grid by signed crossings, compiled."""

import numpy as np

from tactopose_drake.core.compilation import inlined, kernel
from tactopose_drake.core.kernel_types import Floats1, Floats2, Ints2, Shape3, Shorts2, Shorts3


@kernel
def winding_numbers(
    vertices: Floats2, faces: Ints2, origin: Floats1, spacing: float, shape: Shape3
) -> tuple[Shorts3, Shorts2]:
    """Winding numbers of the nodes, by signed crossings counted upwards along z.

    An edge's side test is computed with its vertices in the same order for both of its faces, so a column neither
    misses a shared edge nor counts it twice.

    Args:
        vertices: shape (v, 3), m; the columns must not pass through them (shift `origin` by a little).
        faces: vertex indices, shape (f, 3).
        origin: position of node (0, 0, 0), shape (3,), m.
        spacing: distance between nodes, m.
        shape: number of nodes along x, y and z.

    Returns:
        The winding numbers (nx, ny, nz), int16, and each column's remainder (nx, ny): zero for a closed mesh.
    """
    nx, ny, nz = shape
    winding = np.zeros((nx, ny, nz), dtype=np.int16)
    rest = np.zeros((nx, ny), dtype=np.int16)
    for f in range(faces.shape[0]):
        va, vb, vc = faces[f, 0], faces[f, 1], faces[f, 2]
        a, b, c = vertices[va], vertices[vb], vertices[vc]
        area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
        if area == 0.0:
            continue
        low, high = min(a[0], b[0], c[0]), max(a[0], b[0], c[0])
        i0 = max(0, int(np.ceil((low - origin[0]) / spacing)))
        i1 = min(nx - 1, int(np.floor((high - origin[0]) / spacing)))
        low, high = min(a[1], b[1], c[1]), max(a[1], b[1], c[1])
        j0 = max(0, int(np.ceil((low - origin[1]) / spacing)))
        j1 = min(ny - 1, int(np.floor((high - origin[1]) / spacing)))
        for i in range(i0, i1 + 1):
            x = origin[0] + i * spacing
            for j in range(j0, j1 + 1):
                y = origin[1] + j * spacing
                ea = side(b, c, vb < vc, x, y)
                eb = side(c, a, vc < va, x, y)
                ec = side(a, b, va < vb, x, y)
                if (ea > 0.0) != (eb > 0.0) or (ea > 0.0) != (ec > 0.0):
                    continue
                z = (ea * a[2] + eb * b[2] + ec * c[2]) / (ea + eb + ec)
                step = -1 if ea > 0.0 else 1  # going upwards through a face that looks up leaves the solid
                rest[i, j] += step
                k = max(0, int(np.ceil((z - origin[2]) / spacing)))
                if k < nz:
                    winding[i, j, k] += step
    for i in range(nx):
        for j in range(ny):
            for k in range(1, nz):
                winding[i, j, k] += winding[i, j, k - 1]
    return winding, rest


@inlined
def side(p, q, in_order, x, y):
    """Which side of the line p q the point (x, y) is on; never zero, and bitwise opposite for q p."""
    if in_order:
        side = (q[0] - p[0]) * (y - p[1]) - (q[1] - p[1]) * (x - p[0])
        return side if side != 0.0 else 1e-300
    side = (p[0] - q[0]) * (y - q[1]) - (p[1] - q[1]) * (x - q[0])
    return -side if side != 0.0 else -1e-300
