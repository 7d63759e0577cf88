"""Compiled loops for depths in convex shapes; see `convex_shapes.py`."""

from typing import NamedTuple

import numpy as np

from tactopose_drake.core.compilation import inlined, kernel, part
from tactopose_drake.core.kernel_types import Floats1, Floats2, Floats4, Longs1, OutFloats1, OutFloats2, OutLongs1
from tactopose_drake.core.mesh.winding_kernels import side

# Most Newton steps for the parameter of an ellipsoid's nearest point, enough for full precision.
_STEPS = 30
_LEAST_STEP = 1e-15  # relative
_TINY = 1e-100  # floor of that parameter, m^2, for a point at the centre
_BESIDE = 1e-9, 2.1e-9  # m: a negligible shift off the vertices that lie below a regular mesh's centre
_LEVELS = 200  # most bisections of a triangle, and most levels of a tree


class Shapes(NamedTuple):
    """Convex shapes, each in its own frame G: the depth of a point is the least over the shape's parts.

    Attributes:
        radius: of a ball, or of a part that is round about the z axis, m; infinite if there is none, shape (s,).
        half_length: half the length of the segment of this axis from which the radius is measured, m, shape (s,).
        semi_axes: of an ellipsoid, m; zero if there is none, shape (s, 3).
        first: index of the first plane of each shape, and the number of all, shape (s + 1,).
        planes: outward normals n and offsets d of half-spaces n^T p <= d, m, shape (n, 4).
        deepest: a point of greatest depth in each shape, shape (s, 3), m.
    """

    radius: Floats1
    half_length: Floats1
    semi_axes: Floats2
    first: Longs1
    planes: Floats2
    deepest: Floats2


class Tree(NamedTuple):
    """A complete binary tree of spheres about triangles, with children of node i at 2 i + 1 and 2 i + 2.

    Attributes:
        spheres: centres and radii, shape (2 m - 1, 4), m; the last m nodes are leaves.
        triangles: leaf i has triangles k i to k i + k - 1, each of three points, shape (k m, 9), m.
    """

    spheres: Floats2
    triangles: Floats2


@part
def _in_ellipsoid(a: float, b: float, c: float, x: float, y: float, z: float) -> tuple[float, float, float, float]:
    """The depth of a point p in an ellipsoid, and its gradient.

    The nearest point q of the surface is that with p - q along the normal: q_i = a_i^2 p_i / (u + a_i^2 - a_s^2), where
    a_s is the smallest semi-axis and u puts q on the surface. The nearest point has the largest such u, which is not
    negative. Along the smallest semi-axis q follows from the other coordinates, as u may be too small to divide by.
    """
    least = min(a, b, c)
    da, db, dc = (a - least) * (a + least), (b - least) * (b + least), (c - least) * (c + least)
    # The residual is convex and decreasing in u: from a lower bound, Newton's method rises monotonically to the root.
    u = max(_TINY, abs(a * x) - da, abs(b * y) - db, abs(c * z) - dc)
    for _ in range(_STEPS):
        ex, ey, ez = (a * x / (u + da)) ** 2, (b * y / (u + db)) ** 2, (c * z / (u + dc)) ** 2
        step = 0.5 * (ex + ey + ez - 1.0) / (ex / (u + da) + ey / (u + db) + ez / (u + dc))
        if not step > _LEAST_STEP * u:
            break
        u += step
    qx, qy, qz = a * a * x / (u + da), b * b * y / (u + db), c * c * z / (u + dc)
    if a == least:
        qx = np.copysign(a * np.sqrt(max(0.0, 1.0 - (qy / b) ** 2 - (qz / c) ** 2)), x)
    elif b == least:
        qy = np.copysign(b * np.sqrt(max(0.0, 1.0 - (qx / a) ** 2 - (qz / c) ** 2)), y)
    else:
        qz = np.copysign(c * np.sqrt(max(0.0, 1.0 - (qx / a) ** 2 - (qy / b) ** 2)), z)
    nx, ny, nz = qx / (a * a), qy / (b * b), qz / (c * c)
    norm = np.sqrt(nx * nx + ny * ny + nz * nz)
    nx, ny, nz = nx / norm, ny / norm, nz / norm
    return nx * (qx - x) + ny * (qy - y) + nz * (qz - z), -nx, -ny, -nz


@inlined
def _round_depth(shapes, s, x, y, z):
    """The depth of a point by the round part, and its gradient; infinite if there is none."""
    if shapes.semi_axes[s, 0] > 0.0:
        return _in_ellipsoid(shapes.semi_axes[s, 0], shapes.semi_axes[s, 1], shapes.semi_axes[s, 2], x, y, z)
    height = np.copysign(max(0.0, abs(z) - shapes.half_length[s]), z)
    distance = np.sqrt(x * x + y * y + height * height)
    scale = -1.0 / distance if distance > 0.0 else 0.0
    return shapes.radius[s] - distance, x * scale, y * scale, height * scale


@inlined
def _depth(shapes, s, x, y, z):
    """The depth of a point below the surface of a shape; negative outside, m."""
    depth = _round_depth(shapes, s, x, y, z)[0]
    planes = shapes.planes
    for i in range(shapes.first[s], shapes.first[s + 1]):
        depth = min(depth, planes[i, 3] - planes[i, 0] * x - planes[i, 1] * y - planes[i, 2] * z)
    return depth


@inlined
def _most_in_triangle(shapes, s, t, x, y, z):
    """An upper bound of the depth over a triangle t (9,) with centroid x, y, z.

    Depths are concave, so they lie below any tangent.
    """
    value, gx, gy, gz = _round_depth(shapes, s, x, y, z)
    rise = -np.inf
    for k in range(3):
        rise = max(rise, gx * (t[3 * k] - x) + gy * (t[3 * k + 1] - y) + gz * (t[3 * k + 2] - z))
    most = value + rise
    for i in range(shapes.first[s], shapes.first[s + 1]):
        n = shapes.planes[i]
        least = np.inf
        for k in range(3):
            least = min(least, n[0] * t[3 * k] + n[1] * t[3 * k + 1] + n[2] * t[3 * k + 2])
        most = min(most, n[3] - least)
    return most


@part
def _deepest_in_triangle(shapes: Shapes, s: int, best: float, tolerance: float, todo: OutFloats2) -> float:
    """The greatest depth over the triangle in the first row of `todo` (n, 9), or `best` if that is greater.

    Branch and bound: parts that cannot be deeper are dropped, others are bisected across their longest side.
    """
    for k in range(3):
        best = max(best, _depth(shapes, s, todo[0, 3 * k], todo[0, 3 * k + 1], todo[0, 3 * k + 2]))
    count = 1
    while count > 0:
        count -= 1
        t = todo[count]
        x, y, z = (t[0] + t[3] + t[6]) / 3.0, (t[1] + t[4] + t[7]) / 3.0, (t[2] + t[5] + t[8]) / 3.0
        best = max(best, _depth(shapes, s, x, y, z))
        if _most_in_triangle(shapes, s, t, x, y, z) <= best + tolerance or count + 2 > todo.shape[0]:
            continue
        longest, corner = -1.0, 0
        for k in range(3):
            a, b = 3 * k, 3 * ((k + 1) % 3)
            length = (t[a] - t[b]) ** 2 + (t[a + 1] - t[b + 1]) ** 2 + (t[a + 2] - t[b + 2]) ** 2
            if length > longest:
                longest, corner = length, k
        a, b = 3 * corner, 3 * ((corner + 1) % 3)
        for i in range(9):
            todo[count + 1, i] = t[i]
        for i in range(3):
            middle = 0.5 * (t[a + i] + t[b + i])
            todo[count + 1, a + i] = middle
            t[b + i] = middle
        best = max(best, _depth(shapes, s, t[b], t[b + 1], t[b + 2]))
        count += 2
    return best


@part
def _deepest_in_shape(
    tree: Tree, shapes: Shapes, s: int, X: Floats2, best: float, tolerance: float, enough: float
) -> float:
    """The greatest depth in a shape of the mesh at pose X (3, 4) in the shape's frame, or `best` if greater."""
    spheres, triangles = tree
    leaves = (spheres.shape[0] + 1) // 2
    each = triangles.shape[0] // leaves
    nodes, bounds, todo = np.empty(_LEVELS, dtype=np.int64), np.empty(_LEVELS), np.empty((_LEVELS, 9))
    nodes[0], bounds[0], count = 0, np.inf, 1
    while count > 0 and best <= enough:
        count -= 1
        node = nodes[count]
        if bounds[count] <= best + tolerance:
            continue
        if node >= leaves - 1:
            for k in range((node - leaves + 1) * each, (node - leaves + 2) * each):
                for j in range(3):
                    a = triangles[k, 3 * j : 3 * j + 3]
                    for i in range(3):
                        todo[0, 3 * j + i] = X[i, 0] * a[0] + X[i, 1] * a[1] + X[i, 2] * a[2] + X[i, 3]
                best = _deepest_in_triangle(shapes, s, best, tolerance, todo)
            continue
        for child in range(2 * node + 1, 2 * node + 3):
            a = spheres[child]
            x = X[0, 0] * a[0] + X[0, 1] * a[1] + X[0, 2] * a[2] + X[0, 3]
            y = X[1, 0] * a[0] + X[1, 1] * a[1] + X[1, 2] * a[2] + X[1, 3]
            z = X[2, 0] * a[0] + X[2, 1] * a[1] + X[2, 2] * a[2] + X[2, 3]
            bound = _depth(shapes, s, x, y, z) + a[3]
            if bound > best + tolerance:
                nodes[count], bounds[count] = child, bound
                count += 1
        if count > 1 and nodes[count - 2] == 2 * node + 1 and bounds[count - 2] > bounds[count - 1]:
            nodes[count - 2], nodes[count - 1] = nodes[count - 1], nodes[count - 2]
            bounds[count - 2], bounds[count - 1] = bounds[count - 1], bounds[count - 2]
    return best


@inlined
def _is_before(p, q):
    """A strict order of points."""
    if p[0] != q[0]:
        return p[0] < q[0]
    return p[1] < q[1] if p[1] != q[1] else p[2] < q[2]


@part
def _is_within(tree: Tree, x: float, y: float, z: float, nodes: OutLongs1) -> bool:
    """Whether the winding number of a mesh about a point is positive, by the faces below it; `nodes` is scratch."""
    spheres, triangles = tree
    leaves = (spheres.shape[0] + 1) // 2
    each = triangles.shape[0] // leaves
    x, y = x + _BESIDE[0], y + _BESIDE[1]
    nodes[0], count, winding = 0, 1, 0
    while count > 0:
        count -= 1
        node = nodes[count]
        around = spheres[node]
        if (x - around[0]) ** 2 + (y - around[1]) ** 2 > around[3] ** 2 or around[2] - around[3] > z:
            continue
        if node < leaves - 1:
            nodes[count], nodes[count + 1] = 2 * node + 1, 2 * node + 2
            count += 2
            continue
        for k in range((node - leaves + 1) * each, (node - leaves + 2) * each):
            a, b, c = triangles[k, 0:3], triangles[k, 3:6], triangles[k, 6:9]
            if (b[0] - a[0]) * (c[1] - a[1]) == (b[1] - a[1]) * (c[0] - a[0]):
                continue
            ea = side(b, c, _is_before(b, c), x, y)
            eb = side(c, a, _is_before(c, a), x, y)
            ec = side(a, b, _is_before(a, b), x, y)
            is_crossed = (ea > 0.0) == (eb > 0.0) and (ea > 0.0) == (ec > 0.0)
            if is_crossed and (ea * a[2] + eb * b[2] + ec * c[2]) / (ea + eb + ec) <= z:
                winding += -1 if ea > 0.0 else 1
    return winding > 0


@kernel
def find_deepest(
    tree: Tree,
    shapes: Shapes,
    X_GO: Floats4,
    tolerance: float,
    enough: float,
    depth: OutFloats1,
    deepest: OutLongs1,
) -> None:
    """Fills the greatest depth of a closed mesh with its interior in any of the shapes (b,), m, and which shape (b,).

    Depths are 0 for a pose at which the mesh is in none, and short by at most the tolerance, m; once a pose's depth
    exceeds `enough`, m, the search stops. As depths are concave, the greatest is at the surface of the mesh, or it is
    that of the shape's deepest point.

    Args:
        tree: of the mesh.
        shapes: s of them.
        X_GO: poses of the mesh in the shapes' frames, shape (b, s, 3, 4).
        tolerance: see above.
        enough: see above.
        depth: output.
        deepest: output.
    """
    nodes = np.empty(_LEVELS, dtype=np.int64)
    for b in range(depth.shape[0]):
        depth[b], deepest[b] = 0.0, 0
        for s in range(shapes.radius.shape[0]):
            if depth[b] > enough:
                break
            X, d = X_GO[b, s], shapes.deepest[s]
            x, y, z = d[0] - X[0, 3], d[1] - X[1, 3], d[2] - X[2, 3]
            px = X[0, 0] * x + X[1, 0] * y + X[2, 0] * z
            py = X[0, 1] * x + X[1, 1] * y + X[2, 1] * z
            pz = X[0, 2] * x + X[1, 2] * y + X[2, 2] * z
            if _is_within(tree, px, py, pz, nodes):
                thickness = _depth(shapes, s, d[0], d[1], d[2])
                if thickness > depth[b]:
                    depth[b], deepest[b] = thickness, s
        for s in range(shapes.radius.shape[0]):
            if depth[b] > enough:
                break
            found = _deepest_in_shape(tree, shapes, s, X_GO[b, s], depth[b], tolerance, enough)
            if found > depth[b]:
                depth[b], deepest[b] = found, s


@kernel
def find_depths(shapes: Shapes, p_GQ: Floats2, depth: OutFloats1) -> None:
    """Fills the depths (n,) of points (n, 3) in the first of the shapes, m."""
    for i in range(p_GQ.shape[0]):
        depth[i] = _depth(shapes, 0, p_GQ[i, 0], p_GQ[i, 1], p_GQ[i, 2])
