"""Contacts on the distance grid, compiled for several poses at a time, so that the processor vectorises over them.

Each number of a pose is in a row of sixteen adjacent lanes. All rows are in one array: the compiler knows that places
at fixed distances in one array do not overlap. Data whose address differs from lane to lane (the nodes of the grid) is
gathered into rows first. Loops over lanes contain no branches and no functions that exist for scalars only, so that
they compile to instructions on four numbers each.

Everything is in the object's frame: increments are (w, R^T v) until `leave`. The formulas are those of `contact_rows`.
"""

import numpy as np

from tactopose_drake.core.compilation import inlined, part
from tactopose_drake.core.kernel_types import Floats1, Floats3, OutFloats1
from tactopose_drake.core.kernels.grid_kernels import SOFT_LENGTH, Grid
from tactopose_drake.core.kernels.pose_kernels import turn_translations
from tactopose_drake.core.kernels.prefetch import prefetch

LANES = 16
# Bounds the derivative of the square root in the residual that normalises the normals' likelihood.
SOFT_ROOT = 1e-4
# Where rows begin: of a pose; of a contact's point and normal in O; of its place in the grid; of the grid's values at
# the cell's corners; of the contact's energies, the last for a flipped normal; of its weights, and how far its normal
# faces as told; of sums over the contacts.
_POSE, _POINT, _NORMAL, _FRACTION, _OUTSIDE, _CORNERS = (np.uintp(LANES * row) for row in (0, 12, 15, 18, 21, 24))
DISTANCE_ENERGY, NORMAL_ENERGY, FLIPPED_ENERGY = (np.uintp(LANES * row) for row in (56, 57, 58))
DISTANCE_SHARE, NORMAL_SHARE, FACING = (np.uintp(LANES * row) for row in (59, 60, 61))
COST, _SPREAD, _GRADIENT, _HESSIAN = (np.uintp(LANES * row) for row in (62, 63, 64, 70))
_NODE = np.uintp(LANES * 91)
SIZE = LANES * 92
"""Size of the array that holds all rows."""

_1, _2, _3, _4, _5 = (np.uintp(LANES * row) for row in range(1, 6))
_Z, _Y, _X = (np.uintp(LANES * row) for row in (4, 8, 16))  # From corner to corner, of four channels each.
_LARGEST = 1e200


@part
def enter(X: Floats3, first: int, lanes: int, w: OutFloats1) -> None:
    """Loads the poses X[first : first + lanes], (3, 4) each, into lanes, and zeroes the sums over contacts."""
    for lane in range(lanes):
        for a in range(3):
            for c in range(4):
                w[LANES * (4 * a + c) + lane] = X[first + lane, a, c]
    for lane in range(COST, SIZE):
        w[lane] = 0.0
    for lane in range(LANES):
        w[_SPREAD + np.uintp(lane)] = 1.0


@part
def read_grid(grid: Grid, p: Floats1, n: Floats1, lanes: int, w: OutFloats1) -> None:
    """Gathers, for each lane, the corners of the grid cell at a contact's point p and normal n (3,) in P."""
    values, origin, inverse_spacing = grid
    px, py, pz, nx, ny, nz = p[0], p[1], p[2], n[0], n[1], n[2]
    for lane in range(np.uintp(lanes)):
        row = _POSE + lane
        dx, dy, dz = px - w[row + _3], py - w[row + _3 + _4], pz - w[row + _3 + _4 + _4]
        for a in range(3):
            x, y, z = w[row], w[row + _4], w[row + _4 + _4]
            w[_POINT + np.uintp(LANES * a) + lane] = x * dx + y * dy + z * dz
            w[_NORMAL + np.uintp(LANES * a) + lane] = x * nx + y * ny + z * nz
            row += _1
    flat = values.reshape(-1)
    sy, sx = np.uintp(4 * values.shape[2]), np.uintp(4 * values.shape[2] * values.shape[1])
    for lane in range(np.uintp(lanes)):
        node = 0
        for a in range(3):
            row, limit = np.uintp(LANES * a) + lane, values.shape[a] - 1.0
            # NaN must not become an index.
            at = (w[_POINT + row] - origin[a]) * inverse_spacing
            inside = min(max(at, 0.0), limit) if at == at else 0.0
            below = min(int(inside), values.shape[a] - 2)
            w[_FRACTION + row] = inside - below
            w[_OUTSIDE + row] = at - inside
            node = node * values.shape[a] + below
        first = np.uintp(4 * node)
        w[_NODE + lane] = first
        prefetch(flat, first)
        prefetch(flat, first + sy)
        prefetch(flat, first + sx)
        prefetch(flat, first + sx + sy)
    for lane in range(np.uintp(lanes)):
        first = np.uintp(w[_NODE + lane])
        for c in range(np.uintp(4)):
            row, corner = _CORNERS + np.uintp(LANES) * c + lane, first + c
            w[row], w[row + _Z] = flat[corner], flat[corner + np.uintp(4)]
            w[row + _Y], w[row + _Y + _Z] = flat[corner + sy], flat[corner + sy + np.uintp(4)]
            row, corner = row + _X, corner + sx
            w[row], w[row + _Z] = flat[corner], flat[corner + np.uintp(4)]
            w[row + _Y], w[row + _Y + _Z] = flat[corner + sy], flat[corner + sy + np.uintp(4)]


@inlined
def _interpolate(w, row, fx, fy, fz):
    """One channel interpolated between the corners, and its derivatives per cell."""
    v000, v001, v010, v011 = w[row], w[row + _Z], w[row + _Y], w[row + _Y + _Z]
    row += _X
    v100, v101, v110, v111 = w[row], w[row + _Z], w[row + _Y], w[row + _Y + _Z]
    z00, z01, z10, z11 = v001 - v000, v011 - v010, v101 - v100, v111 - v110
    v00, v01, v10, v11 = v000 + fz * z00, v010 + fz * z01, v100 + fz * z10, v110 + fz * z11
    y0, y1 = v01 - v00, v11 - v10
    v0, v1 = v00 + fy * y0, v10 + fy * y1
    z0, z1 = z00 + fy * (z01 - z00), z10 + fy * (z11 - z10)
    return v0 + fx * (v1 - v0), v1 - v0, y0 + fx * (y1 - y0), z0 + fx * (z1 - z0)


@part
def weigh(inverse_spacing: float, weight_p: float, weight_n: float, lanes: int, w: OutFloats1) -> None:
    """A contact's energies: half the squares of its whitened distance, of its normal, and of the normal flipped."""
    for lane in range(np.uintp(lanes)):
        fx, fy, fz = w[_FRACTION + lane], w[_FRACTION + _1 + lane], w[_FRACTION + _2 + lane]
        ox, oy, oz = w[_OUTSIDE + lane], w[_OUTSIDE + _1 + lane], w[_OUTSIDE + _2 + lane]
        f0 = _interpolate(w, _CORNERS + lane, fx, fy, fz)[0] + np.sqrt(ox * ox + oy * oy + oz * oz) / inverse_spacing
        f1 = _interpolate(w, _CORNERS + _1 + lane, fx, fy, fz)[0]
        f2 = _interpolate(w, _CORNERS + _2 + lane, fx, fy, fz)[0]
        f3 = _interpolate(w, _CORNERS + _3 + lane, fx, fy, fz)[0]
        spread = 1.0 + 0.5 * max(0.0, 1.0 - (f1 * f1 + f2 * f2 + f3 * f3)) * weight_n * weight_n
        mx, my, mz, weight = w[_NORMAL + lane], w[_NORMAL + _1 + lane], w[_NORMAL + _2 + lane], weight_n**2 / spread
        x, y, z = f1 - mx, f2 - my, f3 - mz
        w[DISTANCE_ENERGY + lane] = 0.5 * f0 * f0 * weight_p * weight_p
        w[NORMAL_ENERGY + lane] = 0.5 * weight * (x * x + y * y + z * z)
        w[FLIPPED_ENERGY + lane] = w[NORMAL_ENERGY + lane] + 2.0 * weight * (f1 * mx + f2 * my + f3 * mz)
        w[_SPREAD + lane] = spread
    if weight_n > 0.0:
        for lane in range(np.uintp(lanes)):
            log_spread = np.log(w[_SPREAD + lane]) + 0.5 * SOFT_ROOT
            w[NORMAL_ENERGY + lane] += log_spread
            w[FLIPPED_ENERGY + lane] += log_spread


@inlined
def _field_with_slopes(w, lane, inverse_spacing):
    """Distance and mean normal at a contact's point, (4,), and their derivatives along x, y and z, (4,) each."""
    fx, fy, fz = w[_FRACTION + lane], w[_FRACTION + _1 + lane], w[_FRACTION + _2 + lane]
    ox, oy, oz = w[_OUTSIDE + lane], w[_OUTSIDE + _1 + lane], w[_OUTSIDE + _2 + lane]
    way = np.sqrt(ox * ox + oy * oy + oz * oz)
    per_way = 1.0 / way if way > 0.0 else 0.0
    # Outside the grid the field is that of the nearest point, plus the distance to it.
    kx = inverse_spacing if ox == 0.0 else 0.0
    ky = inverse_spacing if oy == 0.0 else 0.0
    kz = inverse_spacing if oz == 0.0 else 0.0
    f0, x0, y0, z0 = _interpolate(w, _CORNERS + lane, fx, fy, fz)
    f1, x1, y1, z1 = _interpolate(w, _CORNERS + _1 + lane, fx, fy, fz)
    f2, x2, y2, z2 = _interpolate(w, _CORNERS + _2 + lane, fx, fy, fz)
    f3, x3, y3, z3 = _interpolate(w, _CORNERS + _3 + lane, fx, fy, fz)
    x = x0 * kx + ox * per_way, x1 * kx, x2 * kx, x3 * kx
    y = y0 * ky + oy * per_way, y1 * ky, y2 * ky, y3 * ky
    z = z0 * kz + oz * per_way, z1 * kz, z2 * kz, z3 * kz
    return (f0 + way / inverse_spacing, f1, f2, f3), x, y, z


@inlined
def _chained(x, y, z, qx, qy, qz):
    """Converts a derivative with respect to the point in O to one by (w, R^T v): dq = [q]x w - R^T v."""
    return y * qz - z * qy, z * qx - x * qz, x * qy - y * qx, -x, -y, -z


@inlined
def _add_squares(w, row, a, b, c, d):
    """Adds the lower triangle of the sum of the outer squares of four rows (6,)."""
    w[row] += a[0] * a[0] + b[0] * b[0] + c[0] * c[0] + d[0] * d[0]
    row += _1
    w[row] += a[1] * a[0] + b[1] * b[0] + c[1] * c[0] + d[1] * d[0]
    w[row + _1] += a[1] * a[1] + b[1] * b[1] + c[1] * c[1] + d[1] * d[1]
    row += _2
    w[row] += a[2] * a[0] + b[2] * b[0] + c[2] * c[0] + d[2] * d[0]
    w[row + _1] += a[2] * a[1] + b[2] * b[1] + c[2] * c[1] + d[2] * d[1]
    w[row + _2] += a[2] * a[2] + b[2] * b[2] + c[2] * c[2] + d[2] * d[2]
    row += _3
    w[row] += a[3] * a[0] + b[3] * b[0] + c[3] * c[0] + d[3] * d[0]
    w[row + _1] += a[3] * a[1] + b[3] * b[1] + c[3] * c[1] + d[3] * d[1]
    w[row + _2] += a[3] * a[2] + b[3] * b[2] + c[3] * c[2] + d[3] * d[2]
    w[row + _3] += a[3] * a[3] + b[3] * b[3] + c[3] * c[3] + d[3] * d[3]
    row += _4
    w[row] += a[4] * a[0] + b[4] * b[0] + c[4] * c[0] + d[4] * d[0]
    w[row + _1] += a[4] * a[1] + b[4] * b[1] + c[4] * c[1] + d[4] * d[1]
    w[row + _2] += a[4] * a[2] + b[4] * b[2] + c[4] * c[2] + d[4] * d[2]
    w[row + _3] += a[4] * a[3] + b[4] * b[3] + c[4] * c[3] + d[4] * d[3]
    w[row + _4] += a[4] * a[4] + b[4] * b[4] + c[4] * c[4] + d[4] * d[4]
    row += _5
    w[row] += a[5] * a[0] + b[5] * b[0] + c[5] * c[0] + d[5] * d[0]
    w[row + _1] += a[5] * a[1] + b[5] * b[1] + c[5] * c[1] + d[5] * d[1]
    w[row + _2] += a[5] * a[2] + b[5] * b[2] + c[5] * c[2] + d[5] * d[2]
    w[row + _3] += a[5] * a[3] + b[5] * b[3] + c[5] * c[3] + d[5] * d[3]
    w[row + _4] += a[5] * a[4] + b[5] * b[4] + c[5] * c[4] + d[5] * d[4]
    w[row + _5] += a[5] * a[5] + b[5] * b[5] + c[5] * c[5] + d[5] * d[5]


@part
def add_equations(inverse_spacing: float, weight_p: float, weight_n: float, lanes: int, w: OutFloats1) -> None:
    """Adds a contact's part of the cost, of its gradient, and of the Hessian, each energy times its share.

    The normal counts by its mean over the two cases that it is as told or flipped, which `FACING` weights. The cost
    lacks the logarithms of the normals' variances, which accumulate in one product; see `total_cost`.
    """
    rest = 0.5 * SOFT_ROOT if weight_n > 0.0 else 0.0
    for lane in range(np.uintp(lanes)):
        (f0, f1, f2, f3), x, y, z = _field_with_slopes(w, lane, inverse_spacing)
        qx, qy, qz = w[_POINT + lane], w[_POINT + _1 + lane], w[_POINT + _2 + lane]
        facing = w[FACING + lane]
        mx, my, mz = facing * w[_NORMAL + lane], facing * w[_NORMAL + _1 + lane], facing * w[_NORMAL + _2 + lane]
        share_d, share_n, square = w[DISTANCE_SHARE + lane], w[NORMAL_SHARE + lane], f1 * f1 + f2 * f2 + f3 * f3
        scale = 1.0 / np.sqrt(square + SOFT_LENGTH**2)
        spread = 1.0 + 0.5 * max(0.0, 1.0 - square) * weight_n * weight_n
        weight = weight_n * weight_n / spread  # One over the variance of the normal's difference.
        ex, ey, ez = f1 - mx, f2 - my, f3 - mz
        misfit = weight * (ex * ex + ey * ey + ez * ez + (1.0 - facing * facing))
        w[COST + lane] += 0.5 * (share_d * f0 * f0 * weight_p * weight_p + share_n * misfit)
        w[COST + lane] += rest if share_n > 0.0 else 0.0
        w[_SPREAD + lane] *= spread if share_n > 0.0 else 1.0

        # The derivative of half the squared length of the mean normal, by which its variance changes.
        inside = 1.0 if square < 1.0 else 0.0
        ax = inside * (f1 * x[1] + f2 * x[2] + f3 * x[3])
        ay = inside * (f1 * y[1] + f2 * y[2] + f3 * y[3])
        az = inside * (f1 * z[1] + f2 * z[2] + f3 * z[3])
        # The cost's derivative with respect to the point in O, and to the rotation of the normal.
        by_d, by_n = share_d * weight_p * weight_p * f0, share_n * weight
        by_spread = by_n * (0.5 * misfit - 1.0)
        gx = by_d * x[0] + by_n * (ex * x[1] + ey * x[2] + ez * x[3]) + by_spread * ax
        gy = by_d * y[0] + by_n * (ex * y[1] + ey * y[2] + ez * y[3]) + by_spread * ay
        gz = by_d * z[0] + by_n * (ex * z[1] + ey * z[2] + ez * z[3]) + by_spread * az
        g = _chained(gx, gy, gz, qx, qy, qz)
        row = _GRADIENT + lane
        w[row] += g[0] + by_n * (my * f3 - mz * f2)
        w[row + _1] += g[1] + by_n * (mz * f1 - mx * f3)
        w[row + _2] += g[2] + by_n * (mx * f2 - my * f1)
        w[row + _3] += g[3]
        w[row + _4] += g[4]
        w[row + _5] += g[5]

        # The rows that carry information: of the distance along the mean normal, and of that normal's direction.
        sure, root, turn = scale * weight_p * np.sqrt(share_d), np.sqrt(by_n), scale * scale
        unit, mx, my, mz = root * scale, root * mx, root * my, root * mz
        a = _chained(sure * f1, sure * f2, sure * f3, qx, qy, qz)
        b = _chained(
            unit * (x[1] - turn * f1 * ax), unit * (y[1] - turn * f1 * ay), unit * (z[1] - turn * f1 * az), qx, qy, qz
        )
        c = _chained(
            unit * (x[2] - turn * f2 * ax), unit * (y[2] - turn * f2 * ay), unit * (z[2] - turn * f2 * az), qx, qy, qz
        )
        d = _chained(
            unit * (x[3] - turn * f3 * ax), unit * (y[3] - turn * f3 * ay), unit * (z[3] - turn * f3 * az), qx, qy, qz
        )
        b = b[0], b[1] + mz, b[2] - my, b[3], b[4], b[5]
        c = c[0] - mz, c[1], c[2] + mx, c[3], c[4], c[5]
        d = d[0] + my, d[1] - mx, d[2], d[3], d[4], d[5]
        _add_squares(w, _HESSIAN + lane, a, b, c, d)
    for lane in range(np.uintp(lanes)):
        if w[_SPREAD + lane] > _LARGEST:
            w[COST + lane] += np.log(w[_SPREAD + lane])
            w[_SPREAD + lane] = 1.0


@inlined
def total_cost(w, lane):
    """The sum of the contacts' costs at the pose of a lane."""
    return w[COST + lane] + np.log(w[_SPREAD + lane])


@inlined
def leave(w, lane, X, g, H, gradient, hessian):
    """Gradient (6,) and Hessian (6, 6) by (w, v) at the pose X (3, 4) of a lane; g (6,) and H (6, 6) are scratch."""
    row = _HESSIAN + lane
    for a in range(6):
        g[a] = w[_GRADIENT + np.uintp(LANES * a) + lane]
        for c in range(a + 1):
            H[a, c] = w[row]
            row += _1
    turn_translations(X, g, H, gradient, hessian)
