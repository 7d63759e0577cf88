"""The inner loops, compiled by numba and cached on disk: each is one loop over poses.

A contact costs one gather of the distance grid: eight nodes of four float32 each (signed distance, normal), which lie
in four runs of 32 bytes. Poses are (B, 3, 4); increments (w, v) as in `poses.py`.

Source: [B16] J. Bimbo, thesis, 2016, eqs. 3.3 and 3.5, whitened by the sensors' standard deviations.
"""

import numpy as np
from numba import njit

from tactopose_drake.core.kernels.matrix_kernels import _cholesky, _invert
from tactopose_drake.core.kernels.prefetch import prefetch

# Where interpolated normals nearly cancel (the middle of a thin wall) their direction means little: this bounds it.
_SOFT_LENGTH = 0.05
# Bounds the derivative of the square root in the residual that normalises the normals' likelihood.
_SOFT_ROOT = 1e-4

_U4 = np.uintp(4)


@njit(cache=True, inline="always")
def _cell(q, origin, inverse_spacing, limit):  # type: ignore[no-untyped-def]
    """The node below q along one axis, the fraction beyond it, and how far outside of the grid q is, in cells."""
    u = (q - origin) * inverse_spacing
    outside = 0.0
    if not u >= 0.0:  # True for NaN too, which must not become an index.
        outside = u
        u = 0.0
    elif u > limit:
        outside = u - limit
        u = limit
    i = int(u)
    if i > limit - 1:
        i = int(limit) - 1
    return i, u - i, outside


@njit(cache=True, inline="always")
def _prefetch_cells(flat, shape, origin, inverse_spacing, X, p, q):  # type: ignore[no-untyped-def]
    """Asks for what the contacts p (k, 3) will read of the flattened grid at the pose X (3, 4); q (3,) is for work."""
    nx, ny, nz = shape[0], shape[1], shape[2]
    sy, sx = np.uintp(4 * nz), np.uintp(4 * nz * ny)
    for i in range(p.shape[0]):
        _to_object(X, p[i], q)
        ix = _cell(q[0], origin[0], inverse_spacing, nx - 1.0)[0]
        iy = _cell(q[1], origin[1], inverse_spacing, ny - 1.0)[0]
        iz = _cell(q[2], origin[2], inverse_spacing, nz - 1.0)[0]
        at = np.uintp(4 * ((ix * ny + iy) * nz + iz))
        prefetch(flat, at)
        prefetch(flat, at + sy)
        prefetch(flat, at + sx)
        prefetch(flat, at + sx + sy)


@njit(cache=True)
def _look_up(values, origin, inverse_spacing, x, y, z, out):  # type: ignore[no-untyped-def]
    """Trilinear distance and normal at one point, out[0:4]; outside of the grid the way to it is added."""
    i, fx, ox = _cell(x, origin[0], inverse_spacing, values.shape[0] - 1.0)
    j, fy, oy = _cell(y, origin[1], inverse_spacing, values.shape[1] - 1.0)
    k, fz, oz = _cell(z, origin[2], inverse_spacing, values.shape[2] - 1.0)
    a00, a01 = (1.0 - fx) * (1.0 - fy), (1.0 - fx) * fy
    a10, a11 = fx * (1.0 - fy), fx * fy
    for c in range(4):
        low = (
            a00 * values[i, j, k, c]
            + a01 * values[i, j + 1, k, c]
            + a10 * values[i + 1, j, k, c]
            + a11 * values[i + 1, j + 1, k, c]
        )
        high = (
            a00 * values[i, j, k + 1, c]
            + a01 * values[i, j + 1, k + 1, c]
            + a10 * values[i + 1, j, k + 1, c]
            + a11 * values[i + 1, j + 1, k + 1, c]
        )
        out[c] = low + fz * (high - low)
    if ox != 0.0 or oy != 0.0 or oz != 0.0:
        out[0] += np.sqrt(ox * ox + oy * oy + oz * oz) / inverse_spacing


@njit(cache=True)
def _look_up_with_derivative(values, origin, inverse_spacing, x, y, z, out, slope):  # type: ignore[no-untyped-def]
    """As `_look_up`, with slope[c, a] = d out[c] / d axis a, exact for the interpolant; slope is (4, 3)."""
    i, fx, ox = _cell(x, origin[0], inverse_spacing, values.shape[0] - 1.0)
    j, fy, oy = _cell(y, origin[1], inverse_spacing, values.shape[1] - 1.0)
    k, fz, oz = _cell(z, origin[2], inverse_spacing, values.shape[2] - 1.0)
    for c in range(4):
        v000, v001 = float(values[i, j, k, c]), float(values[i, j, k + 1, c])
        v010, v011 = float(values[i, j + 1, k, c]), float(values[i, j + 1, k + 1, c])
        v100, v101 = float(values[i + 1, j, k, c]), float(values[i + 1, j, k + 1, c])
        v110, v111 = float(values[i + 1, j + 1, k, c]), float(values[i + 1, j + 1, k + 1, c])
        v00, v01 = v000 + fz * (v001 - v000), v010 + fz * (v011 - v010)
        v10, v11 = v100 + fz * (v101 - v100), v110 + fz * (v111 - v110)
        v0, v1 = v00 + fy * (v01 - v00), v10 + fy * (v11 - v10)
        out[c] = v0 + fx * (v1 - v0)
        slope[c, 0] = (v1 - v0) * inverse_spacing if ox == 0.0 else 0.0
        slope[c, 1] = ((1.0 - fx) * (v01 - v00) + fx * (v11 - v10)) * inverse_spacing if oy == 0.0 else 0.0
        dz0 = (1.0 - fy) * (v001 - v000) + fy * (v011 - v010)
        dz1 = (1.0 - fy) * (v101 - v100) + fy * (v111 - v110)
        slope[c, 2] = ((1.0 - fx) * dz0 + fx * dz1) * inverse_spacing if oz == 0.0 else 0.0
    if ox != 0.0 or oy != 0.0 or oz != 0.0:
        way = np.sqrt(ox * ox + oy * oy + oz * oz)
        out[0] += way / inverse_spacing
        slope[0, 0] += ox / way
        slope[0, 1] += oy / way
        slope[0, 2] += oz / way


@njit(cache=True)
def _to_object(X, p, q):  # type: ignore[no-untyped-def]
    """q = R^T (p - t) for one pose X (3, 4)."""
    dx, dy, dz = p[0] - X[0, 3], p[1] - X[1, 3], p[2] - X[2, 3]
    for a in range(3):
        q[a] = X[0, a] * dx + X[1, a] * dy + X[2, a] * dz


@njit(cache=True)
def _rotate_to_object(X, n, m):  # type: ignore[no-untyped-def]
    """m = R^T n for one pose X (3, 4)."""
    for a in range(3):
        m[a] = X[0, a] * n[0] + X[1, a] * n[1] + X[2, a] * n[2]


@njit(cache=True, nogil=True)
def contact_costs(values, origin, inverse_spacing, p, n, weight_p, weight_n, X, cost):  # type: ignore[no-untyped-def]
    """Half the sum of squares of the contact residuals of each pose, into cost (B,)."""
    flat = values.reshape(-1)
    q, m, field = np.empty(3), np.empty(3), np.empty(4)
    for b in range(X.shape[0]):
        _prefetch_cells(flat, values.shape, origin, inverse_spacing, X[b], p, q)
        total = 0.0
        for i in range(p.shape[0]):
            _to_object(X[b], p[i], q)
            _look_up(values, origin, inverse_spacing, q[0], q[1], q[2], field)
            r = field[0] * weight_p[i]
            total += r * r
            if weight_n[i] > 0.0:
                _rotate_to_object(X[b], n[i], m)
                weight, spread = _normal_weight(field, weight_n[i])
                square = 0.0
                for a in range(3):
                    square += (field[a + 1] - m[a]) ** 2
                total += weight * weight * square + 2.0 * np.log(spread) + _SOFT_ROOT
        cost[b] = 0.5 * total


@njit(cache=True, inline="always")
def _normal_weight(field, weight_n):  # type: ignore[no-untyped-def]
    """One over the standard deviation of the normal's difference, and its variance over the sensor's alone.

    The mean of unit vectors is as short as they are spread: over two directions, their variance is (1 - |n|^2) / 2.
    """
    square = field[1] ** 2 + field[2] ** 2 + field[3] ** 2
    spread = 1.0 + 0.5 * max(0.0, 1.0 - square) * weight_n * weight_n
    return weight_n / np.sqrt(spread), spread


@njit(cache=True)
def _contact_rows(  # type: ignore[no-untyped-def]
    values, origin, inverse_spacing, p, n, weight_p, weight_n, X, residual, J, smooth, work
):
    """The five residuals of one contact at one pose, their Jacobian (5, 6), and the rows (4, 6) that carry information.

    The residuals are the distance, the difference of the normals, and the root of twice the log of the normal's
    variance, which makes the sum of squares a likelihood: a crease explains any normal, but none well.

    What the contact says of the pose is in the derivative of the distance along the mean normal, and of that normal's
    direction. The exact derivatives follow each facet, and each change of the mean normal's length; they would claim
    that the facets of a tessellated cylinder determine its spin.
    """
    # Views of the caller's scratch array (10, 4): an allocation here would cost as much as the arithmetic.
    q, m, along, row, field, slope, mean = work[0], work[1], work[2], work[3], work[4], work[5:9], work[9]
    _to_object(X, p, q)
    _look_up_with_derivative(values, origin, inverse_spacing, q[0], q[1], q[2], field, slope)
    square = field[1] ** 2 + field[2] ** 2 + field[3] ** 2
    scale = 1.0 / np.sqrt(square + _SOFT_LENGTH**2)
    for a in range(3):
        mean[a] = scale * field[a + 1]
    _chain(mean, q, X, weight_p, smooth[0])
    residual[0] = field[0] * weight_p
    _chain(slope[0], q, X, weight_p, J[0])
    if weight_n > 0.0:
        _rotate_to_object(X, n, m)
        weight, spread = _normal_weight(field, weight_n)
        for c in range(3):  # The derivative of half the squared length.
            along[c] = field[1] * slope[1, c] + field[2] * slope[2, c] + field[3] * slope[3, c]
            if square >= 1.0:
                along[c] = 0.0
        for a in range(3):
            difference = field[a + 1] - m[a]
            residual[a + 1] = difference * weight
            for c in range(3):
                row[c] = slope[a + 1, c] + 0.5 * difference * weight * weight * along[c]
            _chain(row, q, X, weight, J[a + 1])
            for c in range(3):
                row[c] = scale * (slope[a + 1, c] - mean[a] * scale * along[c])
            _chain(row, q, X, weight, smooth[a + 1])
        _turn(m, weight, J)
        _turn(m, weight, smooth)
        residual[4] = np.sqrt(2.0 * np.log(spread) + _SOFT_ROOT)
        for c in range(3):
            row[c] = -along[c] * weight * weight / residual[4]
        _chain(row, q, X, 1.0, J[4])
    else:
        for a in range(1, 5):
            residual[a] = 0.0
            for c in range(6):
                J[a, c] = 0.0
        for a in range(1, 4):
            for c in range(6):
                smooth[a, c] = 0.0


@njit(cache=True, inline="always")
def _chain(row, q, X, weight, J):  # type: ignore[no-untyped-def]
    """Turns a derivative by the point in O into one by the increment: dq = [q]x w - R^T v."""
    J[0] = weight * (row[1] * q[2] - row[2] * q[1])
    J[1] = weight * (row[2] * q[0] - row[0] * q[2])
    J[2] = weight * (row[0] * q[1] - row[1] * q[0])
    for a in range(3):
        J[3 + a] = -weight * (X[a, 0] * row[0] + X[a, 1] * row[1] + X[a, 2] * row[2])


@njit(cache=True, inline="always")
def _turn(m, weight, J):  # type: ignore[no-untyped-def]
    """Adds to rows 1 to 3 that the measured normal turns with the increment too: d(R^T n) = [m]x w."""
    J[1, 1] += m[2] * weight
    J[1, 2] -= m[1] * weight
    J[2, 0] -= m[2] * weight
    J[2, 2] += m[0] * weight
    J[3, 0] += m[1] * weight
    J[3, 1] -= m[0] * weight


@njit(cache=True)
def contact_residuals(  # type: ignore[no-untyped-def]
    values, origin, inverse_spacing, p, n, weight_p, weight_n, X, residuals, jacobian
):
    """Residuals (B, k, 5), see `_contact_rows`, and their Jacobian (B, k, 5, 6) by the increment."""
    smooth, work = np.empty((4, 6)), np.empty((10, 4))
    for b in range(X.shape[0]):
        for i in range(p.shape[0]):
            _contact_rows(
                values,
                origin,
                inverse_spacing,
                p[i],
                n[i],
                weight_p[i],
                weight_n[i],
                X[b],
                residuals[b, i],
                jacobian[b, i],
                smooth,
                work,
            )


@njit(cache=True, inline="always")
def _interpolate(flat, at, sx, sy, fx, fy, fz):  # type: ignore[no-untyped-def]
    """One channel of the flattened grid in the cell whose first node is at `at`, and its slopes per cell.

    sx and sy are the strides to the next node along x and y; along z it is 4.
    """
    v000, v001, v010, v011 = flat[at], flat[at + _U4], flat[at + sy], flat[at + sy + _U4]
    at += sx
    v100, v101, v110, v111 = flat[at], flat[at + _U4], flat[at + sy], flat[at + sy + _U4]
    z00, z01, z10, z11 = v001 - v000, v011 - v010, v101 - v100, v111 - v110
    v00, v01, v10, v11 = v000 + fz * z00, v010 + fz * z01, v100 + fz * z10, v110 + fz * z11
    y0, y1 = v01 - v00, v11 - v10
    v0, v1 = v00 + fy * y0, v10 + fy * y1
    z0, z1 = z00 + fy * (z01 - z00), z10 + fy * (z11 - z10)
    return v0 + fx * (v1 - v0), v1 - v0, y0 + fx * (y1 - y0), z0 + fx * (z1 - z0)


@njit(cache=True, inline="always")
def _extend(field, slope, ox, oy, oz, inverse_spacing):  # type: ignore[no-untyped-def]
    """Outside of the grid, by (ox, oy, oz) cells, the field is its nearest point's, and the way there is added."""
    way = np.sqrt(ox * ox + oy * oy + oz * oz)
    field[0] += way / inverse_spacing
    for k in range(4):
        if ox != 0.0:
            slope[k, 0] = 0.0
        if oy != 0.0:
            slope[k, 1] = 0.0
        if oz != 0.0:
            slope[k, 2] = 0.0
    slope[0, 0] += ox / way
    slope[0, 1] += oy / way
    slope[0, 2] += oz / way


@njit(cache=True, inline="always")
def _cross_row(row, q, J):  # type: ignore[no-untyped-def]
    """As `_chain`, by the increment (w, R^T v): dq = [q]x w - R^T v."""
    J[0], J[1], J[2] = row[1] * q[2] - row[2] * q[1], row[2] * q[0] - row[0] * q[2], row[0] * q[1] - row[1] * q[0]
    J[3], J[4], J[5] = -row[0], -row[1], -row[2]


@njit(cache=True, inline="always")
def _turn_translations(X, g, H, gradient, hessian):  # type: ignore[no-untyped-def]
    """Gradient and Hessian by (w, v) from those by (w, R^T v), of which H is the lower triangle."""
    for a in range(3):
        gradient[a] = g[a]
        gradient[3 + a] = X[a, 0] * g[3] + X[a, 1] * g[4] + X[a, 2] * g[5]
        for c in range(a + 1):
            hessian[a, c] = hessian[c, a] = H[a, c]
            H[3 + c, 3 + a] = H[3 + a, 3 + c]
        for c in range(3):
            mixed = X[a, 0] * H[3, c] + X[a, 1] * H[4, c] + X[a, 2] * H[5, c]
            hessian[3 + a, c] = hessian[c, 3 + a] = mixed
    for a in range(3):
        x = X[a, 0] * H[3, 3] + X[a, 1] * H[4, 3] + X[a, 2] * H[5, 3]
        y = X[a, 0] * H[3, 4] + X[a, 1] * H[4, 4] + X[a, 2] * H[5, 4]
        z = X[a, 0] * H[3, 5] + X[a, 1] * H[4, 5] + X[a, 2] * H[5, 5]
        for c in range(a + 1):
            both = x * X[c, 0] + y * X[c, 1] + z * X[c, 2]
            hessian[3 + a, 3 + c] = hessian[3 + c, 3 + a] = both


@njit(cache=True, inline="always")
def _damped_step(m, H, g, damping, L, y, step):  # type: ignore[no-untyped-def]
    """-(H + damping diag H)^-1 g into step (m,), by Cholesky, from the lower triangle of H; L and y are for work.

    A pivot that vanishes (a direction that nothing determines) gets no step.
    """
    for i in range(m):
        for j in range(i + 1):
            s = H[i, j]
            if i == j:
                s += damping * H[i, i]
            for k in range(j):
                s -= L[i, k] * L[j, k]
            if i == j:
                # The diagonal holds the inverses: divisions are slow.
                L[i, i] = 1.0 / np.sqrt(s) if s > 1e-12 * (H[i, i] + 1e-300) else 0.0
            else:
                L[i, j] = s * L[j, j]
    for i in range(m):
        s = -g[i]
        for k in range(i):
            s -= L[i, k] * y[k]
        y[i] = s * L[i, i]
    for i in range(m - 1, -1, -1):
        s = y[i]
        for k in range(i + 1, m):
            s -= L[k, i] * step[k]
        step[i] = s * L[i, i]


@njit(cache=True, nogil=True)
def damped_steps(hessian, gradient, damping, step):  # type: ignore[no-untyped-def]
    """Steps of each problem, see `_damped_step`, into step (B, m); m is any size."""
    m = gradient.shape[1]
    L, y = np.empty((m, m)), np.empty(m)
    for b in range(gradient.shape[0]):
        _damped_step(m, hessian[b], gradient[b], damping[b], L, y, step[b])


@njit(cache=True, nogil=True)
def accept_steps(  # type: ignore[no-untyped-def]
    state,
    cost,
    gradient,
    hessian,
    new_state,
    new_cost,
    new_gradient,
    new_hessian,
    step,
    damping,
    tolerance,
    limit,
    done,
):
    """Levenberg-Marquardt's judgement of each problem's step: moves it if the cost falls, and changes the damping.

    A problem is done when its cost falls, or the local model promises (half of -g s) that it falls, by less than the
    tolerance times cost + 1; or when the damping exceeds its limit.
    """
    for b in range(cost.shape[0]):
        least = tolerance * (cost[b] + 1.0)
        promised = 0.0
        for i in range(step.shape[1]):
            promised -= 0.5 * gradient[b, i] * step[b, i]
        decrease = cost[b] - new_cost[b]
        done[b] = promised < least or 0.0 < decrease < least
        if decrease > 0.0:
            damping[b] *= 0.1
            state[b], cost[b], gradient[b], hessian[b] = new_state[b], new_cost[b], new_gradient[b], new_hessian[b]
        else:
            damping[b] *= 10.0
            done[b] = done[b] or damping[b] > limit


@njit(cache=True, inline="always")
def _retract(X, increment, out):  # type: ignore[no-untyped-def]
    """R exp(w), p + v for one pose (3, 4) and increment (6,)."""
    x, y, z = increment[0], increment[1], increment[2]
    angle2 = x * x + y * y + z * z
    if angle2 < 1e-8:
        s, c = 1.0 - angle2 / 6.0, 0.5 - angle2 / 24.0
    else:
        angle = np.sqrt(angle2)
        s, c = np.sin(angle) / angle, (1.0 - np.cos(angle)) / angle2
    e00, e01, e02 = 1.0 - c * (y * y + z * z), c * x * y - s * z, c * x * z + s * y
    e10, e11, e12 = c * x * y + s * z, 1.0 - c * (x * x + z * z), c * y * z - s * x
    e20, e21, e22 = c * x * z - s * y, c * y * z + s * x, 1.0 - c * (x * x + y * y)
    for i in range(3):
        a, b, c = X[i, 0], X[i, 1], X[i, 2]
        out[i, 0] = a * e00 + b * e10 + c * e20
        out[i, 1] = a * e01 + b * e11 + c * e21
        out[i, 2] = a * e02 + b * e12 + c * e22
        out[i, 3] = X[i, 3] + increment[3 + i]


@njit(cache=True, nogil=True)
def retract(X, increment, out):  # type: ignore[no-untyped-def]
    """The compiled `poses.retract`: R exp(w), p + v for poses (B, 3, 4) and increments (B, 6)."""
    for b in range(X.shape[0]):
        _retract(X[b], increment[b], out[b])


@njit(cache=True, inline="always")
def _increment(X, Y, out):  # type: ignore[no-untyped-def]
    """The increment (w, v) from the pose X to Y, both (3, 4), into out (6,)."""
    for i in range(3):
        out[3 + i] = Y[i, 3] - X[i, 3]
    r00 = X[0, 0] * Y[0, 0] + X[1, 0] * Y[1, 0] + X[2, 0] * Y[2, 0]
    r01 = X[0, 0] * Y[0, 1] + X[1, 0] * Y[1, 1] + X[2, 0] * Y[2, 1]
    r02 = X[0, 0] * Y[0, 2] + X[1, 0] * Y[1, 2] + X[2, 0] * Y[2, 2]
    r10 = X[0, 1] * Y[0, 0] + X[1, 1] * Y[1, 0] + X[2, 1] * Y[2, 0]
    r11 = X[0, 1] * Y[0, 1] + X[1, 1] * Y[1, 1] + X[2, 1] * Y[2, 1]
    r12 = X[0, 1] * Y[0, 2] + X[1, 1] * Y[1, 2] + X[2, 1] * Y[2, 2]
    r20 = X[0, 2] * Y[0, 0] + X[1, 2] * Y[1, 0] + X[2, 2] * Y[2, 0]
    r21 = X[0, 2] * Y[0, 1] + X[1, 2] * Y[1, 1] + X[2, 2] * Y[2, 1]
    r22 = X[0, 2] * Y[0, 2] + X[1, 2] * Y[1, 2] + X[2, 2] * Y[2, 2]
    x, y, z = 0.5 * (r21 - r12), 0.5 * (r02 - r20), 0.5 * (r10 - r01)
    sine, cosine = np.sqrt(x * x + y * y + z * z), 0.5 * (r00 + r11 + r22 - 1.0)
    angle = np.arctan2(sine, cosine)
    if cosine > -0.99:
        scale = angle / sine if sine > 1e-12 else 1.0
        out[0], out[1], out[2] = scale * x, scale * y, scale * z
    else:  # Near a half turn the axis comes from the largest column of R + 1.
        if r00 >= r11 and r00 >= r22:
            a, b, c = r00 + 1.0, 0.5 * (r01 + r10), 0.5 * (r02 + r20)
        elif r11 >= r22:
            a, b, c = 0.5 * (r01 + r10), r11 + 1.0, 0.5 * (r12 + r21)
        else:
            a, b, c = 0.5 * (r02 + r20), 0.5 * (r12 + r21), r22 + 1.0
        scale = angle / np.sqrt(a * a + b * b + c * c)
        if a * x + b * y + c * z < 0.0:
            scale = -scale
        out[0], out[1], out[2] = scale * a, scale * b, scale * c


@njit(cache=True)
def prior_costs(X_prior, weights, X, cost):  # type: ignore[no-untyped-def]
    """Half the squared whitened increment from the prior's pose (3, 4) to each pose, into cost (B,)."""
    u = np.empty(6)
    for b in range(X.shape[0]):
        _increment(X_prior, X[b], u)
        total = 0.0
        for i in range(6):
            total += (u[i] * weights[i]) ** 2
        cost[b] = 0.5 * total


@njit(cache=True)
def prior_residuals(X_prior, weights, X, residuals, jacobian):  # type: ignore[no-untyped-def]
    """Whitened increments (B, 6) from the prior's pose, and their derivatives by the increment (B, 6, 6).

    The derivative of the rotation vector is the inverse right Jacobian of SO(3): J. Sola et al., A micro Lie theory for
    state estimation, 2018, eq. 144.
    """
    u = np.empty(6)
    for b in range(X.shape[0]):
        _prior_row(X_prior, weights, X[b], u, residuals[b], jacobian[b])


@njit(cache=True, inline="always")
def _prior_row(X_prior, weights, X, u, residual, J):  # type: ignore[no-untyped-def]
    """The same of one pose (3, 4), into (6,) and (6, 6); u (6,) is for work."""
    _increment(X_prior, X, u)
    x, y, z = u[0], u[1], u[2]
    angle2 = x * x + y * y + z * z
    if angle2 < 1e-6:
        c = 1.0 / 12.0 + angle2 / 720.0
    else:
        angle = np.sqrt(angle2)
        c = 1.0 / angle2 - np.cos(0.5 * angle) / (2.0 * angle * np.sin(0.5 * angle))
    J[:, :] = 0.0
    J[0, 0], J[0, 1], J[0, 2] = 1.0 - c * (y * y + z * z), c * x * y - 0.5 * z, c * x * z + 0.5 * y
    J[1, 0], J[1, 1], J[1, 2] = c * x * y + 0.5 * z, 1.0 - c * (x * x + z * z), c * y * z - 0.5 * x
    J[2, 0], J[2, 1], J[2, 2] = c * x * z - 0.5 * y, c * y * z + 0.5 * x, 1.0 - c * (x * x + y * y)
    for i in range(6):
        residual[i] = u[i] * weights[i]
        if i >= 3:
            J[i, i] = 1.0
        for j in range(6):
            J[i, j] *= weights[i]


@njit(cache=True)
def form_normal_equations(residuals, jacobian, cost, gradient, hessian):  # type: ignore[no-untyped-def]
    """Cost (B,), gradient (B, n) and Gauss-Newton Hessian (B, n, n) from residuals (B, m) and a Jacobian (B, m, n)."""
    count, m, n = jacobian.shape
    for b in range(count):
        total = 0.0
        gradient[b] = 0.0
        hessian[b] = 0.0
        for k in range(m):
            r = residuals[b, k]
            total += r * r
            for i in range(n):
                J = jacobian[b, k, i]
                gradient[b, i] += J * r
                for j in range(i + 1):
                    hessian[b, i, j] += J * jacobian[b, k, j]
        for i in range(n):
            for j in range(i):
                hessian[b, j, i] = hessian[b, i, j]
        cost[b] = 0.5 * total


@njit(cache=True)
def mark_distinct(X, information, symmetries, threshold, distinct):  # type: ignore[no-untyped-def]
    """Marks, of poses X (B, 3, 4) by rising cost, each that no better marked one equals up to a symmetry.

    Two poses are equal when the squared Mahalanobis length of the increment between them, by the information (B, 6, 6)
    of the better one, is below the threshold for one of the symmetries (g, 3, 4). Most are told apart sooner, by how
    far such increments move and turn at the most: their squares are below the threshold times the covariance's traces.
    """
    u, Y = np.empty(6), np.empty((symmetries.shape[0], 3, 4))
    L, covariance = np.empty((6, 6)), np.empty((6, 6))
    farthest, least_trace = np.empty(X.shape[0]), np.empty(X.shape[0])
    for b in range(X.shape[0]):
        for s in range(symmetries.shape[0]):
            S = symmetries[s]
            for i in range(3):
                for j in range(4):
                    Y[s, i, j] = X[b, i, 0] * S[0, j] + X[b, i, 1] * S[1, j] + X[b, i, 2] * S[2, j]
                Y[s, i, 3] += X[b, i, 3]
        distinct[b] = True
        for a in range(b):
            if not distinct[a]:
                continue
            H = information[a]
            for s in range(symmetries.shape[0]):
                way, trace = 0.0, 0.0
                for i in range(3):
                    way += (Y[s, i, 3] - X[a, i, 3]) ** 2
                    for j in range(3):
                        trace += X[a, i, j] * Y[s, i, j]
                if way > farthest[a] or trace < least_trace[a]:
                    continue
                _increment(X[a], Y[s], u)
                total = 0.0
                for i in range(6):
                    half = 0.5 * H[i, i] * u[i]
                    for j in range(i):
                        half += H[i, j] * u[j]
                    total += 2.0 * half * u[i]
                if total < threshold:
                    distinct[b] = False
                    break
            if not distinct[b]:
                break
        if distinct[b]:
            _cholesky(information[b], L)
            _invert(L, covariance)
            farthest[b] = threshold * (covariance[3, 3] + covariance[4, 4] + covariance[5, 5])
            widest = np.sqrt(threshold * (covariance[0, 0] + covariance[1, 1] + covariance[2, 2]))
            least_trace[b] = 1.0 + 2.0 * np.cos(min(widest, np.pi))
