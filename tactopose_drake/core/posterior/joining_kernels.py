"""Modes that overlap are joined, with their masses and moments."""

from typing import NamedTuple

import numpy as np

from tactopose_drake.core.compilation import (
    Floats1,
    Floats2,
    Floats3,
    Longs1,
    OutFloats1,
    OutFloats2,
    OutFloats3,
    OutLongs1,
    kernel,
    part,
)
from tactopose_drake.core.kernels.matrix_kernels import cholesky, invert
from tactopose_drake.core.kernels.pose_kernels import compose_one, increment_between
from tactopose_drake.core.kernels.sorting_kernels import copy_matrix, copy_vector


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
    turned, d, C, half, products = np.empty(6), np.empty(6), np.empty((6, 6)), np.empty((6, 6)), np.empty((6, 6))
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
                _transport(turn, first[j], spread[j], turned, half, C)
                for a in range(6):
                    d[a] = u[a] + turned[a] - first[i, a]
                    for c in range(6):
                        C[a, c] = p * C[a, c] + (1.0 - p) * spread[i, a, c]
                cholesky(C, L)
                invert(L, information)
                square = 0.0
                for a in range(6):
                    for c in range(6):
                        square += d[a] * information[a, c] * d[c]
                if square < nearest:
                    nearest, into = square, i
                    copy_vector(u, best_u)
                    copy_matrix(turn, best_turn)
        if into >= 0:
            p = mass[j] / (mass[into] + mass[j])
            _transport(best_turn, first[j], spread[j], turned, half, C)
            _transport(best_turn, first[j], second[j], turned, half, products)
            for a in range(6):
                d[a] = best_u[a] + turned[a] - first[into, a]
            for a in range(6):
                first[into, a] += p * d[a]
                for c in range(6):
                    product = products[a, c] + turned[a] * best_u[c] + best_u[a] * turned[c] + best_u[a] * best_u[c]
                    second[into, a, c] = (1.0 - p) * second[into, a, c] + p * product
                    spread[into, a, c] = (1.0 - p) * spread[into, a, c] + p * C[a, c] + p * (1.0 - p) * d[a] * d[c]
            effective_samples[into] = 1.0 / ((1.0 - p) ** 2 / effective_samples[into] + p**2 / effective_samples[j])
            owner[j] = into
            mass[into] += mass[j]
            mass[j] = 0.0


@part
def _transport(J: Floats2, m: Floats1, C: Floats2, mean: OutFloats1, half: OutFloats2, out: OutFloats2) -> None:
    """J m and J C J^T of a mean m (6,) and a matrix C (6, 6); half (6, 6) is for work."""
    for a in range(6):
        mean[a] = 0.0
        for c in range(6):
            mean[a] += J[a, c] * m[c]
            half[a, c] = 0.0
            for k in range(6):
                half[a, c] += J[a, k] * C[k, c]
    for a in range(6):
        for c in range(6):
            out[a, c] = 0.0
            for k in range(6):
                out[a, c] += half[a, k] * J[c, k]


@part
def _derivative(X: Floats2, S: Floats2, J: OutFloats2) -> None:
    """Of the increments at X S by those (w, v) at X: they are (R_S^T w, v + R (w x p_S)), with X = (R, p)."""
    for i in range(6):
        for k in range(6):
            J[i, k] = 0.0
    for i in range(3):
        x, y, z = X[i, 0], X[i, 1], X[i, 2]
        J[3 + i, 0] = z * S[1, 3] - y * S[2, 3]
        J[3 + i, 1] = x * S[2, 3] - z * S[0, 3]
        J[3 + i, 2] = y * S[0, 3] - x * S[1, 3]
        J[3 + i, 3 + i] = 1.0
        for k in range(3):
            J[i, k] = S[k, i]
