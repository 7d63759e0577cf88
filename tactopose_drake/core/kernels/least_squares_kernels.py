"""The steps, acceptance and damping of Levenberg-Marquardt, compiled, which all such minimisations share.

Source: [B16] J. Bimbo, thesis, 2016, section 2.6.2.2 (eqs. 2.30 and 2.31, and the damping rule).
"""

from typing import NamedTuple

import numpy as np

from tactopose_drake.core.compilation import inlined, kernel
from tactopose_drake.core.kernel_types import Floats1, Floats2, Floats3, OutFlags1, OutFloats1, OutFloats2, OutFloats3
from tactopose_drake.core.kernels.sorting_kernels import copy_matrix, copy_vector


class DescentRule(NamedTuple):
    """The settings of `searches.levenberg_marquardt.LevenbergMarquardt`; see there."""

    max_iterations: int
    tolerance: float
    initial_damping: float
    max_damping: float
    least_refused: float


class Problems(NamedTuple):
    """The state of a batch of problems: variables (B, s), cost (B,), gradient (B, m) and Hessian (B, m, m)."""

    state: OutFloats2
    cost: OutFloats1
    gradient: OutFloats2
    hessian: OutFloats3


@kernel
def form_normal_equations(
    residuals: Floats2, jacobian: Floats3, cost: OutFloats1, gradient: OutFloats2, hessian: OutFloats3
) -> None:
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


@inlined
def damped_step(m, H, g, damping, L, y, step):
    """Solves (H + damping diag H) step = -g, (m,), by Cholesky, from the lower triangle of H; L and y are scratch.

    A direction with a vanishing pivot, which nothing determines, gets no step. This does not call
    `matrix_kernels.cholesky`, which rejects such a matrix, and whose divisions would slow a descent by about 3 %.
    """
    for i in range(m):
        for j in range(i + 1):
            s = H[i, j]
            if i == j:
                s += damping * H[i, i]
            for k in range(j):
                s -= L[i, k] * L[j, k]
            if i == j:
                # The diagonal holds the inverses, as divisions are slow.
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


@kernel
def damped_steps(hessian: Floats3, gradient: Floats2, damping: Floats1, step: OutFloats2) -> None:
    """Writes the step (B, m) of each problem, see `damped_step`, for any m."""
    m = gradient.shape[1]
    L, y = np.empty((m, m)), np.empty(m)
    for b in range(gradient.shape[0]):
        damped_step(m, hessian[b], gradient[b], damping[b], L, y, step[b])


@inlined
def promised_decrease(gradient, step):
    """The decrease of the cost that the local model predicts for a least-squares step: -g s / 2."""
    promised = 0.0
    for i in range(step.shape[0]):
        promised -= 0.5 * gradient[i] * step[i]
    return promised


@inlined
def next_damping(damping, has_fallen, least_refused):
    """A tenth of the damping after an accepted step; ten times after a rejected one, and at least `least_refused`."""
    return 0.1 * damping if has_fallen else max(10.0 * damping, least_refused)


@inlined
def has_converged(cost, decrease, promised, damping, rule):
    """Whether to stop after a step from this cost.

    True if the cost decreased, or was predicted to decrease, by less than tolerance (1 + cost); or if it did not
    decrease and the damping exceeds its limit.
    """
    least = rule.tolerance * (cost + 1.0)
    return promised < least or 0.0 < decrease < least or (not decrease > 0.0 and damping > rule.max_damping)


@kernel
def accept_steps(
    here: Problems,
    there: Problems,
    step: Floats2,
    damping: OutFloats1,
    rule: DescentRule,
    done: OutFlags1,
) -> None:
    """Moves each problem by its step if its cost decreases, updates its damping, and decides whether it is done."""
    state, cost, gradient, hessian = here
    for b in range(cost.shape[0]):
        decrease, promised = cost[b] - there.cost[b], promised_decrease(gradient[b], step[b])
        damping[b] = next_damping(damping[b], decrease > 0.0, rule.least_refused)
        done[b] = has_converged(cost[b], decrease, promised, damping[b], rule)
        if decrease > 0.0:
            cost[b] = there.cost[b]
            copy_vector(there.state[b], state[b])
            copy_vector(there.gradient[b], gradient[b])
            copy_matrix(there.hessian[b], hessian[b])
