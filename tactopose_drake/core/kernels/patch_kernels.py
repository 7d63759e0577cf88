"""The inner loops of `PatchCells`: costs, residuals and normal equations of tactile pads, each one loop over poses.

The misplacement of each pad is found by `misplacement_kernels.py`; `grid`, `pads`, `sigmas` are as in `pad_kernels.py`.
"""

import numpy as np

from tactopose_drake.core.compilation import kernel
from tactopose_drake.core.kernel_types import Floats3, OutFloats1, OutFloats2, OutFloats3
from tactopose_drake.core.kernels.grid_kernels import Grid
from tactopose_drake.core.kernels.matrix_kernels import cholesky, solve
from tactopose_drake.core.kernels.misplacement_kernels import couple, make_rows, settle
from tactopose_drake.core.kernels.pad_kernels import Pads, find_normals, scratch
from tactopose_drake.core.kernels.pose_kernels import turn_translations
from tactopose_drake.core.kernels.sorting_kernels import copy_matrix


@kernel
def patch_costs(grid: Grid, pads: Pads, sigmas: tuple[float, float], X: Floats3, costs: OutFloats2) -> None:
    """Writes half the sum of squared residuals of each pad at each pose into costs (B, k)."""
    cells, pad = scratch(len(pads[0]))
    for b in range(X.shape[0]):
        for k in range(len(pads[4])):
            costs[b, k] = settle(grid, pads, k, sigmas, X[b], cells, pad)


@kernel
def patch_residuals(
    grid: Grid,
    pads: Pads,
    sigmas: tuple[float, float],
    X: Floats3,
    residuals: OutFloats2,
    jacobian: OutFloats3,
) -> None:
    """Residuals (B, n + 6 k), of the cells and then of the pads' misplacements, and their Jacobian by the increment.

    The derivative of the misplacement with respect to the pose is by the Gauss-Newton approximation, which is exact
    where the residuals vanish.
    """
    starts, n = pads[3], len(pads[0])
    cells, pad = scratch(n)
    C, follow = np.empty((6, 6)), np.empty((6, 6))
    turned, roots = np.empty((7, 6)), np.empty((len(pads[4]), 6, 6))
    for k in range(len(pads[4])):
        copy_matrix(pads[5][k], roots[k])
        for a in range(6):
            roots[k, a, a] += 1.0
        cholesky(6, roots[k], roots[k])
    for b in range(X.shape[0]):
        residuals[b] = 0.0
        jacobian[b] = 0.0
        for k in range(len(pads[4])):
            settle(grid, pads, k, sigmas, X[b], cells, pad)
            run = starts[k], starts[k + 1]
            make_rows(cells.slopes, sigmas, run, cells)
            couple(run, cells, pad, C)
            for c in range(6):
                for a in range(6):
                    follow[c, a] = -C[a, c]
                solve(6, pad.L, follow[c])
            for i in range(run[0], run[1]):
                residuals[b, i] = cells.residual[i]
                for c in range(6):
                    jacobian[b, i, c] = cells.by_pose[i, c]
                    for a in range(6):
                        jacobian[b, i, c] += cells.by_pad[i, a] * follow[c, a]
            turned[:] = 0.0  # The derivatives of the misplacement by the pose, and itself in the last row, all in P.
            for a in range(6):
                row, first = a % 3, 3 * (a // 3)
                for e in range(3):
                    turned[6, a] += X[b, row, e] * pad.u[first + e]
                    for c in range(6):
                        turned[c, a] += X[b, row, e] * follow[c, first + e]
            for a in range(6):
                m = n + 6 * k + a
                for e in range(a, 6):
                    residuals[b, m] += roots[k, e, a] * turned[6, e]
                    for c in range(6):
                        jacobian[b, m, c] += roots[k, e, a] * turned[c, e]
        for i in range(residuals.shape[1]):  # From (w, R^T v) to (w, v).
            x, y, z = jacobian[b, i, 3], jacobian[b, i, 4], jacobian[b, i, 5]
            for a in range(3):
                jacobian[b, i, 3 + a] = X[b, a, 0] * x + X[b, a, 1] * y + X[b, a, 2] * z


@kernel
def patch_normal_equations(
    grid: Grid,
    pads: Pads,
    sigmas: tuple[float, float],
    X: Floats3,
    cost: OutFloats1,
    gradient: OutFloats2,
    hessian: OutFloats3,
) -> None:
    """Cost (B,), gradient (B, 6), and Gauss-Newton Hessian (B, 6, 6) along the smoothed normals."""
    starts = pads[3]
    cells, pad = scratch(len(pads[0]))
    C, rest, g, H = np.empty((6, 6)), np.empty(6), np.empty(6), np.empty((6, 6))
    for b in range(X.shape[0]):
        cost[b] = 0.0
        g[:] = 0.0
        H[:] = 0.0
        for k in range(len(pads[4])):
            cost[b] += settle(grid, pads, k, sigmas, X[b], cells, pad)
            run = starts[k], starts[k + 1]
            make_rows(cells.slopes, sigmas, run, cells)
            couple(run, cells, pad, C)
            # Newton's step for what remains to the least cost, by the local model.
            for a in range(6):
                rest[a] = 0.0
                for c in range(6):
                    rest[a] += pad.information[a, c] * pad.u[c]
            for i in range(run[0], run[1]):
                for a in range(6):
                    g[a] += cells.by_pose[i, a] * cells.residual[i]
                    rest[a] += cells.by_pad[i, a] * cells.residual[i]
            solve(6, pad.L, rest)
            for c in range(6):
                for a in range(6):
                    g[c] -= C[a, c] * rest[a]
            # The misplacement is marginalised, by the Schur complement.
            find_normals(grid, run, cells)
            make_rows(cells.normals, sigmas, run, cells)
            couple(run, cells, pad, C)
            for i in range(run[0], run[1]):
                if cells.weights[i] > 0.0:
                    for a in range(6):
                        for c in range(a + 1):
                            H[a, c] += cells.by_pose[i, a] * cells.by_pose[i, c]
            for c in range(6):
                for a in range(6):
                    rest[a] = C[a, c]
                solve(6, pad.L, rest)
                for a in range(c, 6):
                    for e in range(6):
                        H[a, c] -= C[e, a] * rest[e]
        turn_translations(X[b], g, H, gradient[b], hessian[b])
