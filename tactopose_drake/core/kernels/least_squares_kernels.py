"""Levenberg-Marquardt's steps and what they need, compiled: for a batch of least-squares problems of any size."""

import numpy as np
from numba import njit


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


@njit(cache=True, inline="always")
def damped_step(m, H, g, damping, L, y, step):  # type: ignore[no-untyped-def]
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
    """Steps of each problem, see `damped_step`, into step (B, m); m is any size."""
    m = gradient.shape[1]
    L, y = np.empty((m, m)), np.empty(m)
    for b in range(gradient.shape[0]):
        damped_step(m, hessian[b], gradient[b], damping[b], L, y, step[b])


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
