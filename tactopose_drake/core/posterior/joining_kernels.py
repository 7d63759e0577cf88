"""Modes that overlap are joined, with their masses and moments."""

from typing import NamedTuple

import numpy as np

from tactopose_drake.core.compilation import (
    Floats3,
    Longs1,
    OutFloats1,
    OutFloats2,
    OutFloats3,
    OutLongs1,
    inlined,
    kernel,
)
from tactopose_drake.core.kernels.matrix_kernels import cholesky, invert
from tactopose_drake.core.kernels.pose_kernels import compose_one, increment_between


class JoinedMoments(NamedTuple):
    """`mode_moments.Moments` of g modes, as joining writes them."""

    effective_samples: OutFloats1
    first: OutFloats2
    second: OutFloats3


@kernel
def join(
    X: Floats3,
    order: Longs1,
    symmetries: Floats3,
    limits: tuple[float, float],
    mass: OutFloats1,
    spread: OutFloats3,
    moments: JoinedMoments,
    owner: OutLongs1,
) -> None:
    """Adds each mode to the nearest of those before it that it overlaps, its owner, and leaves it no mass.

    With u the increment to its image, J the derivative of increments there by those from its own pose, m the means, P
    the mean products, C the spreads and p its share of both masses, they overlap where d = u + J m' - m is short by the
    spread p J C' J^T + (1 - p) C. The joint mean is m + p d, and P becomes (1 - p) P + p (J P' J^T + J m' u^T +
    u (J m')^T + u u^T). The limits are those of d, in standard deviations, and of the turn in u, rad.
    """
    effective_samples, first, second = moments
    peak_sigmas, widest_turn = limits
    image, u, turn = np.empty((3, 4)), np.empty(6), np.empty((6, 6))
    best_u, best_turn = np.empty(6), np.empty((6, 6))
    L, information = np.empty((6, 6)), np.empty((6, 6))
    for j in order:
        owner[j] = j
    for place in range(1, order.shape[0]):
        j = order[place]
        nearest, into = peak_sigmas**2, -1
        for i in order[:place]:
            if mass[i] == 0.0:
                continue
            p = mass[j] / (mass[i] + mass[j])
            for s in range(symmetries.shape[0]):
                compose_one(X[j], symmetries[s], image)
                increment_between(X[i], image, u)
                if u[0] ** 2 + u[1] ** 2 + u[2] ** 2 > widest_turn**2:
                    continue
                _derivative(X[j], symmetries[s], turn)
                d = u + turn @ first[j] - first[i]
                cholesky(p * (turn @ spread[j] @ turn.T) + (1.0 - p) * spread[i], L)
                invert(L, information)
                square = d @ information @ d
                if square < nearest:
                    nearest, into = square, i
                    best_u[:], best_turn[:] = u, turn
        if into >= 0:
            p = mass[j] / (mass[into] + mass[j])
            turned, J = best_turn @ first[j], best_turn
            d = best_u + turned - first[into]
            across = np.outer(turned, best_u)
            products = J @ second[j] @ J.T + across + across.T + np.outer(best_u, best_u)
            first[into] += p * d
            second[into] = (1.0 - p) * second[into] + p * products
            spread[into] = (1.0 - p) * spread[into] + p * (J @ spread[j] @ J.T) + p * (1.0 - p) * np.outer(d, d)
            effective_samples[into] = 1.0 / ((1.0 - p) ** 2 / effective_samples[into] + p**2 / effective_samples[j])
            owner[j] = into
            mass[into] += mass[j]
            mass[j] = 0.0


@inlined
def _derivative(X, S, J):
    """Of the increments at X S by those (w, v) at X: they are (R_S^T w, v + R (w x p_S)), with X = (R, p)."""
    J[:] = 0.0
    for i in range(3):
        x, y, z = X[i, 0], X[i, 1], X[i, 2]
        J[3 + i, 0] = z * S[1, 3] - y * S[2, 3]
        J[3 + i, 1] = x * S[2, 3] - z * S[0, 3]
        J[3 + i, 2] = y * S[0, 3] - x * S[1, 3]
        J[3 + i, 3 + i] = 1.0
        for k in range(3):
            J[i, k] = S[k, i]
