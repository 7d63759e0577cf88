"""Intrinsic contacts in closed form, on rods and ellipsoids, and starting points for the iteration, compiled.

Everything is in the surface's frame F, for a wrench divided by its force: f is a unit vector and the moment m a length.
`surface_kernels.py` says what a surface is, `intrinsic_contact.py` explains the equations.
"""

import math

from tactopose_drake.core.compilation import part
from tactopose_drake.core.kernel_types import Floats1, OutFloats1, Triple
from tactopose_drake.core.surfaces.surface_kernels import ROD, SMOOTH, project

EDGE = 1e-9  # tolerance at the edge of the admissible part, relative to the extent


@part
def closed_form(kind: int, shape: Floats1, m: Triple, f: Triple, q: OutFloats1) -> bool:
    """The contact q on a rod or an ellipsoid (for a superquadric: on the ellipsoid of its semi-axes)."""
    if kind == ROD:
        return rod_contact(shape, m, f, q)
    return _ellipsoid_contact(shape[0], shape[1], shape[2], m, f, q)


@part
def _ellipsoid_contact(a: float, b: float, c: float, m: Triple, f: Triple, q: OutFloats1) -> bool:
    """The compressive contact q on an ellipsoid; False if there is none.

    With q = (a u_x, b u_y, c u_z), |u| = 1, equation 2.2 becomes that of a unit sphere, u x g + k u = w. Its product
    with g and its length give k (u.g) = w.g and |w|^2 = |g|^2 - (u.g)^2 + k^2: a quadratic in (u.g)^2 with one root
    that is not negative. The two signs of its root are the pushing and the pulling contact.
    """
    g0, g1, g2 = b * c * f[0], c * a * f[1], a * b * f[2]
    w0, w1, w2 = a * m[0], b * m[1], c * m[2]
    gg = g0 * g0 + g1 * g1 + g2 * g2
    gw = g0 * w0 + g1 * w1 + g2 * w2
    difference = gg - (w0 * w0 + w1 * w1 + w2 * w2)
    root = math.sqrt(difference * difference + 4.0 * gw * gw)
    square = 0.5 * (difference + root) if difference > 0.0 else 2.0 * gw * gw / (root - difference)
    if not square > 1e-24 * gg:
        return False
    ug = -math.sqrt(square)
    k = gw / ug
    s = 1.0 / (k * k + gg)
    q[0] = a * s * (k * w0 + ug * g0 + g1 * w2 - g2 * w1)
    q[1] = b * s * (k * w1 + ug * g1 + g2 * w0 - g0 * w2)
    q[2] = c * s * (k * w2 + ug * g2 + g0 * w1 - g1 * w0)
    return True


@part
def rod_contact(shape: Floats1, m: Triple, f: Triple, q: OutFloats1) -> bool:
    """The compressive contact q on a cylinder (infinite if lo or hi is) with hemispheres at lo and hi.

    On the side n_z = 0, so m_z = R (n x f)_z gives n, and m along z x n gives the height.
    """
    R = shape[0]
    h2 = f[0] * f[0] + f[1] * f[1]
    sine = m[2] / R
    square = h2 - sine * sine
    if square > 1e-24:
        fn = -math.sqrt(square)
        nx, ny = (fn * f[0] + sine * f[1]) / h2, (fn * f[1] - sine * f[0]) / h2
        z = (nx * m[1] - ny * m[0] + R * f[2]) / fn
        if shape[1] <= z <= shape[2]:
            q[0], q[1], q[2] = R * nx, R * ny, z
            return True
    for side in (1.0, -1.0):
        end = shape[2] if side > 0.0 else shape[1]
        if math.isfinite(end):
            m_end = (m[0] + end * f[1], m[1] - end * f[0], m[2])
            if _ellipsoid_contact(R, R, R, m_end, f, q) and side * q[2] >= -EDGE * R:
                q[2] += end
                return True
    return False


@part
def facing_point(kind: int, shape: Floats1, f: Triple, q: OutFloats1) -> bool:
    """A starting point for the iteration: where the surface squarely faces the force; False if there is none."""
    if kind == SMOOTH:
        for i in range(3):
            q[i] = -shape[i] * shape[i] * f[i]
        project(kind, shape, q)
        return True
    end = shape[2] if f[2] < 0.0 else shape[1]
    if math.isfinite(end):
        q[0], q[1], q[2] = -shape[0] * f[0], -shape[0] * f[1], end - shape[0] * f[2]
        return True
    h = math.sqrt(f[0] * f[0] + f[1] * f[1])
    if h < 1e-9:
        return False
    q[0], q[1], q[2] = -shape[0] * f[0] / h, -shape[0] * f[1] / h, min(max(0.0, shape[1]), shape[2])
    return True
