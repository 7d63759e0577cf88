"""The inner loops of the evidence beyond contact, in the style of `pose_kernels.py`: penetration, friction, balance.

Poses are (B, 3, 4); increments (w, v) as in `poses.py`.
"""

from typing import NamedTuple

import numpy as np

from tactopose_drake.core.compilation import kernel
from tactopose_drake.core.kernel_types import (
    Floats1,
    Floats2,
    Floats3,
    Longs1,
    OutFlags1,
    OutFloats1,
    OutFloats2,
    OutFloats3,
    OutLongs1,
)
from tactopose_drake.core.kernels.grid_kernels import Grid, interpolate, look_up_with_derivative
from tactopose_drake.core.kernels.pose_kernels import chain, rotate_to_object, to_object

# Bounds the derivative of the angle between two directions where they are parallel.
_SOFT_SINE = 1e-9


class Spheres(NamedTuple):
    """The hand's spheres in neighbourhoods, read-only: neighbourhood g is start[g]:start[g + 1].

    Attributes:
        p: centres in P, shape (h, 3), m.
        radius: shape (h,), m.
        reach: no sphere reaches further from the centre of its neighbourhood's first, shape (h,), m.
        start: shape (g + 1,).
    """

    p: Floats2
    radius: Floats1
    reach: Floats1
    start: Longs1


class Depths(NamedTuple):
    """How deep neighbourhoods of spheres are in the object, see `penetration_depths`."""

    excess: OutFloats2
    points: OutFloats3
    slopes: OutFloats3


class Forces(NamedTuple):
    """Forces, read-only: points (k, 3) and directions (k, 3) in P, and the variance (k,) of their angle to normals."""

    p: Floats2
    u: Floats2
    variance: Floats1


@kernel
def gather_neighbourhoods(
    p: Floats2, order: Longs1, width: float, group: OutLongs1, distance: OutFloats1, leads: OutFlags1
) -> None:
    """Parts points (h, 3) into groups (h,): the next in the order that is left takes all that are left within a width.

    Such a one leads (h,) its group; distances (h,) are from there.
    """
    group[:] = -1
    leads[:] = False
    count = 0
    for seed in order:
        if group[seed] >= 0:
            continue
        leads[seed] = True
        for i in range(p.shape[0]):
            if group[i] < 0:
                dx, dy, dz = p[i, 0] - p[seed, 0], p[i, 1] - p[seed, 1], p[i, 2] - p[seed, 2]
                d = np.sqrt(dx * dx + dy * dy + dz * dz)
                if d <= width:
                    group[i], distance[i] = count, d
        count += 1


@kernel
def penetration_depths(grid: Grid, spheres: Spheres, allowed: float, X: Floats3, depths: Depths) -> None:
    """How deep each neighbourhood of spheres is in the object at each pose beyond what is allowed, excess (B, g) >= 0.

    Neighbourhood g is start[g]:start[g + 1]. Where it is in the object, the centre of its deepest sphere in O goes to
    points (B, g, 3), and the derivative of the distance there to slopes (B, g, 3).

    No sphere reaches further than `reach` (h,) from the centre of the neighbourhood's first, so where that one is
    mostly settles it: by the grid's bounds, or by the node nearest to it. A sphere is looked up in full only if its own
    node does not tell that it is no deeper than what was found.

    One body, without calls that are given arrays: their reference counts would cost more than the arithmetic.
    """
    values, origin, inverse_spacing = grid
    p, radius, reach, start = spheres
    excess, points, slopes = depths
    flat = values.reshape(-1)
    nx, ny, nz = values.shape[0], values.shape[1], values.shape[2]
    x0, y0, z0, spacing = origin[0], origin[1], origin[2], 1.0 / inverse_spacing
    mx, my, mz = nx - 1.0, ny - 1.0, nz - 1.0
    sy, sx = np.uintp(4 * nz), np.uintp(4 * nz * ny)
    for b in range(X.shape[0]):
        R00, R01, R02, R10, R11, R12 = X[b, 0, 0], X[b, 0, 1], X[b, 0, 2], X[b, 1, 0], X[b, 1, 1], X[b, 1, 2]
        R20, R21, R22, tx, ty, tz = X[b, 2, 0], X[b, 2, 1], X[b, 2, 2], X[b, 0, 3], X[b, 1, 3], X[b, 2, 3]
        for g in range(start.shape[0] - 1):
            first, depth, nearest = start[g], allowed, 0.0
            for i in range(first, start[g + 1]):
                # How far the surface may be from this centre and matter: to any neighbour, then to this one alone.
                way = reach[i] if i == first else radius[i]
                if i > first and reach[i] - nearest <= depth:
                    break
                way -= depth
                dx, dy, dz = p[i, 0] - tx, p[i, 1] - ty, p[i, 2] - tz
                ux = (R00 * dx + R10 * dy + R20 * dz - x0) * inverse_spacing
                uy = (R01 * dx + R11 * dy + R21 * dz - y0) * inverse_spacing
                uz = (R02 * dx + R12 * dy + R22 * dz - z0) * inverse_spacing
                ox = ux if ux < 0.0 else max(ux - mx, 0.0)
                oy = uy if uy < 0.0 else max(uy - my, 0.0)
                oz = uz if uz < 0.0 else max(uz - mz, 0.0)
                outside = 0.0
                if ox != 0.0 or oy != 0.0 or oz != 0.0:
                    outside = spacing * np.sqrt(ox * ox + oy * oy + oz * oz)
                if not outside <= max(way, 0.0):  # True for NaN too, which must not become an index.
                    if i == first:
                        break
                    continue
                ux, uy, uz = ux - ox, uy - oy, uz - oz
                at = (int(ux + 0.5) * ny + int(uy + 0.5)) * nz + int(uz + 0.5)
                # A node's distance is off by less than a cell; the other half is for the interpolation.
                least = flat[np.uintp(4 * at)] + outside - 1.5 * spacing
                if i == first:
                    nearest = least
                    if least > way:
                        break
                if least > radius[i] - depth:
                    continue
                ix, iy, iz = min(int(ux), nx - 2), min(int(uy), ny - 2), min(int(uz), nz - 2)
                at = (ix * ny + iy) * nz + iz
                phi, dx, dy, dz = interpolate(flat, np.uintp(4 * at), sx, sy, ux - ix, uy - iy, uz - iz)
                phi += outside
                if radius[i] - phi > depth:
                    depth = radius[i] - phi
                    points[b, g, 0] = x0 + spacing * (ux + ox)
                    points[b, g, 1] = y0 + spacing * (uy + oy)
                    points[b, g, 2] = z0 + spacing * (uz + oz)
                    # Beyond the grid the distance grows along the way there.
                    slopes[b, g, 0] = dx * inverse_spacing if ox == 0.0 else ox * spacing / outside
                    slopes[b, g, 1] = dy * inverse_spacing if oy == 0.0 else oy * spacing / outside
                    slopes[b, g, 2] = dz * inverse_spacing if oz == 0.0 else oz * spacing / outside
            excess[b, g] = depth - allowed


@kernel
def penetration_jacobian(weight: float, X: Floats3, depths: Depths, jacobian: OutFloats3) -> None:
    """The derivatives (B, g, 6) of the residuals, weight times the excess, by the increment."""
    excess, points, slopes = depths
    for b in range(X.shape[0]):
        for g in range(excess.shape[1]):
            jacobian[b, g] = 0.0
            if excess[b, g] > 0.0:
                chain(slopes[b, g], points[b, g], X[b], -weight, jacobian[b, g])


@kernel
def penetration_normal_equations(
    weight: float,
    X: Floats3,
    depths: Depths,
    cost: OutFloats1,
    gradient: OutFloats2,
    hessian: OutFloats3,
) -> None:
    """Cost (B,), gradient (B, 6) and Gauss-Newton Hessian (B, 6, 6): most neighbourhoods are clear and add nothing."""
    excess, points, slopes = depths
    J = np.empty(6)
    for b in range(X.shape[0]):
        cost[b] = 0.0
        gradient[b] = 0.0
        hessian[b] = 0.0
        for g in range(excess.shape[1]):
            residual = weight * excess[b, g]
            if residual > 0.0:
                cost[b] += 0.5 * residual * residual
                chain(slopes[b, g], points[b, g], X[b], -weight, J)
                for a in range(6):
                    gradient[b, a] += residual * J[a]
                    for c in range(6):
                        hessian[b, a, c] += J[a] * J[c]


@kernel
def friction_residuals(
    grid: Grid, forces: Forces, cone: float, X: Floats3, residuals: OutFloats2, jacobian: OutFloats3
) -> None:
    """Residuals (B, k), see `objectives.friction_cone`, and their Jacobian (B, k, 6) by the increment.

    cone is the friction angle, rad.
    """
    p, u, variance = forces
    q, f, field, slope, row = np.empty(3), np.empty(3), np.empty(4), np.empty((4, 3)), np.empty(3)
    for b in range(X.shape[0]):
        for i in range(p.shape[0]):
            residuals[b, i] = 0.0
            jacobian[b, i] = 0.0
            to_object(X[b], p[i], q)
            look_up_with_derivative(grid, q[0], q[1], q[2], field, slope)
            rotate_to_object(X[b], u[i], f)
            n = field[1:]
            square = n[0] * n[0] + n[1] * n[1] + n[2] * n[2]
            along = f[0] * n[0] + f[1] * n[1] + f[2] * n[2]
            beside = np.sqrt(max(square - along * along, _SOFT_SINE**2))
            angle = np.arctan2(beside, along)
            if angle <= cone:
                continue
            # The mean of unit vectors is as short as they are spread, see `surface_contact_kernels.normal_weight`.
            total = variance[i] + 0.5 * max(0.0, 1.0 - square)
            weight = 1.0 / np.sqrt(total)
            residuals[b, i] = weight * (angle - cone)
            shrink = 0.5 * (angle - cone) / total if square < 1.0 else 0.0
            row[:] = 0.0
            for c in range(3):
                # The derivative of the angle by the normal, and of the weight by its length.
                part = (along * (n[c] - along * f[c]) / beside - beside * f[c]) / (square + _SOFT_SINE) + shrink * n[c]
                for a in range(3):
                    row[a] += part * slope[c + 1, a]
            chain(row, q, X[b], weight, jacobian[b, i])
            # The force turns with the increment too: d(R^T u) = f x w.
            weight /= beside
            jacobian[b, i, 0] -= weight * (n[1] * f[2] - n[2] * f[1])
            jacobian[b, i, 1] -= weight * (n[2] * f[0] - n[0] * f[2])
            jacobian[b, i, 2] -= weight * (n[0] * f[1] - n[1] * f[0])


@kernel
def balance_residuals(
    A: Floats2, offset: Floats1, c: Floats1, X: Floats3, residuals: OutFloats2, jacobian: OutFloats3
) -> None:
    """Residuals (B, m) that are linear in where a point c (3,) of the object is: A (R c + t) + offset.

    A is (m, 3), offset (m,). With their Jacobian (B, m, 6) by the increment.
    """
    for b in range(X.shape[0]):
        for k in range(A.shape[0]):
            x = A[k, 0] * X[b, 0, 0] + A[k, 1] * X[b, 1, 0] + A[k, 2] * X[b, 2, 0]
            y = A[k, 0] * X[b, 0, 1] + A[k, 1] * X[b, 1, 1] + A[k, 2] * X[b, 2, 1]
            z = A[k, 0] * X[b, 0, 2] + A[k, 1] * X[b, 1, 2] + A[k, 2] * X[b, 2, 2]
            residuals[b, k] = offset[k] + x * c[0] + y * c[1] + z * c[2]
            J = jacobian[b, k]
            # d(R c) = R (w x c).
            J[0], J[1], J[2] = c[1] * z - c[2] * y, c[2] * x - c[0] * z, c[0] * y - c[1] * x
            for a in range(3):
                residuals[b, k] += A[k, a] * X[b, a, 3]
                J[3 + a] = A[k, a]
