"""Compiled inner loop of the intrinsic contact solver: surfaces S(q) = 0, closed forms, Newton's method.

Everything here lives in the surface's frame F, for a wrench divided by its force: f is a unit vector and the moment m a
length. `intrinsic_contact.py` explains the equations. One file, because numba's cache does not notice a change in
another one.

A surface is a kind and eight numbers:
    SMOOTH: semi-axes a, b, c; exponents e1, e2; z_min, z_max; extent      (sphere and ellipsoid: e1 = e2 = 1)
    ROD:    radius, lo, hi; two unused; z_min, z_max; extent               (distance from the axis between lo and hi)
S is the square of the surface's gauge minus one: S(s q) = s^2 (S(q) + 1) - 1 about the axis point. Only points with
z_min <= z <= z_max can be touched.
"""

import math

import numpy as np
from numba import njit

SMOOTH, ROD = 0, 1
VALID, NOT_FINITE, TOO_WEAK, MISSES, TENSION, OUTSIDE, FRICTION, TORQUE, LAYER = range(9)
RESULT_SIZE = 18  # p, n, normal force, friction force, local torque (three each), residual, deformation, iterations

# On a plane of symmetry a superquadric's curvature is 0 or infinite; a coordinate this far from it, relative to the
# size, is the nearest that powers are taken of, so both stay finite.
_TINY = 1e-12
_MAX_ITERATIONS = 60
_MIN_FRACTION = 1e-4  # of a Newton step, below which the line search gives up
_MIN_STRIDE = 4e-3  # of the way from the closed form to the surface, below which following it gives up
_EXTRA = 0.2  # lever arm of the moment that keeps f.m off zero on that way, relative to the extent
_EDGE = 1e-9  # rounding error allowed at the edge of the admissible part, relative to the extent
# Friction over normal force (84 degrees) at which a wrench counts as passing the surface by: the equations also have a
# contact for a line far off, one that would hang on almost nothing but friction and local torque.
_GRAZING = 10.0


@njit(cache=True, error_model="numpy")
def _superquadric(shape, x, y, z, g, H):  # type: ignore[no-untyped-def]
    """Squared gauge N^2 of a superquadric; fills gradient g and Hessian H.

    The gauge is a norm of norms, N = |(r, Z)| with r = |(X, Y)| in the p-norms p1 = 2 / e1 and p2 = 2 / e2, of
    X = |x| / a, ... Ratios such as X / r <= 1 carry the powers, so nothing overflows.
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


@njit(cache=True, error_model="numpy")
def _evaluate(kind, shape, x, y, z, g, H):  # type: ignore[no-untyped-def]
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


@njit(cache=True, error_model="numpy")
def evaluate(kind, shape, points, value, gradient, hessian):  # type: ignore[no-untyped-def]
    """Fills value (n,), gradient (n, 3) and hessian (n, 3, 3) of S at points (n, 3) in F."""
    for i in range(len(points)):
        value[i] = _evaluate(kind, shape, points[i, 0], points[i, 1], points[i, 2], gradient[i], hessian[i])


@njit(cache=True, error_model="numpy")
def project(kind, shape, q):  # type: ignore[no-untyped-def]
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


@njit(cache=True, error_model="numpy")
def _ellipsoid_contact(a, b, c, m, f, q):  # type: ignore[no-untyped-def]
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


@njit(cache=True, error_model="numpy")
def _rod_contact(shape, m, f, q):  # type: ignore[no-untyped-def]
    """The compressive contact q on a cylinder (endless where lo or hi is infinite) with hemispheres at lo and hi.

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
            if _ellipsoid_contact(R, R, R, m_end, f, q) and side * q[2] >= -_EDGE * R:
                q[2] += end
                return True
    return False


@njit(cache=True, error_model="numpy")
def _closed_form(kind, shape, m, f, q):  # type: ignore[no-untyped-def]
    """The contact q on a rod or an ellipsoid (for a superquadric: on the ellipsoid of its semi-axes)."""
    if kind == ROD:
        return _rod_contact(shape, m, f, q)
    return _ellipsoid_contact(shape[0], shape[1], shape[2], m, f, q)


@njit(cache=True, error_model="numpy")
def _facing_point(kind, shape, f, q):  # type: ignore[no-untyped-def]
    """A start for the iteration: a point of the surface that faces the force squarely; False if there is none."""
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


@njit(cache=True, error_model="numpy")
def linearize(kind, shape, m, f, compliance, q, g, H, out):  # type: ignore[no-untyped-def]
    """The equations at q, out (18,): residual (2), its Jacobian (2x2), f.n, torque; n, t1, t2; largest curvature.

    The residual is the part of e = m - p x f in the tangent plane (t1, t2); the rest, e.n, is the local torque. Its
    Jacobian is to a step along t1, t2: with the surface's curvature W (dn = W t), f_t the friction and the deformation
    d = -compliance f.n, p = q - d n,
        J = (f.n) [n]x (1 - d W) - compliance (n x f_t) (W f_t)^T - (e.n) W.
    """
    _evaluate(kind, shape, q[0], q[1], q[2], g, H)
    length = math.sqrt(g[0] * g[0] + g[1] * g[1] + g[2] * g[2])
    n0, n1, n2 = g[0] / length, g[1] / length, g[2] / length
    fn = f[0] * n0 + f[1] * n1 + f[2] * n2
    depth = -compliance * fn
    p0, p1, p2 = q[0] - depth * n0, q[1] - depth * n1, q[2] - depth * n2
    e0 = m[0] - (p1 * f[2] - p2 * f[1])
    e1 = m[1] - (p2 * f[0] - p0 * f[2])
    e2 = m[2] - (p0 * f[1] - p1 * f[0])
    torque = e0 * n0 + e1 * n1 + e2 * n2

    sign = math.copysign(1.0, n2)
    a = -1.0 / (sign + n2)
    t0, t1, t2 = 1.0 + sign * n0 * n0 * a, sign * n0 * n1 * a, -sign * n0
    s0, s1, s2 = n0 * n1 * a, sign + n1 * n1 * a, -n1
    u0 = (H[0, 0] * t0 + H[0, 1] * t1 + H[0, 2] * t2) / length
    u1 = (H[1, 0] * t0 + H[1, 1] * t1 + H[1, 2] * t2) / length
    u2 = (H[2, 0] * t0 + H[2, 1] * t1 + H[2, 2] * t2) / length
    W11, W12 = t0 * u0 + t1 * u1 + t2 * u2, s0 * u0 + s1 * u1 + s2 * u2
    W22 = (
        s0 * (H[0, 0] * s0 + H[0, 1] * s1 + H[0, 2] * s2)
        + s1 * (H[1, 0] * s0 + H[1, 1] * s1 + H[1, 2] * s2)
        + s2 * (H[2, 0] * s0 + H[2, 1] * s1 + H[2, 2] * s2)
    ) / length
    f1, f2 = f[0] * t0 + f[1] * t1 + f[2] * t2, f[0] * s0 + f[1] * s1 + f[2] * s2
    Wf1, Wf2 = compliance * (W11 * f1 + W12 * f2), compliance * (W12 * f1 + W22 * f2)

    out[0], out[1] = e0 * t0 + e1 * t1 + e2 * t2, e0 * s0 + e1 * s1 + e2 * s2
    out[2] = fn * depth * W12 + f2 * Wf1 - torque * W11
    out[3] = fn * (depth * W22 - 1.0) + f2 * Wf2 - torque * W12
    out[4] = fn * (1.0 - depth * W11) - f1 * Wf1 - torque * W12
    out[5] = -fn * depth * W12 - f1 * Wf2 - torque * W22
    out[6], out[7] = fn, torque
    out[8], out[9], out[10] = n0, n1, n2
    out[11], out[12], out[13] = t0, t1, t2
    out[14], out[15], out[16] = s0, s1, s2
    out[17] = 0.5 * (W11 + W22) + math.sqrt(0.25 * (W11 - W22) ** 2 + W12 * W12)


@njit(cache=True, error_model="numpy")
def _newton(kind, shape, m, f, compliance, q, work):  # type: ignore[no-untyped-def]
    """Newton's method on the surface with a line search, from q, which it moves; iterations, negative if it stalls.

    det J = (f.n)^2 + torque^2 det W > 0 on a rigid convex surface, so the squared residual has no other local minimum
    than the contact: a step of Newton always descends. Steps stay where the force pushes.
    """
    g, H, here, there, trial = work
    tolerance = 1e-13 * (shape[7] + abs(m[0]) + abs(m[1]) + abs(m[2]))
    square, bound, step1, step2, length, fraction, iterations = np.inf, np.inf, 0.0, 0.0, np.inf, 1.0, -1
    trial[:] = q
    while iterations < _MAX_ITERATIONS:
        linearize(kind, shape, m, f, compliance, trial, g, H, there)
        if there[6] < 0.0 and there[0] ** 2 + there[1] ** 2 < bound:
            q[:] = trial
            here[:] = there
            iterations += 1
            square = here[0] ** 2 + here[1] ** 2
            if square <= tolerance * tolerance:
                return iterations
            det = here[2] * here[5] - here[3] * here[4]
            step1 = (here[3] * here[1] - here[5] * here[0]) / det
            step2 = (here[4] * here[0] - here[2] * here[1]) / det
            length = math.sqrt(step1 * step1 + step2 * step2)
            fraction = min(1.0, shape[7] / length)
        elif iterations >= 0 and fraction > _MIN_FRACTION:
            fraction *= 0.5
        else:
            break
        bound = square * (1.0 - 1e-4 * fraction)
        for i in range(3):
            trial[i] = q[i] + fraction * (step1 * here[11 + i] + step2 * here[14 + i])
        project(kind, shape, trial)
    # At the limit of rounding, or on a crease, where the normal turns within it, no step descends: the point is found
    # if the next step is too short to matter.
    return iterations if length < 1e-9 * shape[7] else -1


@njit(cache=True)
def _add(m, factor, f):  # type: ignore[no-untyped-def]
    return m[0] + factor * f[0], m[1] + factor * f[1], m[2] + factor * f[2]


@njit(cache=True, error_model="numpy")
def _locate(kind, shape, m, f, compliance, iterate, q, between, start, work):  # type: ignore[no-untyped-def]
    """The contact q that pushes, in closed form where there is one; iterations, negative if there is no contact.

    Where Newton's method fails from the point that faces the force, it follows the contact from the closed form, while
    exponents go from 1, and compliance from 0, to their values. The one pushing contact moves continuously with the
    shape as long as f.m != 0, so short enough strides never lose it; a moment along f that fades away on the way keeps
    f.m off zero.
    """
    exact = kind == ROD or (shape[3] == 1.0 and shape[4] == 1.0)
    if exact and compliance == 0.0 and not iterate:
        return 0 if _closed_form(kind, shape, m, f, q) else -1
    extra = math.copysign(_EXTRA * shape[7], m[0] * f[0] + m[1] * f[1] + m[2] * f[2])
    following = not _facing_point(kind, shape, f, start)
    if following and not _closed_form(kind, shape, _add(m, extra, f), f, start):
        return -1
    between[:] = shape
    done, stride, iterations = 0.0, 1.0, 0
    while stride > _MIN_STRIDE and iterations < 10 * _MAX_ITERATIONS:
        goal = min(1.0, done + stride)
        if kind == SMOOTH:
            between[3], between[4] = 1.0 + goal * (shape[3] - 1.0), 1.0 + goal * (shape[4] - 1.0)
        moment = _add(m, (1.0 - goal) * extra, f)
        q[:] = start
        project(kind, between, q)
        count = _newton(kind, between, moment, f, goal * compliance, q, work)
        iterations += max(count, 1)
        if count >= 0 and goal == 1.0:
            return iterations
        if count >= 0:
            done, stride = goal, 2.0 * stride
            start[:] = q
        elif following:
            stride *= 0.5
        else:
            following = True
            if not _closed_form(kind, shape, _add(m, extra, f), f, start):
                return -1
    return -1


@njit(cache=True, error_model="numpy")
def _admissible(shape, q):  # type: ignore[no-untyped-def]
    slack = _EDGE * shape[7]
    return shape[5] - slack <= q[2] <= shape[6] + slack


@njit(cache=True, error_model="numpy")
def _solve(kind, shape, X, F, limits, iterate, out, work, points):  # type: ignore[no-untyped-def]
    """Solves one wrench F (6,) in S; X (3, 4) is X_SF; fills out (RESULT_SIZE,) and returns the code.

    limits: least force, friction coefficient (infinite: unknown), layer's compliance (m/N) and thickness (m).
    """
    out[:] = np.nan
    for i in range(6):
        if not math.isfinite(F[i]):
            return NOT_FINITE
    force = math.sqrt(F[3] * F[3] + F[4] * F[4] + F[5] * F[5])
    if force < limits[0] or force == 0.0:
        return TOO_WEAK
    a0, a1, a2 = F[3] / force, F[4] / force, F[5] / force
    b0 = F[0] / force - (X[1, 3] * a2 - X[2, 3] * a1)
    b1 = F[1] / force - (X[2, 3] * a0 - X[0, 3] * a2)
    b2 = F[2] / force - (X[0, 3] * a1 - X[1, 3] * a0)
    f = (
        X[0, 0] * a0 + X[1, 0] * a1 + X[2, 0] * a2,
        X[0, 1] * a0 + X[1, 1] * a1 + X[2, 1] * a2,
        X[0, 2] * a0 + X[1, 2] * a1 + X[2, 2] * a2,
    )
    m = (
        X[0, 0] * b0 + X[1, 0] * b1 + X[2, 0] * b2,
        X[0, 1] * b0 + X[1, 1] * b1 + X[2, 1] * b2,
        X[0, 2] * b0 + X[1, 2] * b1 + X[2, 2] * b2,
    )
    compliance = limits[2] * force
    q, start, between = points
    count = _locate(kind, shape, m, f, compliance, iterate, q, between, start, work)
    if count < 0 or not _admissible(shape, q):
        push = 0.0
        if count >= 0:
            linearize(kind, shape, m, f, compliance, q, work[0], work[1], work[2])
            push = -work[2][6]
        # A pull is a push of the opposite wrench. Off the edge both may explain this one: the pull is named if it needs
        # far less friction. On a closed surface there is always a push.
        pull_m, pull_f = (-m[0], -m[1], -m[2]), (-f[0], -f[1], -f[2])
        if kind == ROD and _rod_contact(shape, pull_m, pull_f, q) and _admissible(shape, q):
            linearize(kind, shape, pull_m, pull_f, 0.0, q, work[0], work[1], work[2])
            if -work[2][6] > 2.0 * push:
                return TENSION
        return OUTSIDE if count >= 0 else MISSES
    linearize(kind, shape, m, f, compliance, q, work[0], work[1], work[2])
    state = work[2]
    fn, torque = state[6], state[7]
    friction = math.sqrt(max(0.0, 1.0 - fn * fn))
    if friction > -_GRAZING * fn:
        return MISSES
    if friction > -limits[1] * fn * (1.0 + 1e-9):
        return FRICTION
    if abs(torque) > -min(limits[1], _GRAZING) * fn * shape[7]:
        return TORQUE
    depth = -compliance * fn
    if limits[2] > 0.0 and (depth >= limits[3] or depth * state[17] >= 1.0):
        return LAYER
    for i in range(3):
        n = X[i, 0] * state[8] + X[i, 1] * state[9] + X[i, 2] * state[10]
        out[3 + i] = n
        out[i] = X[i, 0] * q[0] + X[i, 1] * q[1] + X[i, 2] * q[2] + X[i, 3] - depth * n
        out[6 + i] = force * fn * n
        out[9 + i] = F[3 + i] - out[6 + i]
        out[12 + i] = force * torque * n
    r0 = F[0] - (out[1] * F[5] - out[2] * F[4]) - out[12]
    r1 = F[1] - (out[2] * F[3] - out[0] * F[5]) - out[13]
    r2 = F[2] - (out[0] * F[4] - out[1] * F[3]) - out[14]
    out[15] = math.sqrt(r0 * r0 + r1 * r1 + r2 * r2)
    out[16] = depth
    out[17] = count
    return VALID


@njit(cache=True, error_model="numpy")
def solve(kind, shape, X_SF, F_S, limits, iterate, out, codes):  # type: ignore[no-untyped-def]
    """Solves wrenches F_S (B, 6); fills out (B, RESULT_SIZE) and codes (B,)."""
    work = (np.empty(3), np.empty((3, 3)), np.empty(18), np.empty(18), np.empty(3))
    points = (np.empty(3), np.empty(3), np.empty(len(shape)))
    for i in range(len(F_S)):
        codes[i] = _solve(kind, shape, X_SF, F_S[i], limits, iterate, out[i], work, points)
