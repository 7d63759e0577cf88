"""The penetration depth of the hand's spheres in the object, compiled.

Hardly any of the spheres are near the object, and which ones are changes from pose to pose. They are therefore found by
the distances at every fourth node of the grid, which fit into the processor's cache: first for whole neighbourhoods,
then for their spheres, without branches. The grid cells of the spheres that remain are prefetched, so that the
transfers from memory overlap.

Poses are (B, 3, 4); increments (w, v) as in `poses.py`.
"""

from typing import NamedTuple

import numpy as np

from tactopose_drake.core.compilation import inlined, kernel, part
from tactopose_drake.core.kernel_types import (
    Floats1,
    Floats2,
    Floats3,
    OutFloats1,
    OutFloats2,
    OutFloats3,
    OutInts1,
    OutLongs1,
)
from tactopose_drake.core.kernels.grid_kernels import COARSENESS, Grid, interpolate
from tactopose_drake.core.kernels.hand_sphere_kernels import Spheres
from tactopose_drake.core.kernels.pose_kernels import chain
from tactopose_drake.core.kernels.prefetch import prefetch

_OF_COARSE = 1.0 / COARSENESS
# Bounds, in cells, on the distance of a point from its nearest coarse node plus interpolation errors; likewise for a
# fine node.
_COARSE_SLACK = 0.5 * COARSENESS * np.sqrt(3.0) + 0.635
_FINE_SLACK = 1.5


class Depths(NamedTuple):
    """The penetration of neighbourhoods of spheres, see `penetration_depths`."""

    excess: OutFloats2
    points: OutFloats3
    slopes: OutFloats3


class Near(NamedTuple):
    """The neighbourhoods and spheres, of g and h, that may be in the object at one pose.

    Attributes:
        distance: a lower bound of the distance of each neighbourhood's first centre to the surface, shape (g,), m.
        node: the coarse node nearest to that centre, shape (g,).
        groups: the neighbourhoods that remain, shape (g + 1,).
        spheres, group: the spheres that remain, sorted by neighbourhood, and their neighbourhoods, shape (h + 1,).
        place: grid coordinates of their centres, in cells, and distance outside the grid, m, shape (h + 1, 4).
    """

    distance: OutFloats1
    node: OutInts1
    groups: OutLongs1
    spheres: OutLongs1
    group: OutLongs1
    place: OutFloats2


@inlined
def _pose(X):
    """The columns of a pose X (3, 4) as tuples."""
    return (
        (X[0, 0], X[1, 0], X[2, 0]),
        (X[0, 1], X[1, 1], X[2, 1]),
        (X[0, 2], X[1, 2], X[2, 2]),
        (X[0, 3], X[1, 3], X[2, 3]),
    )


@inlined
def _to_grid(pose, origin, inverse_spacing, x, y, z):
    """The grid coordinates, in cells, of a point of P at a pose."""
    a, b, c, t = pose
    dx, dy, dz = x - t[0], y - t[1], z - t[2]
    ux = (a[0] * dx + a[1] * dy + a[2] * dz - origin[0]) * inverse_spacing
    uy = (b[0] * dx + b[1] * dy + b[2] * dz - origin[1]) * inverse_spacing
    uz = (c[0] * dx + c[1] * dy + c[2] * dz - origin[2]) * inverse_spacing
    return ux, uy, uz


@inlined
def _clip(u, limit):
    """The grid coordinate nearest to u along one axis, in cells; 0 for NaN, which must not become an index."""
    inside = u if u > 0.0 else 0.0
    return inside if inside < limit else limit


@inlined
def _look_roughly(ux, uy, uz, limits, shape):
    """The coarse node nearest to a place, and how far the place is outside the grid, in cells."""
    ix, iy, iz = _clip(ux, limits[0]), _clip(uy, limits[1]), _clip(uz, limits[2])
    ox, oy, oz = ux - ix, uy - iy, uz - iz
    i, j, k = np.int32(ix * _OF_COARSE + 0.5), np.int32(iy * _OF_COARSE + 0.5), np.int32(iz * _OF_COARSE + 0.5)
    return (i * shape[0] + j) * shape[1] + k, np.sqrt(ox * ox + oy * oy + oz * oz)


@inlined
def _limits(grid):
    """The index of the last node along each axis."""
    return grid.values.shape[0] - 1.0, grid.values.shape[1] - 1.0, grid.values.shape[2] - 1.0


@part
def _find_near(grid: Grid, spheres: Spheres, X: Floats2, near: Near) -> int:
    """Finds the spheres that may be deeper in the object than is allowed at a pose X (3, 4); returns their number."""
    coarse = spheres.coarse
    rough, shape = coarse.reshape(-1), (np.int32(coarse.shape[1]), np.int32(coarse.shape[2]))
    pose, inverse_spacing, limits, leaders = _pose(X), grid.inverse_spacing, _limits(grid), spheres.leaders
    origin, spacing = (grid.origin[0], grid.origin[1], grid.origin[2]), 1.0 / inverse_spacing
    slack, groups, count = _COARSE_SLACK * spacing, 0, 0
    for g in range(near.distance.shape[0]):
        ux, uy, uz = _to_grid(pose, origin, inverse_spacing, leaders[0, g], leaders[1, g], leaders[2, g])
        near.node[g], outside = _look_roughly(ux, uy, uz, limits, shape)
        near.distance[g] = spacing * outside - slack
    for g in range(near.distance.shape[0]):
        near.distance[g] += rough[np.uintp(near.node[g])]
        near.groups[groups] = g
        groups += 1 if near.distance[g] <= leaders[3, g] - spheres.allowed[g] else 0
    for k in range(groups):
        g = near.groups[k]
        allowed = spheres.allowed[g]
        for i in range(spheres.start[g], spheres.start[g + 1]):
            if spheres.reach[i] - near.distance[g] <= allowed:
                break
            ux, uy, uz = _to_grid(pose, origin, inverse_spacing, spheres.p[i, 0], spheres.p[i, 1], spheres.p[i, 2])
            node, outside = _look_roughly(ux, uy, uz, limits, shape)
            outside *= spacing
            near.spheres[count], near.group[count] = i, g
            near.place[count, 0], near.place[count, 1], near.place[count, 2] = ux, uy, uz
            near.place[count, 3] = outside
            count += 1 if rough[np.uintp(node)] + outside - slack <= spheres.radius[i] - allowed else 0
    return count


@part
def _fetch(grid: Grid, near: Near, count: int) -> None:
    """Prefetches the grid nodes around the first `count` remaining spheres."""
    flat, (nx, ny, nz) = grid.values.reshape(-1), grid.values.shape[:3]
    sy, sx = np.uintp(4 * nz), np.uintp(4 * nz * ny)
    for k in range(count):
        ix, iy, iz = (
            int(_clip(near.place[k, 0], nx - 2.0)),
            int(_clip(near.place[k, 1], ny - 2.0)),
            int(_clip(near.place[k, 2], nz - 2.0)),
        )
        at = np.uintp(4 * ((ix * ny + iy) * nz + iz))
        prefetch(flat, at)
        prefetch(flat, at + sy)
        prefetch(flat, at + sx)
        prefetch(flat, at + sx + sy)


@part
def _measure(grid: Grid, spheres: Spheres, near: Near, count: int, depths: Depths, b: int) -> None:
    """Writes the penetration of the `count` remaining spheres into row b of the depths, which is 0 on entry.

    A sphere is interpolated only if the distance at its nearest node does not rule out that it is the deepest so far.
    """
    flat, origin, inverse_spacing, limits = grid.values.reshape(-1), grid.origin, grid.inverse_spacing, _limits(grid)
    nx, ny, nz = grid.values.shape[0], grid.values.shape[1], grid.values.shape[2]
    sy, sx, spacing = np.uintp(4 * nz), np.uintp(4 * nz * ny), 1.0 / inverse_spacing
    points, slopes, before, depth = depths.points, depths.slopes, -1, 0.0
    for k in range(count):
        i, g, outside = near.spheres[k], near.group[k], near.place[k, 3]
        if g != before:
            before, depth = g, spheres.allowed[g]
        x, y, z = near.place[k, 0], near.place[k, 1], near.place[k, 2]
        ux, uy, uz = _clip(x, limits[0]), _clip(y, limits[1]), _clip(z, limits[2])
        node = (int(ux + 0.5) * ny + int(uy + 0.5)) * nz + int(uz + 0.5)
        if flat[np.uintp(4 * node)] + outside - _FINE_SLACK * spacing > spheres.radius[i] - depth:
            continue
        ix, iy, iz = min(int(ux), nx - 2), min(int(uy), ny - 2), min(int(uz), nz - 2)
        node = (ix * ny + iy) * nz + iz
        phi, dx, dy, dz = interpolate(flat, np.uintp(4 * node), sx, sy, ux - ix, uy - iy, uz - iz)
        if spheres.radius[i] - (phi + outside) > depth:
            depth = spheres.radius[i] - (phi + outside)
            depths.excess[b, g] = depth - spheres.allowed[g]
            points[b, g, 0] = origin[0] + spacing * x
            points[b, g, 1] = origin[1] + spacing * y
            points[b, g, 2] = origin[2] + spacing * z
            # Outside the grid the distance grows along the direction away from it.
            slopes[b, g, 0] = dx * inverse_spacing if x == ux else (x - ux) * spacing / outside
            slopes[b, g, 1] = dy * inverse_spacing if y == uy else (y - uy) * spacing / outside
            slopes[b, g, 2] = dz * inverse_spacing if z == uz else (z - uz) * spacing / outside


@inlined
def make_near(spheres):
    """Allocates `Near` for one pose."""
    h, g = spheres.p.shape[0], spheres.start.shape[0] - 1
    return Near(
        np.empty(g),
        np.empty(g, dtype=np.int32),
        np.empty(g + 1, dtype=np.int64),
        np.empty(h + 1, dtype=np.int64),
        np.empty(h + 1, dtype=np.int64),
        np.empty((h + 1, 4)),
    )


@inlined
def make_depths(spheres):
    """Allocates `Depths` for one pose."""
    g = spheres.weight.shape[0]
    return Depths(np.empty((1, g)), np.empty((1, g, 3)), np.empty((1, g, 3)))


@part
def find_depths(grid: Grid, spheres: Spheres, X: Floats2, near: Near, depths: Depths, b: int) -> None:
    """Writes the penetration of each neighbourhood at a pose X (3, 4) into row b of the depths."""
    count = _find_near(grid, spheres, X, near)
    _fetch(grid, near, count)
    depths.excess[b] = 0.0
    _measure(grid, spheres, near, count, depths, b)


@part
def penetration_cost(spheres: Spheres, depths: Depths) -> float:
    """Half the sum of squared residuals of the first row of the depths."""
    cost = 0.0
    for g in range(spheres.weight.shape[0]):
        residual = spheres.weight[g] * depths.excess[0, g]
        cost += 0.5 * residual * residual
    return cost


@part
def add_penetration(
    spheres: Spheres, depths: Depths, X: Floats2, J: OutFloats1, gradient: OutFloats1, hessian: OutFloats2
) -> None:
    """Adds to gradient (6,) and Gauss-Newton Hessian (6, 6); most neighbourhoods are clear and contribute nothing."""
    for g in range(spheres.weight.shape[0]):
        residual = spheres.weight[g] * depths.excess[0, g]
        if residual > 0.0:
            chain(depths.slopes[0, g], depths.points[0, g], X, -spheres.weight[g], J)
            for a in range(6):
                gradient[a] += residual * J[a]
                for c in range(6):
                    hessian[a, c] += J[a] * J[c]


@kernel
def penetration_depths(grid: Grid, spheres: Spheres, X: Floats3, depths: Depths) -> None:
    """The penetration of each neighbourhood of spheres at each pose beyond what is allowed, excess (B, g) >= 0.

    Where that is positive, the centre of the deepest sphere in O is written to points (B, g, 3), and the gradient of
    the distance there to slopes (B, g, 3).
    """
    near = make_near(spheres)
    for b in range(X.shape[0]):
        find_depths(grid, spheres, X[b], near, depths, b)


@kernel
def penetration_jacobian(weight: Floats1, X: Floats3, depths: Depths, jacobian: OutFloats3) -> None:
    """The derivatives (B, g, 6), with respect to the increment, of the residuals: weights (g,) times the excess."""
    excess, points, slopes = depths
    for b in range(X.shape[0]):
        for g in range(excess.shape[1]):
            jacobian[b, g] = 0.0
            if excess[b, g] > 0.0:
                chain(slopes[b, g], points[b, g], X[b], -weight[g], jacobian[b, g])


@kernel
def penetration_costs(grid: Grid, spheres: Spheres, X: Floats3, cost: OutFloats1) -> None:
    """Half the sums (B,) of squared residuals."""
    near, depths = make_near(spheres), make_depths(spheres)
    for b in range(X.shape[0]):
        find_depths(grid, spheres, X[b], near, depths, 0)
        cost[b] = penetration_cost(spheres, depths)


@kernel
def penetration_normal_equations(
    grid: Grid, spheres: Spheres, X: Floats3, cost: OutFloats1, gradient: OutFloats2, hessian: OutFloats3
) -> None:
    """Cost (B,), gradient (B, 6) and Gauss-Newton Hessian (B, 6, 6)."""
    near, depths, J = make_near(spheres), make_depths(spheres), np.empty(6)
    for b in range(X.shape[0]):
        find_depths(grid, spheres, X[b], near, depths, 0)
        cost[b], gradient[b], hessian[b] = penetration_cost(spheres, depths), 0.0, 0.0
        add_penetration(spheres, depths, X[b], J, gradient[b], hessian[b])
