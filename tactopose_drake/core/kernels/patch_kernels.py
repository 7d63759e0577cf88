"""The inner loops of `PatchCells`, in the style of `pose_kernels.py`: each is one loop over poses.

A pad is a run of cells, each a point in P where the surface is (side 0), which is not inside of it (side -1), or not
outside of it (side 1). The pad is misplaced by u = (turn, shift), in standard deviations, about its middle: a cell at
the arm l from there is at l + sigma_rotation turn x l + sigma_position shift. u takes the value that makes the pad's
cost least. It is found in O, where the distances are.

`grid` is (values, origin, 1 / spacing); `pads` is (points (n, 3), normals (n, 3), traits (n, 4), starts (k + 1,),
middles (k, 3)), where a cell's traits are its side, weight, depth and half its width, and starts say where the cells of
each pad begin, and that there are n; `sigmas` is (sigma_rotation, sigma_position). The starts are unsigned, because
loops over such numbers need no check for negative indices.
"""

from typing import Any, NamedTuple

import numpy as np
from numba import njit

from tactopose_drake.core.kernels.pose_kernels import (
    _SOFT_LENGTH,
    _cell,
    _interpolate,
    _rotate_to_object,
    _to_object,
    _turn_translations,
)

_FAST = {"contract", "reassoc", "nsz", "arcp"}

# Where the local model of a pad's cost promises less than this, it is taken at its word. That takes two steps or three;
# at creases it may take many, which are not worth their time.
_LEAST_PROMISE = 1e-6
_MOST_STEPS = 4
# A pad that costs more than this after one step is explained by no noise; how far it is off is told well enough.
_HOPELESS = 30.0


class _Cells(NamedTuple):
    """Scratch: n cells at one pose, in O.

    Attributes:
        arms: from the pad's middle, shape (n, 3).
        outward: normals out of the pad, shape (n, 3).
        places: where they are, misplaced, shape (n, 3).
        clear: how far each that feels nothing is from the object where the pad is not misplaced, shape (n,).
        weights: what each counts, 0 where it does not, shape (n,).
        residual: weighted distances, shape (n,).
        slopes: derivatives of the residual by the place: of the interpolated distance, shape (n, 3).
        normals: the same along the interpolated normal, shape (n, 3).
        by_pad, by_pose: derivatives of the residual by the misplacement and by the pose's (w, R^T v), shape (n, 6).
    """

    arms: Any
    outward: Any
    places: Any
    clear: Any
    weights: Any
    residual: Any
    slopes: Any
    normals: Any
    by_pad: Any
    by_pose: Any


class _Pad(NamedTuple):
    """Scratch: a pad's misplacement.

    Attributes:
        middle: of the pad in O, shape (3,).
        u: the misplacement, shape (6,).
        g, H: gradient (6,) and Hessian (lower triangle of (6, 6)) of the pad's cost there.
        L: a factor, shape (6, 6).
        step, trial: shape (6,).
    """

    middle: Any
    u: Any
    g: Any
    H: Any
    L: Any
    step: Any
    trial: Any


@njit(cache=True, nogil=True, error_model="numpy")
def patch_costs(grid, pads, sigmas, X, costs):  # type: ignore[no-untyped-def]
    """Half the sum of squares of the residuals of each pad at each pose, into costs (B, k)."""
    cells, pad = _scratch(len(pads[0]))
    for b in range(X.shape[0]):
        for k in range(len(pads[4])):
            costs[b, k] = _settle(grid, pads, k, sigmas, X[b], cells, pad)


@njit(cache=True, nogil=True, error_model="numpy")
def patch_residuals(grid, pads, sigmas, X, residuals, jacobian):  # type: ignore[no-untyped-def]
    """Residuals (B, n + 6 k), of the cells and then of the pads' misplacements, and their Jacobian by the increment.

    How the misplacement follows the pose is Gauss and Newton's approximation, exact where the residuals vanish.
    """
    starts, n = pads[3], len(pads[0])
    cells, pad = _scratch(n)
    C, follow = np.empty((6, 6)), np.empty((6, 6))
    for b in range(X.shape[0]):
        residuals[b] = 0.0
        jacobian[b] = 0.0
        for k in range(len(pads[4])):
            _settle(grid, pads, k, sigmas, X[b], cells, pad)
            run = starts[k], starts[k + 1]
            _make_rows(cells.slopes, sigmas, run, cells)
            _couple(run, cells, C, pad.L)
            for c in range(6):
                follow[c] = -C[:, c]
                _solve(pad.L, follow[c])
            for i in range(run[0], run[1]):
                residuals[b, i] = cells.residual[i]
                for c in range(6):
                    jacobian[b, i, c] = cells.by_pose[i, c]
                    for a in range(6):
                        jacobian[b, i, c] += cells.by_pad[i, a] * follow[c, a]
            for a in range(6):  # The misplacement in P.
                m, row, first = n + 6 * k + a, a % 3, 3 * (a // 3)
                for e in range(3):
                    residuals[b, m] += X[b, row, e] * pad.u[first + e]
                    for c in range(6):
                        jacobian[b, m, c] += X[b, row, e] * follow[c, first + e]
        for i in range(residuals.shape[1]):  # From (w, R^T v) to (w, v).
            x, y, z = jacobian[b, i, 3], jacobian[b, i, 4], jacobian[b, i, 5]
            for a in range(3):
                jacobian[b, i, 3 + a] = X[b, a, 0] * x + X[b, a, 1] * y + X[b, a, 2] * z


@njit(cache=True, nogil=True, error_model="numpy")
def patch_normal_equations(grid, pads, sigmas, X, cost, gradient, hessian):  # type: ignore[no-untyped-def]
    """Cost (B,), gradient (B, 6), and the Gauss-Newton Hessian (B, 6, 6) along the smooth normals."""
    starts = pads[3]
    cells, pad = _scratch(len(pads[0]))
    C, rest, g, H = np.empty((6, 6)), np.empty(6), np.empty(6), np.empty((6, 6))
    for b in range(X.shape[0]):
        cost[b] = 0.0
        g[:] = 0.0
        H[:] = 0.0
        for k in range(len(pads[4])):
            cost[b] += _settle(grid, pads, k, sigmas, X[b], cells, pad)
            run = starts[k], starts[k + 1]
            _make_rows(cells.slopes, sigmas, run, cells)
            _couple(run, cells, C, pad.L)
            # The rest of the way to the least cost, by the local model.
            rest[:] = pad.u
            for i in range(run[0], run[1]):
                for a in range(6):
                    g[a] += cells.by_pose[i, a] * cells.residual[i]
                    rest[a] += cells.by_pad[i, a] * cells.residual[i]
            _solve(pad.L, rest)
            for c in range(6):
                for a in range(6):
                    g[c] -= C[a, c] * rest[a]
            # What the misplacement takes up is not known of the pose: the Schur complement.
            _look_along(grid, run, cells)
            _make_rows(cells.normals, sigmas, run, cells)
            _couple(run, cells, C, pad.L)
            for i in range(run[0], run[1]):
                if cells.weights[i] > 0.0:
                    for a in range(6):
                        for c in range(a + 1):
                            H[a, c] += cells.by_pose[i, a] * cells.by_pose[i, c]
            for c in range(6):
                rest[:] = C[:, c]
                _solve(pad.L, rest)
                for a in range(c, 6):
                    for e in range(6):
                        H[a, c] -= C[e, a] * rest[e]
        _turn_translations(X[b], g, H, gradient[b], hessian[b])


@njit(cache=True)
def _scratch(n):  # type: ignore[no-untyped-def]
    """Room for n cells, and for a pad."""
    cells = _Cells(
        np.empty((n, 3)),
        np.empty((n, 3)),
        np.empty((n, 3)),
        np.empty(n),
        np.empty(n),
        np.empty(n),
        np.empty((n, 3)),
        np.empty((n, 3)),
        np.empty((n, 6)),
        np.empty((n, 6)),
    )
    pad = _Pad(np.empty(3), np.empty(6), np.empty(6), np.empty((6, 6)), np.empty((6, 6)), np.empty(6), np.empty(6))
    return cells, pad


@njit(cache=True, error_model="numpy")
def _enter(pads, k, X, cells, pad):  # type: ignore[no-untyped-def]
    """A pad in O at the pose X: its middle, its cells' arms and outward normals; nothing is known of them yet."""
    points, normals, _, starts, middles = pads
    _to_object(X, middles[k], pad.middle)
    for i in range(starts[k], starts[k + 1]):
        _to_object(X, points[i], cells.arms[i])
        _rotate_to_object(X, normals[i], cells.outward[i])
        cells.clear[i] = 0.0
        for a in range(3):
            cells.arms[i, a] -= pad.middle[a]


@njit(cache=True, error_model="numpy", fastmath=_FAST)
def _misplace(u, sigmas, run, cells, pad):  # type: ignore[no-untyped-def]
    """Where the cells of a pad that is misplaced by u are."""
    arms, places = cells.arms, cells.places
    x, y, z = sigmas[0] * u[0], sigmas[0] * u[1], sigmas[0] * u[2]
    a, b, c = pad.middle[0] + sigmas[1] * u[3], pad.middle[1] + sigmas[1] * u[4], pad.middle[2] + sigmas[1] * u[5]
    for i in range(run[0], run[1]):
        places[i, 0] = a + arms[i, 0] + y * arms[i, 2] - z * arms[i, 1]
        places[i, 1] = b + arms[i, 1] + z * arms[i, 0] - x * arms[i, 2]
        places[i, 2] = c + arms[i, 2] + x * arms[i, 1] - y * arms[i, 0]


@njit(cache=True, inline="always")
def _slack(dot, square, depth, width):  # type: ignore[no-untyped-def]
    """How far a pressed cell's point may be from a surface that only a part of the cell feels, see `PatchCells`.

    Given are the gradient's part along the pad's inward normal, and its square.
    """
    along = max(square - dot * dot, 0.0)
    dot = max(dot, 0.0)
    if width * width * along <= depth * depth * dot * dot:
        return 0.0
    return (np.sqrt(width * np.sqrt(along)) - np.sqrt(depth * dot)) ** 2


@njit(cache=True, error_model="numpy", fastmath=_FAST)
def _look(grid, traits, run, cells, pad):  # type: ignore[no-untyped-def]
    """The cells' weights at their places, the residuals, and the slopes of these.

    A cell that feels nothing does not count before it has come as far as it was clear of the object.
    """
    values, origin, inverse_spacing = grid
    flat = values.reshape(-1)
    nx, ny, nz = values.shape[0], values.shape[1], values.shape[2]
    sy, sx = np.uintp(4 * nz), np.uintp(4 * nz * ny)
    places, slopes, arms, outward, middle = cells.places, cells.slopes, cells.arms, cells.outward, pad.middle
    weights, residual, clear = cells.weights, cells.residual, cells.clear
    for i in range(run[0], run[1]):
        moved = 0.0
        for a in range(3):
            moved += (places[i, a] - middle[a] - arms[i, a]) ** 2
        if moved < clear[i] ** 2:
            weights[i] = residual[i] = slopes[i, 0] = slopes[i, 1] = slopes[i, 2] = 0.0
            continue
        ix, fx, ox = _cell(places[i, 0], origin[0], inverse_spacing, nx - 1.0)
        iy, fy, oy = _cell(places[i, 1], origin[1], inverse_spacing, ny - 1.0)
        iz, fz, oz = _cell(places[i, 2], origin[2], inverse_spacing, nz - 1.0)
        at = np.uintp(4 * ((ix * ny + iy) * nz + iz))
        distance, dx, dy, dz = _interpolate(flat, at, sx, sy, fx, fy, fz)
        dx, dy, dz = dx * inverse_spacing, dy * inverse_spacing, dz * inverse_spacing
        if ox != 0.0 or oy != 0.0 or oz != 0.0:
            way = np.sqrt(ox * ox + oy * oy + oz * oz)
            distance += way / inverse_spacing
            dx, dy, dz = ox / way if ox != 0.0 else dx, oy / way if oy != 0.0 else dy, oz / way if oz != 0.0 else dz
        slopes[i, 0], slopes[i, 1], slopes[i, 2] = dx, dy, dz
        side, weight = traits[i, 0], traits[i, 1]
        if side * distance < 0.0:
            if moved == 0.0:
                clear[i] = max(distance, 0.0)
            weight = 0.0
        elif side >= 0.0:
            dot = -dx * outward[i, 0] - dy * outward[i, 1] - dz * outward[i, 2]
            slack = _slack(dot, dx * dx + dy * dy + dz * dz, traits[i, 2], traits[i, 3])
            if slack > 0.0:
                weight /= np.sqrt(1.0 + (weight * slack) ** 2 / 3.0)
        weights[i], residual[i] = weight, weight * distance
        for a in range(3):
            slopes[i, a] *= weight


@njit(cache=True, error_model="numpy", fastmath=_FAST)
def _look_along(grid, run, cells):  # type: ignore[no-untyped-def]
    """The normals at the places."""
    values, origin, inverse_spacing = grid
    flat = values.reshape(-1)
    nx, ny, nz = values.shape[0], values.shape[1], values.shape[2]
    sy, sx = np.uintp(4 * nz), np.uintp(4 * nz * ny)
    places, normals = cells.places, cells.normals
    for i in range(run[0], run[1]):
        if cells.weights[i] == 0.0:
            normals[i, 0] = normals[i, 1] = normals[i, 2] = 0.0
            continue
        ix, fx, _ = _cell(places[i, 0], origin[0], inverse_spacing, nx - 1.0)
        iy, fy, _ = _cell(places[i, 1], origin[1], inverse_spacing, ny - 1.0)
        iz, fz, _ = _cell(places[i, 2], origin[2], inverse_spacing, nz - 1.0)
        at = np.uintp(4 * ((ix * ny + iy) * nz + iz))
        square = _SOFT_LENGTH**2
        for a in range(3):
            normals[i, a] = _interpolate(flat, at + np.uintp(1 + a), sx, sy, fx, fy, fz)[0]
            square += normals[i, a] ** 2
        for a in range(3):
            normals[i, a] *= cells.weights[i] / np.sqrt(square)


@njit(cache=True, inline="always")
def _row(i, levers, directions, turn, shift, rows):  # type: ignore[no-untyped-def]
    """The derivatives by a turn and a shift of the i-th point at its lever, given those by the point, of (n, 3) each.

    Whole arrays are given, because a row of one that is given has its references counted.
    """
    x, y, z = directions[i, 0], directions[i, 1], directions[i, 2]
    rows[i, 0] = turn * (levers[i, 1] * z - levers[i, 2] * y)
    rows[i, 1] = turn * (levers[i, 2] * x - levers[i, 0] * z)
    rows[i, 2] = turn * (levers[i, 0] * y - levers[i, 1] * x)
    rows[i, 3], rows[i, 4], rows[i, 5] = shift * x, shift * y, shift * z


@njit(cache=True, error_model="numpy", fastmath=_FAST)
def _make_rows(directions, sigmas, run, cells):  # type: ignore[no-untyped-def]
    """The derivatives by misplacement and pose, given those by the places: the directions (n, 3)."""
    arms, places, by_pad, by_pose = cells.arms, cells.places, cells.by_pad, cells.by_pose
    for i in range(run[0], run[1]):
        _row(i, arms, directions, sigmas[0], sigmas[1], by_pad)
        _row(i, places, directions, -1.0, -1.0, by_pose)


@njit(cache=True, error_model="numpy", fastmath=_FAST)
def _couple(run, cells, C, L):  # type: ignore[no-untyped-def]
    """A pad's second derivatives: C (6, 6) by misplacement and pose, and the factor L of that by the misplacement."""
    weights, by_pad, by_pose = cells.weights, cells.by_pad, cells.by_pose
    C[:] = 0.0
    L[:] = 0.0
    for a in range(6):
        L[a, a] = 1.0
    for i in range(run[0], run[1]):
        if weights[i] > 0.0:
            for a in range(6):
                for c in range(6):
                    C[a, c] += by_pad[i, a] * by_pose[i, c]
                for c in range(a + 1):
                    L[a, c] += by_pad[i, a] * by_pad[i, c]
    _factor(L)


@njit(cache=True, error_model="numpy", fastmath=_FAST)
def _expand(sigmas, run, cells, pad):  # type: ignore[no-untyped-def]
    """The gradient and Gauss-Newton Hessian of a pad's cost by its misplacement."""
    g, H = pad.g, pad.H
    arms, slopes, weights, residual, rows = cells.arms, cells.slopes, cells.weights, cells.residual, cells.by_pad
    H[:] = 0.0
    for a in range(6):
        H[a, a], g[a] = 1.0, pad.u[a]
    for i in range(run[0], run[1]):
        if weights[i] > 0.0:
            _row(i, arms, slopes, sigmas[0], sigmas[1], rows)
            for a in range(6):
                g[a] += rows[i, a] * residual[i]
                for c in range(a + 1):
                    H[a, c] += rows[i, a] * rows[i, c]


@njit(cache=True, error_model="numpy", fastmath=_FAST)
def _settle(grid, pads, k, sigmas, X, cells, pad):  # type: ignore[no-untyped-def]
    """A pad's least cost over its misplacement, by Levenberg and Marquardt's steps from 0; leaves the cells there."""
    u, g, L, step, trial = pad.u, pad.g, pad.L, pad.step, pad.trial
    traits, run = pads[2], (pads[3][k], pads[3][k + 1])
    _enter(pads, k, X, cells, pad)
    trial[:] = 0.0
    cost, damping, rejected = np.inf, 0.0, False
    for tried in range(_MOST_STEPS + 1):
        _misplace(trial, sigmas, run, cells, pad)
        _look(grid, traits, run, cells, pad)
        there = 0.0
        for i in range(run[0], run[1]):
            there += cells.residual[i] ** 2
        for a in range(6):
            there += trial[a] ** 2
        there *= 0.5
        rejected = not there < cost
        if rejected:
            damping = max(10.0 * damping, 1.0)
        else:
            cost, damping = there, 0.1 * damping
            u[:] = trial
            _expand(sigmas, run, cells, pad)
        for a in range(6):
            for c in range(a + 1):
                L[a, c] = pad.H[a, c]
            L[a, a] *= 1.0 + damping
            step[a] = -g[a]
        _factor(L)
        _solve(L, step)
        promise = 0.0
        for a in range(6):
            promise -= 0.5 * g[a] * step[a]
            trial[a] = u[a] + step[a]
        if promise < _LEAST_PROMISE:
            cost -= promise
            break
        if tried > 0 and cost > _HOPELESS:
            break
    if rejected:
        _misplace(u, sigmas, run, cells, pad)
        _look(grid, traits, run, cells, pad)
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
