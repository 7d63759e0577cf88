"""Levenberg-Marquardt's steps and what they need, compiled: for a batch of least-squares problems of any size."""

from typing import NamedTuple

import numpy as np

from tactopose_drake.core.compilation import (
    Floats1,
    Floats2,
    Floats3,
    OutFlags1,
    OutFloats1,
    OutFloats2,
    OutFloats3,
    inlined,
    kernel,
)


class Problems(NamedTuple):
    """Where a batch of problems stands: what is moved (B, s), cost (B,), gradient (B, m) and Hessian (B, m, m)."""

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


@kernel
def damped_steps(hessian: Floats3, gradient: Floats2, damping: Floats1, step: OutFloats2) -> None:
    """Steps of each problem, see `damped_step`, into step (B, m); m is any size."""
    m = gradient.shape[1]
    L, y = np.empty((m, m)), np.empty(m)
    for b in range(gradient.shape[0]):
        damped_step(m, hessian[b], gradient[b], damping[b], L, y, step[b])


@kernel
def accept_steps(
    here: Problems,
    there: Problems,
    step: Floats2,
    damping: OutFloats1,
    tolerance: float,
    limit: float,
    done: OutFlags1,
) -> None:
    """Levenberg-Marquardt's judgement of each problem's step: moves it if the cost falls, and changes the damping.

    A problem is done when its cost falls, or the local model promises (half of -g s) that it falls, by less than the
    tolerance times cost + 1; or when the damping exceeds its limit.
    """
    state, cost, gradient, hessian = here
    for b in range(cost.shape[0]):
        least = tolerance * (cost[b] + 1.0)
        promised = 0.0
        for i in range(step.shape[1]):
            promised -= 0.5 * gradient[b, i] * step[b, i]
        decrease = cost[b] - there.cost[b]
        done[b] = promised < least or 0.0 < decrease < least
        if decrease > 0.0:
            damping[b] *= 0.1
            state[b], cost[b] = there.state[b], there.cost[b]
            gradient[b], hessian[b] = there.gradient[b], there.hessian[b]
        else:
            damping[b] *= 10.0
            done[b] = done[b] or damping[b] > limit
