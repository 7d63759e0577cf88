"""The misplacement of a tactile pad that minimises its cost, compiled, and its derivative with respect to the pose.

`grid`, `pads` and `sigmas` are those of `pad_kernels.py`. The misplacement is found in O, where the distances are.
"""

import numpy as np

from tactopose_drake.core.compilation import inlined, part
from tactopose_drake.core.kernel_types import Floats2, OutFloats2
from tactopose_drake.core.kernels.grid_kernels import Grid
from tactopose_drake.core.kernels.least_squares_kernels import next_damping, promised_decrease
from tactopose_drake.core.kernels.matrix_kernels import cholesky, solve
from tactopose_drake.core.kernels.pad_kernels import Cells, Pad, Pads, Run, enter, misplace, weigh_cells
from tactopose_drake.core.kernels.sorting_kernels import copy_matrix, copy_vector

# If the local model of a pad's cost predicts a smaller decrease than this, the decrease is taken for granted. That
# takes two or three steps; at creases it may take many, which are not worth their time.
_LEAST_PROMISE = 1e-6
_MOST_STEPS = 4
# The least damping after a rejected step, a share of the Hessian's diagonal.
_LEAST_REFUSED_DAMPING = 1.0
# A pad that costs more than this after one step is not explained by any noise; a rough cost suffices.
_HOPELESS = 30.0


@part
def settle(
    grid: Grid,
    pads: Pads,
    k: int,
    sigmas: tuple[float, float],
    X: Floats2,
    cells: Cells,
    pad: Pad,
) -> float:
    """A pad's least cost over its misplacement, by Levenberg-Marquardt steps from 0; leaves the cells there."""
    u, g, L, step, trial = pad.u, pad.g, pad.L, pad.step, pad.trial
    traits, run = pads[2], (pads[3][k], pads[3][k + 1])
    enter(pads, k, X, cells, pad)
    trial[:] = 0.0
    cost, damping, rejected = np.inf, 0.0, False
    for tried in range(_MOST_STEPS + 1):
        misplace(trial, sigmas, run, cells, pad)
        weigh_cells(grid, traits, run, cells, pad)
        there = 0.0
        for i in range(run[0], run[1]):
            there += cells.residual[i] ** 2
        for a in range(6):
            for c in range(6):
                there += trial[a] * pad.information[a, c] * trial[c]
        there *= 0.5
        rejected = not there < cost
        damping = next_damping(damping, not rejected, _LEAST_REFUSED_DAMPING)
        if not rejected:
            cost = there
            copy_vector(trial, u)
            _expand(sigmas, run, cells, pad)
        for a in range(6):
            for c in range(a + 1):
                L[a, c] = pad.H[a, c]
            L[a, a] *= 1.0 + damping
            step[a] = -g[a]
        cholesky(6, L, L)
        solve(6, L, step)
        promise = promised_decrease(g, step)
        for a in range(6):
            trial[a] = u[a] + step[a]
        if promise < _LEAST_PROMISE:
            cost -= promise
            break
        if tried > 0 and cost > _HOPELESS:
            break
    if rejected:
        misplace(u, sigmas, run, cells, pad)
        weigh_cells(grid, traits, run, cells, pad)
    return cost


@part
def _expand(sigmas: tuple[float, float], run: Run, cells: Cells, pad: Pad) -> None:
    """The gradient and Gauss-Newton Hessian of a pad's cost with respect to its misplacement."""
    g, H = pad.g, pad.H
    arms, slopes, weights, residual, rows = cells.arms, cells.slopes, cells.weights, cells.residual, cells.by_pad
    for a in range(6):
        g[a] = 0.0
        for c in range(6):
            H[a, c] = pad.information[a, c]
            g[a] += H[a, c] * pad.u[c]
    for i in range(run[0], run[1]):
        if weights[i] > 0.0:
            _row(i, arms, slopes, sigmas[0], sigmas[1], rows)
            for a in range(6):
                g[a] += rows[i, a] * residual[i]
                for c in range(a + 1):
                    H[a, c] += rows[i, a] * rows[i, c]


@part
def make_rows(directions: Floats2, sigmas: tuple[float, float], run: Run, cells: Cells) -> None:
    """Derivatives by misplacement and pose, from those with respect to the cells' places: directions (n, 3)."""
    arms, places, by_pad, by_pose = cells.arms, cells.places, cells.by_pad, cells.by_pose
    for i in range(run[0], run[1]):
        _row(i, arms, directions, sigmas[0], sigmas[1], by_pad)
        _row(i, places, directions, -1.0, -1.0, by_pose)


@inlined
def _row(i, levers, directions, turn, shift, rows):
    """The derivatives with respect to a turn and a shift of the i-th point at its lever, from those to the point.

    `levers`, `directions` and `rows` are whole arrays, because numba counts references of a row that is passed.
    """
    x, y, z = directions[i, 0], directions[i, 1], directions[i, 2]
    rows[i, 0] = turn * (levers[i, 1] * z - levers[i, 2] * y)
    rows[i, 1] = turn * (levers[i, 2] * x - levers[i, 0] * z)
    rows[i, 2] = turn * (levers[i, 0] * y - levers[i, 1] * x)
    rows[i, 3], rows[i, 4], rows[i, 5] = shift * x, shift * y, shift * z


@part
def couple(run: Run, cells: Cells, pad: Pad, C: OutFloats2) -> None:
    """A pad's second derivatives: C (6, 6) by misplacement and pose; `pad.L` factors those by the misplacement."""
    weights, by_pad, by_pose, L = cells.weights, cells.by_pad, cells.by_pose, pad.L
    C[:] = 0.0
    copy_matrix(pad.information, L)
    for i in range(run[0], run[1]):
        if weights[i] > 0.0:
            for a in range(6):
                for c in range(6):
                    C[a, c] += by_pad[i, a] * by_pose[i, c]
                for c in range(a + 1):
                    L[a, c] += by_pad[i, a] * by_pad[i, c]
    cholesky(6, L, L)
