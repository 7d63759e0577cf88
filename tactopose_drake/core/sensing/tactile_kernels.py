"""The compiled inner loop of the simulated tactile array."""

import numpy as np

from tactopose_drake.core.compilation import kernel, part
from tactopose_drake.core.kernel_types import Floats1, Floats2, Floats3, Longs1, OutFloats1, OutFloats2


@kernel
def faces_are_valid(faces: Longs1, vertices: int) -> bool:
    """Whether a flat list of faces (count, indices, count, ...) is complete and has valid indices only."""
    i = 0
    while i < len(faces):
        count = faces[i]
        if count < 3 or i + count >= len(faces):
            return False
        for k in range(i + 1, i + 1 + count):
            if faces[k] < 0 or faces[k] >= vertices:
                return False
        i += count + 1
    return True


@kernel
def cell_forces(
    vertices: Floats2, pressure: Floats1, faces: Longs1, planes: Floats3, normals: Floats2, out: OutFloats2
) -> None:
    """Adds to out[cell] the force of each face's part inside the cell's wedge.

    A face is clipped by each plane in turn (Sutherland-Hodgman), with its linear pressure interpolated along the edges.
    The result is a fan of triangles, and the mean of a linear field over a triangle is exactly that of its corners. A
    cell does not feel faces turned away from it.
    """
    longest = 0
    i = 0
    while i < len(faces):
        longest = max(longest, faces[i])
        i += faces[i] + 1
    # Each clip adds a vertex to a convex polygon, and at most half as many again to others: 1.5**4 < 6.
    polygon, clipped = np.empty((6 * longest, 4)), np.empty((6 * longest, 4))
    height = np.empty(6 * longest)
    i = 0
    while i < len(faces):
        first, size = i + 1, faces[i]
        i += size + 1
        n0, n1, n2 = 0.0, 0.0, 0.0  # twice the face's vector area
        a = vertices[faces[first]]
        for k in range(first + 1, first + size - 1):
            b, c = vertices[faces[k]], vertices[faces[k + 1]]
            n0 += (b[1] - a[1]) * (c[2] - a[2]) - (b[2] - a[2]) * (c[1] - a[1])
            n1 += (b[2] - a[2]) * (c[0] - a[0]) - (b[0] - a[0]) * (c[2] - a[2])
            n2 += (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
        for cell in range(len(planes)):
            if n0 * normals[cell, 0] + n1 * normals[cell, 1] + n2 * normals[cell, 2] <= 0.0:
                continue
            if _outside(vertices, faces, first, size, planes[cell]):
                continue
            count = size
            for k in range(size):
                vertex = faces[first + k]
                for c in range(3):
                    polygon[k, c] = vertices[vertex, c]
                polygon[k, 3] = pressure[vertex]
            for side in range(4):
                count = _clip(polygon, count, planes[cell, side], height, clipped)
                polygon, clipped = clipped, polygon
                if count < 3:
                    break
            if count >= 3:
                _add_force(polygon, count, out[cell])


@part
def _outside(vertices: Floats2, faces: Longs1, first: int, size: int, planes: Floats2) -> bool:
    """Whether a single plane excludes the whole face, which is the case for nearly all pairs of face and cell."""
    for side in range(4):
        out = True
        for k in range(first, first + size):
            q = vertices[faces[k]]
            if planes[side, 0] * q[0] + planes[side, 1] * q[1] + planes[side, 2] * q[2] + planes[side, 3] > 0.0:
                out = False
                break
        if out:
            return True
    return False


@part
def _clip(polygon: Floats2, count: int, plane: Floats1, height: OutFloats1, out: OutFloats2) -> int:
    """Clips a polygon to the inner side of a plane, into `out`; returns its number of vertices."""
    for k in range(count):
        q = polygon[k]
        height[k] = plane[0] * q[0] + plane[1] * q[1] + plane[2] * q[2] + plane[3]
    kept = 0
    for k in range(count):
        after = k + 1 if k + 1 < count else 0
        if height[k] >= 0.0:
            for c in range(4):
                out[kept, c] = polygon[k, c]
            kept += 1
        if (height[k] >= 0.0) != (height[after] >= 0.0):
            share = height[k] / (height[k] - height[after])
            for c in range(4):
                out[kept, c] = polygon[k, c] + share * (polygon[after, c] - polygon[k, c])
            kept += 1
    return kept


@part
def _add_force(polygon: Floats2, count: int, out: OutFloats1) -> None:
    """Subtracts the integral of pressure times normal from `out`: pressure pushes against the outward normal."""
    a = polygon[0]
    for k in range(1, count - 1):
        b, c = polygon[k], polygon[k + 1]
        weight = (a[3] + b[3] + c[3]) / 6.0
        out[0] -= weight * ((b[1] - a[1]) * (c[2] - a[2]) - (b[2] - a[2]) * (c[1] - a[1]))
        out[1] -= weight * ((b[2] - a[2]) * (c[0] - a[0]) - (b[0] - a[0]) * (c[2] - a[2]))
        out[2] -= weight * ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))
