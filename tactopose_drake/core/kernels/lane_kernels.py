"""Contacts on the distance grid, compiled for several poses at a time, so that the processor works on them together.

Each number of a pose is one of eight that lie next to each other, a row of lanes. All rows are one array: of places in
one array, so far apart, a compiler knows that they do not overlap. What differs from lane to lane (which nodes of the
grid are read) is copied into rows first. A loop over lanes has no branches and no function that exists for single
numbers only; then it becomes four numbers to an instruction.

All is in the object's frame: increments are (w, R^T v) until `leave`. The formulas are those of
`surface_contact_kernels.contact_rows`.
"""

import numpy as np

from tactopose_drake.core.compilation import Floats1, Floats3, OutFloats1, inlined, part
from tactopose_drake.core.kernels.grid_kernels import SOFT_LENGTH, Grid
from tactopose_drake.core.kernels.pose_kernels import turn_translations
from tactopose_drake.core.kernels.prefetch import prefetch

LANES = 8
# Bounds the derivative of the square root in the residual that normalises the normals' likelihood.
SOFT_ROOT = 1e-4
# Where rows begin: of a pose; of a contact's point and normal in O; of its place in the grid; of the grid's values at
# the cell's corners; of its energies, and what it counts for; of sums over the contacts.
_POSE, _POINT, _NORMAL, _FRACTION, _OUTSIDE, _CORNERS = (np.uintp(LANES * row) for row in (0, 12, 15, 18, 21, 24))
DISTANCE_ENERGY, NORMAL_ENERGY, DISTANCE_SHARE, NORMAL_SHARE = (np.uintp(LANES * row) for row in (56, 57, 58, 59))
COST, _SPREAD, _GRADIENT, _HESSIAN = (np.uintp(LANES * row) for row in (60, 61, 62, 68))
_NODE = np.uintp(LANES * 89)
SIZE = LANES * 90
"""Numbers that the rows take."""

_1, _2, _3, _4, _5 = (np.uintp(LANES * row) for row in range(1, 6))
_Z, _Y, _X = (np.uintp(LANES * row) for row in (4, 8, 16))  # From corner to corner, each of four channels.
_LARGEST = 1e200


@part
def enter(X: Floats3, first: int, lanes: int, w: OutFloats1) -> None:
    """The poses X[first : first + lanes], each of (3, 4), into lanes; the sums over contacts begin at zero."""
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
    """What the grid says about a contact's point p and normal n (3,) in P: its cell's corners, by lanes."""
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
            # A NaN, too, must not become an index.
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
    """One channel between the corners, and its slopes per cell."""
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
    """A contact's energies: half the squares of its whitened residuals, by distance and by normal."""
    for lane in range(np.uintp(lanes)):
        fx, fy, fz = w[_FRACTION + lane], w[_FRACTION + _1 + lane], w[_FRACTION + _2 + lane]
        ox, oy, oz = w[_OUTSIDE + lane], w[_OUTSIDE + _1 + lane], w[_OUTSIDE + _2 + lane]
        f0 = _interpolate(w, _CORNERS + lane, fx, fy, fz)[0] + np.sqrt(ox * ox + oy * oy + oz * oz) / inverse_spacing
        f1 = _interpolate(w, _CORNERS + _1 + lane, fx, fy, fz)[0]
        f2 = _interpolate(w, _CORNERS + _2 + lane, fx, fy, fz)[0]
        f3 = _interpolate(w, _CORNERS + _3 + lane, fx, fy, fz)[0]
        spread = 1.0 + 0.5 * max(0.0, 1.0 - (f1 * f1 + f2 * f2 + f3 * f3)) * weight_n * weight_n
        x, y, z = f1 - w[_NORMAL + lane], f2 - w[_NORMAL + _1 + lane], f3 - w[_NORMAL + _2 + lane]
        w[DISTANCE_ENERGY + lane] = 0.5 * f0 * f0 * weight_p * weight_p
        w[NORMAL_ENERGY + lane] = 0.5 * weight_n * weight_n / spread * (x * x + y * y + z * z)
        w[_SPREAD + lane] = spread
    if weight_n > 0.0:
        for lane in range(np.uintp(lanes)):
            w[NORMAL_ENERGY + lane] += np.log(w[_SPREAD + lane]) + 0.5 * SOFT_ROOT


@part
def add_equations(inverse_spacing: float, weight_p: float, weight_n: float, lanes: int, w: OutFloats1) -> None:
    """Adds a contact's part of the cost, of its gradient, and of the Hessian, each energy times what it counts for.

    The cost lacks the logarithms of the normals' variances, which wait in one product; see `total_cost`.
    """
    rest = 0.5 * SOFT_ROOT if weight_n > 0.0 else 0.0
    for lane in range(np.uintp(lanes)):
        fx, fy, fz = w[_FRACTION + lane], w[_FRACTION + _1 + lane], w[_FRACTION + _2 + lane]
        ox, oy, oz = w[_OUTSIDE + lane], w[_OUTSIDE + _1 + lane], w[_OUTSIDE + _2 + lane]
        way = np.sqrt(ox * ox + oy * oy + oz * oz)
        per_way = 1.0 / way if way > 0.0 else 0.0
        # Outside of the grid the field is its nearest point's, and the way there is added.
        kx = inverse_spacing if ox == 0.0 else 0.0
        ky = inverse_spacing if oy == 0.0 else 0.0
        kz = inverse_spacing if oz == 0.0 else 0.0
        f0, x0, y0, z0 = _interpolate(w, _CORNERS + lane, fx, fy, fz)
        f1, x1, y1, z1 = _interpolate(w, _CORNERS + _1 + lane, fx, fy, fz)
        f2, x2, y2, z2 = _interpolate(w, _CORNERS + _2 + lane, fx, fy, fz)
        f3, x3, y3, z3 = _interpolate(w, _CORNERS + _3 + lane, fx, fy, fz)
        f0 += way / inverse_spacing
        x0, x1, x2, x3 = x0 * kx + ox * per_way, x1 * kx, x2 * kx, x3 * kx
        y0, y1, y2, y3 = y0 * ky + oy * per_way, y1 * ky, y2 * ky, y3 * ky
        z0, z1, z2, z3 = z0 * kz + oz * per_way, z1 * kz, z2 * kz, z3 * kz

        qx, qy, qz = w[_POINT + lane], w[_POINT + _1 + lane], w[_POINT + _2 + lane]
        mx, my, mz = w[_NORMAL + lane], w[_NORMAL + _1 + lane], w[_NORMAL + _2 + lane]
        share_d, share_n = w[DISTANCE_SHARE + lane], w[NORMAL_SHARE + lane]
        square = f1 * f1 + f2 * f2 + f3 * f3
        scale = 1.0 / np.sqrt(square + SOFT_LENGTH**2)
        spread = 1.0 + 0.5 * max(0.0, 1.0 - square) * weight_n * weight_n
        weight = weight_n * weight_n / spread  # One over the variance of the normal's difference.
        ex, ey, ez = f1 - mx, f2 - my, f3 - mz
        misfit = weight * (ex * ex + ey * ey + ez * ez)
        w[COST + lane] += 0.5 * (share_d * f0 * f0 * weight_p * weight_p + share_n * misfit) + rest
        w[_SPREAD + lane] *= spread

        # The derivative of half the squared length of the mean normal, which says how its variance changes.
        inside = 1.0 if square < 1.0 else 0.0
        ax = inside * (f1 * x1 + f2 * x2 + f3 * x3)
        ay = inside * (f1 * y1 + f2 * y2 + f3 * y3)
        az = inside * (f1 * z1 + f2 * z2 + f3 * z3)
        # The cost's derivative by the point in O, and by the turn of the normal.
        by_d, by_n, by_spread = share_d * weight_p * weight_p * f0, share_n * weight, share_n * weight
        by_spread *= 0.5 * misfit - 1.0
        gx = by_d * x0 + by_n * (ex * x1 + ey * x2 + ez * x3) + by_spread * ax
        gy = by_d * y0 + by_n * (ex * y1 + ey * y2 + ez * y3) + by_spread * ay
        gz = by_d * z0 + by_n * (ex * z1 + ey * z2 + ez * z3) + by_spread * az
        row = _GRADIENT + lane
        w[row] += gy * qz - gz * qy + by_n * (my * f3 - mz * f2)
        w[row + _1] += gz * qx - gx * qz + by_n * (mz * f1 - mx * f3)
        w[row + _2] += gx * qy - gy * qx + by_n * (mx * f2 - my * f1)
        w[row + _3] -= gx
        w[row + _4] -= gy
        w[row + _5] -= gz

        # The rows that carry information, by (w, R^T v): a of the distance along the mean normal, b, c, d of its
        # direction.
        unit = scale * weight_p * np.sqrt(share_d)
        a3, a4, a5 = -unit * f1, -unit * f2, -unit * f3
        a0, a1, a2 = a5 * qy - a4 * qz, a3 * qz - a5 * qx, a4 * qx - a3 * qy
        root = np.sqrt(by_n)
        unit, turn = -root * scale, scale * scale
        b3, b4, b5 = unit * (x1 - turn * f1 * ax), unit * (y1 - turn * f1 * ay), unit * (z1 - turn * f1 * az)
        c3, c4, c5 = unit * (x2 - turn * f2 * ax), unit * (y2 - turn * f2 * ay), unit * (z2 - turn * f2 * az)
        d3, d4, d5 = unit * (x3 - turn * f3 * ax), unit * (y3 - turn * f3 * ay), unit * (z3 - turn * f3 * az)
        mx, my, mz = root * mx, root * my, root * mz
        b0, b1, b2 = b5 * qy - b4 * qz, b3 * qz - b5 * qx + mz, b4 * qx - b3 * qy - my
        c0, c1, c2 = c5 * qy - c4 * qz - mz, c3 * qz - c5 * qx, c4 * qx - c3 * qy + mx
        d0, d1, d2 = d5 * qy - d4 * qz + my, d3 * qz - d5 * qx - mx, d4 * qx - d3 * qy
        row = _HESSIAN + lane
        w[row] += a0 * a0 + b0 * b0 + c0 * c0 + d0 * d0
        row += _1
        w[row] += a1 * a0 + b1 * b0 + c1 * c0 + d1 * d0
        w[row + _1] += a1 * a1 + b1 * b1 + c1 * c1 + d1 * d1
        row += _2
        w[row] += a2 * a0 + b2 * b0 + c2 * c0 + d2 * d0
        w[row + _1] += a2 * a1 + b2 * b1 + c2 * c1 + d2 * d1
        w[row + _2] += a2 * a2 + b2 * b2 + c2 * c2 + d2 * d2
        row += _3
        w[row] += a3 * a0 + b3 * b0 + c3 * c0 + d3 * d0
        w[row + _1] += a3 * a1 + b3 * b1 + c3 * c1 + d3 * d1
        w[row + _2] += a3 * a2 + b3 * b2 + c3 * c2 + d3 * d2
        w[row + _3] += a3 * a3 + b3 * b3 + c3 * c3 + d3 * d3
        row += _4
        w[row] += a4 * a0 + b4 * b0 + c4 * c0 + d4 * d0
        w[row + _1] += a4 * a1 + b4 * b1 + c4 * c1 + d4 * d1
        w[row + _2] += a4 * a2 + b4 * b2 + c4 * c2 + d4 * d2
        w[row + _3] += a4 * a3 + b4 * b3 + c4 * c3 + d4 * d3
        w[row + _4] += a4 * a4 + b4 * b4 + c4 * c4 + d4 * d4
        row += _5
        w[row] += a5 * a0 + b5 * b0 + c5 * c0 + d5 * d0
        w[row + _1] += a5 * a1 + b5 * b1 + c5 * c1 + d5 * d1
        w[row + _2] += a5 * a2 + b5 * b2 + c5 * c2 + d5 * d2
        w[row + _3] += a5 * a3 + b5 * b3 + c5 * c3 + d5 * d3
        w[row + _4] += a5 * a4 + b5 * b4 + c5 * c4 + d5 * d4
        w[row + _5] += a5 * a5 + b5 * b5 + c5 * c5 + d5 * d5
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
    """Gradient (6,) and Hessian (6, 6) by (w, v) at the pose X (3, 4) of a lane; g (6,) and H (6, 6) are for work."""
    row = _HESSIAN + lane
    for a in range(6):
        g[a] = w[_GRADIENT + np.uintp(LANES * a) + lane]
        for c in range(a + 1):
            H[a, c] = w[row]
            row += _1
    turn_translations(X, g, H, gradient, hessian)
