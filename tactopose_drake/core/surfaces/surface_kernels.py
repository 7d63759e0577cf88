"""Fingertip surfaces S(q) = 0, compiled: the value, gradient and Hessian at points of the surface's frame F.

A surface is a kind and eight numbers:
    SMOOTH: semi-axes a, b, c; exponents e1, e2; z_min, z_max; extent      (sphere and ellipsoid: e1 = e2 = 1)
    ROD:    radius, lo, hi; two unused; z_min, z_max; extent               (distance from the axis between lo and hi)
S is the square of the surface's gauge minus one: S(s q) = s^2 (S(q) + 1) - 1 about the centre, or a rod's axis. Only
points with z_min <= z <= z_max can be touched.
"""

import math

import numpy as np

from tactopose_drake.core.compilation import kernel, part
from tactopose_drake.core.kernel_types import Floats1, Floats2, OutFloats1, OutFloats2, OutFloats3

SMOOTH, ROD = 0, 1

# On a plane of symmetry a superquadric's curvature is 0 or infinite. Coordinates are clamped to this distance from it,
# relative to the size, before powers are taken, so that both stay finite.
_TINY = 1e-12


@kernel
def evaluate(
    kind: int, shape: Floats1, points: Floats2, value: OutFloats1, gradient: OutFloats2, hessian: OutFloats3
) -> None:
    """Fills value (n,), gradient (n, 3) and hessian (n, 3, 3) of S at points (n, 3) in F."""
    for i in range(len(points)):
        value[i] = evaluate_one(kind, shape, points[i, 0], points[i, 1], points[i, 2], gradient[i], hessian[i])


@part
def evaluate_one(kind: int, shape: Floats1, x: float, y: float, z: float, g: OutFloats1, H: OutFloats2) -> float:
    """S at one point; fills its gradient g and Hessian H."""
    if kind == SMOOTH and not (shape[3] == 1.0 and shape[4] == 1.0):
        return _superquadric(shape, x, y, z, g, H) - 1.0
    a, b, c = shape[0], shape[1], shape[2]
    h_zz = 2.0 / (c * c)
    if kind == ROD:
        a = b = c = shape[0]
        axis = min(max(z, shape[1]), shape[2])
        h_zz = 2.0 / (c * c) if axis != z else 0.0
        z -= axis
    H[:] = 0.0
    H[0, 0], H[1, 1], H[2, 2] = 2.0 / (a * a), 2.0 / (b * b), h_zz
    g[0], g[1], g[2] = 2.0 * x / (a * a), 2.0 * y / (b * b), 2.0 * z / (c * c)
    return 0.5 * (g[0] * x + g[1] * y + g[2] * z) - 1.0


@kernel
def _superquadric(shape: Floats1, x: float, y: float, z: float, g: OutFloats1, H: OutFloats2) -> float:
    """Squared gauge N^2 of a superquadric; fills gradient g and Hessian H.

    The gauge is a nested norm, N = |(r, Z)| with r = |(X, Y)| in the p-norms p1 = 2 / e1 and p2 = 2 / e2, of
    X = |x| / a, ... Powers are taken of ratios such as X / r <= 1, so nothing overflows.
    """
    p1, p2 = 2.0 / shape[3], 2.0 / shape[4]
    X, Y, Z = abs(x) / shape[0], abs(y) / shape[1], abs(z) / shape[2]
    r = (X**p2 + Y**p2) ** (1.0 / p2)
    N = (r**p1 + Z**p1) ** (1.0 / p1)
    X, Y = (max(X / r, _TINY), max(Y / r, _TINY)) if r > 0.0 else (1.0, _TINY)
    r, Z = max(r / N, _TINY), max(Z / N, _TINY)
    N_r, N_Z = r ** (p1 - 1.0), Z ** (p1 - 1.0)
    r_X, r_Y = X ** (p2 - 1.0), Y ** (p2 - 1.0)
    # N times the second derivatives of N, and N N_r times those of r
    N_rr, N_rZ, N_ZZ = (
        (p1 - 1.0) * r ** (p1 - 2.0) * Z**p1,
        (1.0 - p1) * N_r * N_Z,
        (p1 - 1.0) * r**p1 * Z ** (p1 - 2.0),
    )
    k = (p2 - 1.0) * r ** (p1 - 2.0)
    r_XX, r_XY, r_YY = k * X ** (p2 - 2.0) * Y**p2, -k * r_X * r_Y, k * X**p2 * Y ** (p2 - 2.0)
    # S is even in each coordinate, so on a plane of symmetry the derivatives that are odd in it are zero
    sx, sy, sz = np.sign(x) / shape[0], np.sign(y) / shape[1], np.sign(z) / shape[2]
    u, v, w = N_r * r_X * sx, N_r * r_Y * sy, N_Z * sz
    g[0], g[1], g[2] = 2.0 * N * u, 2.0 * N * v, 2.0 * N * w
    H[0, 0] = 2.0 * (u * u + (N_rr * r_X * r_X + r_XX) / shape[0] ** 2)
    H[1, 1] = 2.0 * (v * v + (N_rr * r_Y * r_Y + r_YY) / shape[1] ** 2)
    H[2, 2] = 2.0 * (w * w + N_ZZ / shape[2] ** 2)
    H[0, 1] = H[1, 0] = 2.0 * (u * v + (N_rr * r_X * r_Y + r_XY) * sx * sy)
    H[0, 2] = H[2, 0] = 2.0 * (u * w + N_rZ * r_X * sx * sz)
    H[1, 2] = H[2, 1] = 2.0 * (v * w + N_rZ * r_Y * sy * sz)
    return N * N


@kernel
def project(kind: int, shape: Floats1, q: OutFloats1) -> None:
    """Moves q (3,) onto the surface, along the ray from the centre or from the rod's axis."""
    x, y, z, axis = q[0], q[1], q[2], 0.0
    if kind == ROD:
        axis = min(max(z, shape[1]), shape[2])
        gauge = math.sqrt(x * x + y * y + (z - axis) ** 2) / shape[0]
    else:
        p1, p2 = 2.0 / shape[3], 2.0 / shape[4]
        r = ((abs(x) / shape[0]) ** p2 + (abs(y) / shape[1]) ** p2) ** (1.0 / p2)
        gauge = (r**p1 + (abs(z) / shape[2]) ** p1) ** (1.0 / p1)
    q[0], q[1], q[2] = x / gauge, y / gauge, axis + (z - axis) / gauge
