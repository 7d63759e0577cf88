"""The inner loops of `PatchContact`, in the style of `kernels.py`: each is one loop over poses.

A pad is a run of cells, each a point p_PQ (n, 3) where the surface is (side 0), where it is not inside of (side -1), or
not outside of (side 1). Its misplacement u (3,), in standard deviations, changes the distances by arms (n, 3) times u,
and takes the value that makes the pad's cost least. `grid` is (values, origin, 1 / spacing), `cells` is (points, sides,
weights, arms, ends): the pads' cells one after another, and where each pad's begin.
"""

import numpy as np
from numba import njit

from tactopose_drake.core.kernels import _SOFT_LENGTH, _cell, _chain, _extend, _interpolate, _to_object

_MOST_STEPS = 20


@njit(cache=True, nogil=True, error_model="numpy")
def patch_costs(grid, cells, X, cost):  # type: ignore[no-untyped-def]
    """Half the sum of squares of the residuals of each pose, into cost (B,)."""
    values, origin, inverse_spacing = grid
    points, sides, weights, arms, ends = cells
    flat = values.reshape(-1)
    nx, ny, nz = values.shape[0], values.shape[1], values.shape[2]
    sy, sx = np.uintp(4 * nz), np.uintp(4 * nz * ny)
    q, phi, u, L = np.empty(3), np.empty(len(points)), np.empty(3), np.empty((3, 3))
    for b in range(X.shape[0]):
        for i in range(len(points)):
            _to_object(X[b], points[i], q)
            ix, fx, ox = _cell(q[0], origin[0], inverse_spacing, nx - 1.0)
            iy, fy, oy = _cell(q[1], origin[1], inverse_spacing, ny - 1.0)
            iz, fz, oz = _cell(q[2], origin[2], inverse_spacing, nz - 1.0)
            at = np.uintp(4 * ((ix * ny + iy) * nz + iz))
            phi[i] = _interpolate(flat, at, sx, sy, fx, fy, fz)[0]
            if ox != 0.0 or oy != 0.0 or oz != 0.0:
                phi[i] += np.sqrt(ox * ox + oy * oy + oz * oz) / inverse_spacing
        total = 0.0
        for k in range(len(ends) - 1):
            total += _settle(phi, sides, weights, arms, ends[k], ends[k + 1], u, L)
        cost[b] = total


@njit(cache=True, nogil=True, error_model="numpy")
def patch_residuals(grid, cells, X, residuals, jacobian):  # type: ignore[no-untyped-def]
    """Residuals (B, n + 3 k), of the cells and then of the pads' misplacements, and their Jacobian by the increment."""
    points, sides, weights, arms, ends = cells
    count = len(points)
    phi, exact, smooth = np.empty(count), np.empty((count, 6)), np.empty((count, 6))
    u, L, turned = np.empty(3), np.empty((3, 3)), np.empty((3, 6))
    for b in range(X.shape[0]):
        _look(grid, points, X[b], phi, exact, smooth)
        for k in range(len(ends) - 1):
            first, last = ends[k], ends[k + 1]
            _settle(phi, sides, weights, arms, first, last, u, L)
            _couple(phi, sides, weights, arms, first, last, u, exact, turned)
            for c in range(6):
                _solve(L, turned[:, c])
            for i in range(first, last):
                distance = phi[i] + arms[i, 0] * u[0] + arms[i, 1] * u[1] + arms[i, 2] * u[2]
                weight = weights[i] if sides[i] * distance >= 0.0 else 0.0
                residuals[b, i] = weight * distance
                for c in range(6):
                    settled = arms[i, 0] * turned[0, c] + arms[i, 1] * turned[1, c] + arms[i, 2] * turned[2, c]
                    jacobian[b, i, c] = weight * (exact[i, c] - settled)
            for a in range(3):
                residuals[b, count + 3 * k + a] = u[a]
                for c in range(6):
                    jacobian[b, count + 3 * k + a, c] = -turned[a, c]


@njit(cache=True, nogil=True, error_model="numpy")
def patch_normal_equations(grid, cells, X, cost, gradient, hessian):  # type: ignore[no-untyped-def]
    """Cost (B,), exact gradient (B, 6), and the Gauss-Newton Hessian (B, 6, 6) along the smooth normals."""
    points, sides, weights, arms, ends = cells
    count = len(points)
    phi, exact, smooth = np.empty(count), np.empty((count, 6)), np.empty((count, 6))
    u, L, coupling, solved = np.empty(3), np.empty((3, 3)), np.empty((3, 6)), np.empty(3)
    for b in range(X.shape[0]):
        _look(grid, points, X[b], phi, exact, smooth)
        cost[b] = 0.0
        gradient[b] = 0.0
        hessian[b] = 0.0
        for k in range(len(ends) - 1):
            first, last = ends[k], ends[k + 1]
            cost[b] += _settle(phi, sides, weights, arms, first, last, u, L)
            for i in range(first, last):
                distance = phi[i] + arms[i, 0] * u[0] + arms[i, 1] * u[1] + arms[i, 2] * u[2]
                if sides[i] * distance < 0.0:
                    continue
                square = weights[i] * weights[i]
                for c in range(6):
                    gradient[b, c] += square * distance * exact[i, c]
                    for e in range(c + 1):
                        hessian[b, c, e] += square * smooth[i, c] * smooth[i, e]
            # What the misplacement takes up is not known of the pose: the Schur complement.
            _couple(phi, sides, weights, arms, first, last, u, smooth, coupling)
            for c in range(6):
                for a in range(3):
                    solved[a] = coupling[a, c]
                _solve(L, solved)
                for e in range(c + 1):
                    hessian[b, c, e] -= (
                        coupling[0, e] * solved[0] + coupling[1, e] * solved[1] + coupling[2, e] * solved[2]
                    )
        for c in range(6):
            for e in range(c):
                hessian[b, e, c] = hessian[b, c, e]


@njit(cache=True, error_model="numpy")
def _look(grid, points, X, phi, exact, smooth):  # type: ignore[no-untyped-def]
    """The signed distance phi (n,) of points at a pose, and its derivatives (n, 6) by the increment.

    exact are of the interpolated distance, smooth along the interpolated normal, see `kernels._contact_rows`.
    """
    values, origin, inverse_spacing = grid
    flat = values.reshape(-1)
    nx, ny, nz = values.shape[0], values.shape[1], values.shape[2]
    sy, sx = np.uintp(4 * nz), np.uintp(4 * nz * ny)
    q, normal, field, slope = np.empty(3), np.empty(3), np.empty(4), np.empty((4, 3))
    for i in range(len(points)):
        _to_object(X, points[i], q)
        ix, fx, ox = _cell(q[0], origin[0], inverse_spacing, nx - 1.0)
        iy, fy, oy = _cell(q[1], origin[1], inverse_spacing, ny - 1.0)
        iz, fz, oz = _cell(q[2], origin[2], inverse_spacing, nz - 1.0)
        at = np.uintp(4 * ((ix * ny + iy) * nz + iz))
        for c in range(1, 4):
            field[c] = _interpolate(flat, at + np.uintp(c), sx, sy, fx, fy, fz)[0]
        field[0], dx, dy, dz = _interpolate(flat, at, sx, sy, fx, fy, fz)
        slope[0, 0], slope[0, 1], slope[0, 2] = dx * inverse_spacing, dy * inverse_spacing, dz * inverse_spacing
        if ox != 0.0 or oy != 0.0 or oz != 0.0:
            _extend(field, slope, ox, oy, oz, inverse_spacing)
        phi[i] = field[0]
        scale = 1.0 / np.sqrt(field[1] ** 2 + field[2] ** 2 + field[3] ** 2 + _SOFT_LENGTH**2)
        normal[0], normal[1], normal[2] = scale * field[1], scale * field[2], scale * field[3]
        _chain(slope[0], q, X, 1.0, exact[i])
        _chain(normal, q, X, 1.0, smooth[i])


@njit(cache=True, error_model="numpy")
def _settle(phi, sides, weights, arms, first, last, u, L):  # type: ignore[no-untyped-def]
    """A pad's least cost over its misplacement, which goes into u (3,).

    The factor L (3, 3) of the second derivative there is left too. The cost, half the square of u and of the weighted
    distances that count, is convex, and quadratic as long as the same ones count: Newton's method ends where they do.
    """
    u[:] = 0.0
    cost = _pad_cost(phi, sides, weights, arms, first, last, u)
    step, trial = np.empty(3), np.empty(3)
    for _ in range(_MOST_STEPS):
        L[:, :] = 0.0
        for a in range(3):
            L[a, a], step[a] = 1.0, -u[a]
        for i in range(first, last):
            distance = phi[i] + arms[i, 0] * u[0] + arms[i, 1] * u[1] + arms[i, 2] * u[2]
            if sides[i] * distance < 0.0:
                continue
            square = weights[i] * weights[i]
            for a in range(3):
                step[a] -= square * distance * arms[i, a]
                for c in range(a + 1):
                    L[a, c] += square * arms[i, a] * arms[i, c]
        _factor(L)
        _solve(L, step)
        if step[0] ** 2 + step[1] ** 2 + step[2] ** 2 < 1e-18 * (1.0 + u[0] ** 2 + u[1] ** 2 + u[2] ** 2):
            break
        length = 1.0
        for _ in range(30):
            for a in range(3):
                trial[a] = u[a] + length * step[a]
            trial_cost = _pad_cost(phi, sides, weights, arms, first, last, trial)
            if trial_cost <= cost:
                break
            length *= 0.5
        if trial_cost > cost:
            break
        u[:] = trial
        cost = trial_cost
    return cost


@njit(cache=True, inline="always")
def _pad_cost(phi, sides, weights, arms, first, last, u):  # type: ignore[no-untyped-def]
    """Half the sum of squares of a pad's residuals at the misplacement u (3,)."""
    total = u[0] * u[0] + u[1] * u[1] + u[2] * u[2]
    for i in range(first, last):
        distance = phi[i] + arms[i, 0] * u[0] + arms[i, 1] * u[1] + arms[i, 2] * u[2]
        if sides[i] * distance >= 0.0:
            total += (weights[i] * distance) ** 2
    return 0.5 * total


@njit(cache=True, inline="always")
def _couple(phi, sides, weights, arms, first, last, u, rows, coupling):  # type: ignore[no-untyped-def]
    """The second derivative of a pad's cost by its misplacement and the increment, into coupling (3, 6)."""
    coupling[:, :] = 0.0
    for i in range(first, last):
        if sides[i] * (phi[i] + arms[i, 0] * u[0] + arms[i, 1] * u[1] + arms[i, 2] * u[2]) < 0.0:
            continue
        square = weights[i] * weights[i]
        for a in range(3):
            for c in range(6):
                coupling[a, c] += square * arms[i, a] * rows[i, c]


@njit(cache=True, inline="always")
def _factor(L):  # type: ignore[no-untyped-def]
    """Cholesky's factor of a positive definite matrix, in the place of its lower triangle (3, 3)."""
    L[0, 0] = np.sqrt(L[0, 0])
    L[1, 0] /= L[0, 0]
    L[2, 0] /= L[0, 0]
    L[1, 1] = np.sqrt(L[1, 1] - L[1, 0] ** 2)
    L[2, 1] = (L[2, 1] - L[2, 0] * L[1, 0]) / L[1, 1]
    L[2, 2] = np.sqrt(L[2, 2] - L[2, 0] ** 2 - L[2, 1] ** 2)


@njit(cache=True, inline="always")
def _solve(L, x):  # type: ignore[no-untyped-def]
    """(L L^T)^-1 x, in the place of x (3,)."""
    x[0] /= L[0, 0]
    x[1] = (x[1] - L[1, 0] * x[0]) / L[1, 1]
    x[2] = (x[2] - L[2, 0] * x[0] - L[2, 1] * x[1]) / L[2, 2]
    x[2] /= L[2, 2]
    x[1] = (x[1] - L[2, 1] * x[2]) / L[1, 1]
    x[0] = (x[0] - L[1, 0] * x[1] - L[2, 0] * x[2]) / L[0, 0]
