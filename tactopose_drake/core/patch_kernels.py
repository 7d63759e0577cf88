"""The inner loops of `PatchCells`, in the style of `kernels.py`: each is one loop over poses.

A pad is a run of cells, each a point in P where the surface is (side 0), which is not inside of it (side -1), or not
outside of it (side 1). The pad is misplaced by u = (turn, shift), in standard deviations, about its middle: a cell at
the arm l from there is at l + sigma_rotation turn x l + sigma_position shift. u takes the value that makes the pad's
cost least. It is found in O, where the distances are.

`grid` is (values, origin, 1 / spacing); `pads` is (points (n, 3), sides (n,), weights (n,), starts (k + 1,), middles
(k, 3)), where starts say where the cells of each pad begin, and that there are n; `sigmas` is (sigma_rotation,
sigma_position). `cells` is a pad's part of the starts: unsigned, because loops over such numbers need no check for
negative indices, which makes them many times as fast.
"""

import numpy as np
from numba import njit

from tactopose_drake.core.kernels import _SOFT_LENGTH, _cell, _extend, _interpolate, _to_object, _turn_translations

_FAST = {"contract", "reassoc", "nsz", "arcp"}

# Where the local model of a pad's cost promises less than this, it is taken at its word. That takes two steps or three;
# at creases it may take many, which are not worth their time.
_LEAST_PROMISE = 1e-6
_MOST_STEPS = 4
# A pad that costs more than this after one step is explained by no noise; how far it is off is told well enough.
_HOPELESS = 30.0


@njit(cache=True, nogil=True, error_model="numpy")
def patch_costs(grid, pads, sigmas, X, cost):  # type: ignore[no-untyped-def]
    """Half the sum of squares of the residuals of each pose, into cost (B,)."""
    points, sides, weights, starts, middles = pads
    arms, places, residual, slopes, _, rows = _scratch(len(points))
    middle, u = np.empty(3), np.empty(6)
    for b in range(X.shape[0]):
        cost[b] = 0.0
        for k in range(len(middles)):
            cells = starts[k], starts[k + 1]
            _enter(X[b], points, middles[k], cells, middle, arms)
            cost[b] += _settle(grid, sides, weights, sigmas, cells, middle, arms, u, places, residual, slopes, rows)


@njit(cache=True, nogil=True, error_model="numpy")
def patch_residuals(grid, pads, sigmas, X, residuals, jacobian):  # type: ignore[no-untyped-def]
    """Residuals (B, n + 6 k), of the cells and then of the pads' misplacements, and their Jacobian by the increment.

    How the misplacement follows the pose is Gauss and Newton's approximation, exact where the residuals vanish.
    """
    points, sides, weights, starts, middles = pads
    n = len(points)
    arms, places, residual, slopes, normals, by_pad = _scratch(n)
    by_pose, middle, u = np.empty((6, n)), np.empty(3), np.empty(6)
    C, L, follow = np.empty((6, 6)), np.empty((6, 6)), np.empty((6, 6))
    for b in range(X.shape[0]):
        for k in range(len(middles)):
            cells = starts[k], starts[k + 1]
            _enter(X[b], points, middles[k], cells, middle, arms)
            _settle(grid, sides, weights, sigmas, cells, middle, arms, u, places, residual, slopes, by_pad)
            _misplace(middle, arms, sigmas, u, cells, places)
            _look(grid, places, sides, weights, cells, residual, slopes, normals)
            _make_rows(places, slopes, -1.0, -1.0, cells, by_pose)
            for i in range(cells[0], cells[1]):  # From (w, R^T v) to (w, v).
                x, y, z = by_pose[3, i], by_pose[4, i], by_pose[5, i]
                for a in range(3):
                    by_pose[3 + a, i] = X[b, a, 0] * x + X[b, a, 1] * y + X[b, a, 2] * z
            _make_rows(arms, slopes, sigmas[0], sigmas[1], cells, by_pad)
            _couple(by_pad, by_pose, cells, C, L)
            for c in range(6):
                follow[c] = -C[:, c]
                _solve(L, follow[c])
            for i in range(cells[0], cells[1]):
                residuals[b, i] = residual[i]
                for c in range(6):
                    jacobian[b, i, c] = by_pose[c, i]
                    for a in range(6):
                        jacobian[b, i, c] += by_pad[a, i] * follow[c, a]
            for a in range(6):  # The misplacement in P.
                m, row, first = n + 6 * k + a, a % 3, 3 * (a // 3)
                residuals[b, m] = 0.0
                jacobian[b, m] = 0.0
                for e in range(3):
                    residuals[b, m] += X[b, row, e] * u[first + e]
                    for c in range(6):
                        jacobian[b, m, c] += X[b, row, e] * follow[c, first + e]


@njit(cache=True, nogil=True, error_model="numpy")
def patch_normal_equations(grid, pads, sigmas, X, cost, gradient, hessian):  # type: ignore[no-untyped-def]
    """Cost (B,), gradient (B, 6), and the Gauss-Newton Hessian (B, 6, 6) along the smooth normals."""
    points, sides, weights, starts, middles = pads
    n = len(points)
    arms, places, residual, slopes, normals, by_pad = _scratch(n)
    by_pose, middle, u = np.empty((6, n)), np.empty(3), np.empty(6)
    g, H, C, L, solved = np.empty(6), np.empty((6, 6)), np.empty((6, 6)), np.empty((6, 6)), np.empty(6)
    for b in range(X.shape[0]):
        cost[b] = 0.0
        g[:] = 0.0
        H[:] = 0.0
        for k in range(len(middles)):
            cells = starts[k], starts[k + 1]
            _enter(X[b], points, middles[k], cells, middle, arms)
            cost[b] += _settle(grid, sides, weights, sigmas, cells, middle, arms, u, places, residual, slopes, by_pad)
            _misplace(middle, arms, sigmas, u, cells, places)
            _look(grid, places, sides, weights, cells, residual, slopes, normals)
            _make_rows(places, slopes, -1.0, -1.0, cells, by_pose)
            _make_rows(arms, slopes, sigmas[0], sigmas[1], cells, by_pad)
            _couple(by_pad, by_pose, cells, C, L)
            _add_gradient(by_pose, residual, cells, g)
            # The rest of the way to the least cost, by the local model.
            solved[:] = u
            _add_gradient(by_pad, residual, cells, solved)
            _solve(L, solved)
            for c in range(6):
                for a in range(6):
                    g[c] -= C[a, c] * solved[a]
            _make_rows(places, normals, -1.0, -1.0, cells, by_pose)
            _make_rows(arms, normals, sigmas[0], sigmas[1], cells, by_pad)
            _add_products(by_pose, by_pose, cells, H)
            # What the misplacement takes up is not known of the pose: the Schur complement.
            _couple(by_pad, by_pose, cells, C, L)
            for c in range(6):
                solved[:] = C[:, c]
                _solve(L, solved)
                for e in range(6):
                    for a in range(6):
                        H[c, e] -= C[a, e] * solved[a]
        _turn_translations(X[b], g, H, gradient[b], hessian[b])


@njit(cache=True)
def _scratch(n):  # type: ignore[no-untyped-def]
    """Room for n cells: arms, places (3, n), residual (n,), slopes, normals (3, n), rows (6, n)."""
    return (np.empty((3, n)), np.empty((3, n)), np.empty(n), np.empty((3, n)), np.empty((3, n)), np.empty((6, n)))


@njit(cache=True, error_model="numpy")
def _enter(X, points, middle_P, cells, middle, arms):  # type: ignore[no-untyped-def]
    """A pad in O at the pose X: its middle (3,), and the arms (3, n) from there to its cells."""
    q = np.empty(3)
    _to_object(X, middle_P, middle)
    for i in range(cells[0], cells[1]):
        _to_object(X, points[i], q)
        for a in range(3):
            arms[a, i] = q[a] - middle[a]


@njit(cache=True, error_model="numpy", fastmath=_FAST)
def _misplace(middle, arms, sigmas, u, cells, places):  # type: ignore[no-untyped-def]
    """Where a misplaced pad's cells are, places (3, n)."""
    x, y, z = sigmas[0] * u[0], sigmas[0] * u[1], sigmas[0] * u[2]
    a, b, c = middle[0] + sigmas[1] * u[3], middle[1] + sigmas[1] * u[4], middle[2] + sigmas[1] * u[5]
    for i in range(cells[0], cells[1]):
        places[0, i] = a + arms[0, i] + y * arms[2, i] - z * arms[1, i]
        places[1, i] = b + arms[1, i] + z * arms[0, i] - x * arms[2, i]
        places[2, i] = c + arms[2, i] + x * arms[1, i] - y * arms[0, i]


@njit(cache=True, error_model="numpy", fastmath=_FAST)
def _look(grid, places, sides, weights, cells, residual, slopes, normals):  # type: ignore[no-untyped-def]
    """The weighted distances at places (3, n), or 0 where they do not count, residual (n,), and their derivatives.

    slopes (3, n) are those of the interpolated distance, normals (3, n) those along the interpolated normal.
    """
    values, origin, inverse_spacing = grid
    flat = values.reshape(-1)
    nx, ny, nz = values.shape[0], values.shape[1], values.shape[2]
    sy, sx = np.uintp(4 * nz), np.uintp(4 * nz * ny)
    field, slope = np.empty(4), np.zeros((4, 3))
    for i in range(cells[0], cells[1]):
        ix, fx, ox = _cell(places[0, i], origin[0], inverse_spacing, nx - 1.0)
        iy, fy, oy = _cell(places[1, i], origin[1], inverse_spacing, ny - 1.0)
        iz, fz, oz = _cell(places[2, i], origin[2], inverse_spacing, nz - 1.0)
        at = np.uintp(4 * ((ix * ny + iy) * nz + iz))
        for c in range(1, 4):
            field[c] = _interpolate(flat, at + np.uintp(c), sx, sy, fx, fy, fz)[0]
        field[0], dx, dy, dz = _interpolate(flat, at, sx, sy, fx, fy, fz)
        slope[0, 0], slope[0, 1], slope[0, 2] = dx * inverse_spacing, dy * inverse_spacing, dz * inverse_spacing
        if ox != 0.0 or oy != 0.0 or oz != 0.0:
            _extend(field, slope, ox, oy, oz, inverse_spacing)
        weight = weights[i] if sides[i] * field[0] >= 0.0 else 0.0
        length = weight / np.sqrt(field[1] ** 2 + field[2] ** 2 + field[3] ** 2 + _SOFT_LENGTH**2)
        residual[i] = weight * field[0]
        for a in range(3):
            slopes[a, i] = weight * slope[0, a]
            normals[a, i] = length * field[1 + a]


@njit(cache=True, error_model="numpy", fastmath=_FAST)
def _look_for_slopes(grid, places, sides, weights, cells, residual, slopes):  # type: ignore[no-untyped-def]
    """As `_look`, without the normals."""
    values, origin, inverse_spacing = grid
    flat = values.reshape(-1)
    nx, ny, nz = values.shape[0], values.shape[1], values.shape[2]
    sy, sx = np.uintp(4 * nz), np.uintp(4 * nz * ny)
    for i in range(cells[0], cells[1]):
        ix, fx, ox = _cell(places[0, i], origin[0], inverse_spacing, nx - 1.0)
        iy, fy, oy = _cell(places[1, i], origin[1], inverse_spacing, ny - 1.0)
        iz, fz, oz = _cell(places[2, i], origin[2], inverse_spacing, nz - 1.0)
        at = np.uintp(4 * ((ix * ny + iy) * nz + iz))
        distance, dx, dy, dz = _interpolate(flat, at, sx, sy, fx, fy, fz)
        dx, dy, dz = dx * inverse_spacing, dy * inverse_spacing, dz * inverse_spacing
        if ox != 0.0 or oy != 0.0 or oz != 0.0:
            way = np.sqrt(ox * ox + oy * oy + oz * oz)
            distance += way / inverse_spacing
            dx, dy, dz = ox / way if ox != 0.0 else dx, oy / way if oy != 0.0 else dy, oz / way if oz != 0.0 else dz
        weight = weights[i] if sides[i] * distance >= 0.0 else 0.0
        residual[i] = weight * distance
        slopes[0, i], slopes[1, i], slopes[2, i] = weight * dx, weight * dy, weight * dz


@njit(cache=True, error_model="numpy", fastmath=_FAST)
def _make_rows(levers, directions, turn, shift, cells, rows):  # type: ignore[no-untyped-def]
    """The derivatives rows (6, n) by a turn and a shift of points at levers (3, n), given those by the points."""
    for i in range(cells[0], cells[1]):
        x, y, z = directions[0, i], directions[1, i], directions[2, i]
        rows[0, i] = turn * (levers[1, i] * z - levers[2, i] * y)
        rows[1, i] = turn * (levers[2, i] * x - levers[0, i] * z)
        rows[2, i] = turn * (levers[0, i] * y - levers[1, i] * x)
        rows[3, i], rows[4, i], rows[5, i] = shift * x, shift * y, shift * z


@njit(cache=True, error_model="numpy", fastmath=_FAST)
def _add_products(A, B, cells, out):  # type: ignore[no-untyped-def]
    """Adds A B^T over a pad's cells, of rows (6, n), to out (6, 6)."""
    for a in range(6):
        for c in range(6):
            total = 0.0
            for i in range(cells[0], cells[1]):
                total += A[a, i] * B[c, i]
            out[a, c] += total


@njit(cache=True, error_model="numpy", fastmath=_FAST)
def _add_gradient(rows, residual, cells, g):  # type: ignore[no-untyped-def]
    """Adds rows (6, n) times residual (n,) over a pad's cells to g (6,)."""
    for a in range(6):
        for i in range(cells[0], cells[1]):
            g[a] += rows[a, i] * residual[i]


@njit(cache=True)
def _couple(by_pad, by_pose, cells, C, L):  # type: ignore[no-untyped-def]
    """A pad's second derivatives: C (6, 6) by misplacement and pose, and the factor L of that by the misplacement."""
    C[:] = 0.0
    _add_products(by_pad, by_pose, cells, C)
    L[:] = np.eye(6)
    _add_products(by_pad, by_pad, cells, L)
    _factor(L)


@njit(cache=True, error_model="numpy", fastmath=_FAST)
def _settle(  # type: ignore[no-untyped-def]
    grid, sides, weights, sigmas, cells, middle, arms, u, places, residual, slopes, rows
):
    """A pad's least cost over its misplacement, which goes into u (6,), by Levenberg and Marquardt's steps from 0."""
    H, L, g, step, trial = np.empty((6, 6)), np.empty((6, 6)), np.empty(6), np.empty(6), np.zeros(6)
    u[:] = 0.0
    cost, damping = np.inf, 0.0
    for tried in range(_MOST_STEPS + 1):
        _misplace(middle, arms, sigmas, trial, cells, places)
        _look_for_slopes(grid, places, sides, weights, cells, residual, slopes)
        there = 0.0
        for i in range(cells[0], cells[1]):
            there += residual[i] * residual[i]
        for a in range(6):
            there += trial[a] * trial[a]
        there *= 0.5
        if there < cost:
            cost, damping = there, 0.1 * damping
            u[:] = trial
            _make_rows(arms, slopes, sigmas[0], sigmas[1], cells, rows)
            H[:] = np.eye(6)
            _add_products(rows, rows, cells, H)
            g[:] = u
            _add_gradient(rows, residual, cells, g)
        else:
            damping = max(10.0 * damping, 1.0)
        for a in range(6):
            for c in range(a + 1):
                L[a, c] = H[a, c]
            L[a, a] *= 1.0 + damping
            step[a] = -g[a]
        _factor(L)
        _solve(L, step)
        promise = 0.0
        for a in range(6):
            promise -= 0.5 * g[a] * step[a]
            trial[a] = u[a] + step[a]
        if promise < _LEAST_PROMISE:
            u[:] = trial
            cost -= promise
            break
        if tried > 0 and cost > _HOPELESS:
            break
    return cost


@njit(cache=True, error_model="numpy", fastmath=_FAST)
def _factor(L):  # type: ignore[no-untyped-def]
    """Cholesky's factor of a positive definite matrix (6, 6), in the place of its lower triangle."""
    for a in range(6):
        for c in range(a + 1):
            total = L[a, c]
            for e in range(c):
                total -= L[a, e] * L[c, e]
            L[a, c] = np.sqrt(total) if a == c else total / L[c, c]


@njit(cache=True, error_model="numpy", fastmath=_FAST)
def _solve(L, x):  # type: ignore[no-untyped-def]
    """(L L^T)^-1 x, in the place of x (6,)."""
    for a in range(6):
        for e in range(a):
            x[a] -= L[a, e] * x[e]
        x[a] /= L[a, a]
    for a in range(5, -1, -1):
        for e in range(a + 1, 6):
            x[a] -= L[e, a] * x[e]
        x[a] /= L[a, a]
