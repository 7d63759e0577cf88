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


class Joined(NamedTuple):
    """Masses (g,), spreads (g, 6, 6) about the means, and `mode_moments.Moments` of g modes, as joining writes them."""

    mass: OutFloats1
    spread: OutFloats3
    effective_samples: OutFloats1
    first: OutFloats2
    second: OutFloats3


class Image(NamedTuple):
    """A mode's image by a symmetry: the increment to it (6,) from another's pose, and what turns increments (6, 6)."""

    u: OutFloats1
    turn: OutFloats2


class Work(NamedTuple):
    """Scratch: (6,), (6,), and four of (6, 6)."""

    mean: OutFloats1
    d: OutFloats1
    half: OutFloats2
    C: OutFloats2
    L: OutFloats2
    information: OutFloats2


@kernel
def join(
    X: Floats3, order: Longs1, symmetries: Floats3, limits: tuple[float, float], joined: Joined, owner: OutLongs1
) -> None:
    """Adds each mode to the nearest of those before it that it overlaps, its owner, and leaves it no mass.

    With u the increment to its image, J the derivative of increments there by those from its own pose, m the means, P
    the mean products, C the spreads and p its share of both masses, they overlap where d = u + J m' - m is short by the
    spread p J C' J^T + (1 - p) C. The limits are those of d, in standard deviations, and of the turn in u, rad.
    """
    peak_sigmas, widest_turn = limits
    X_image, image = np.empty((3, 4)), Image(np.empty(6), np.empty((6, 6)))
    nearest = Image(np.empty(6), np.empty((6, 6)))
    work = Work(np.empty(6), np.empty(6), np.empty((6, 6)), np.empty((6, 6)), np.empty((6, 6)), np.empty((6, 6)))
    for j in order:
        owner[j] = j
    for place in range(1, order.shape[0]):
        j = order[place]
        least, into = peak_sigmas**2, -1
        for i in order[:place]:
            if joined.mass[i] == 0.0:
                continue
            for s in range(symmetries.shape[0]):
                compose_one(X[j], symmetries[s], X_image)
                increment_between(X[i], X_image, image.u)
                if image.u[0] ** 2 + image.u[1] ** 2 + image.u[2] ** 2 > widest_turn**2:
                    continue
                _derivative(X[j], symmetries[s], image.turn)
                square = _apart(joined, i, j, image, work)
                if square < least:
                    least, into = square, i
                    copy_vector(image.u, nearest.u)
                    copy_matrix(image.turn, nearest.turn)
        if into >= 0:
            _add(joined, into, j, nearest, work)
            owner[j] = into


@part
def _apart(joined: Joined, i: int, j: int, image: Image, work: Work) -> float:
    """The squared length of d between the mode i and the image of j, by their spread."""
    p = joined.mass[j] / (joined.mass[i] + joined.mass[j])
    C, d = work.C, work.d
    _transport(image.turn, joined.first[j], joined.spread[j], work.mean, work.half, C)
    for a in range(6):
        d[a] = image.u[a] + work.mean[a] - joined.first[i, a]
        for c in range(6):
            C[a, c] = p * C[a, c] + (1.0 - p) * joined.spread[i, a, c]
    cholesky(C, work.L)
    invert(work.L, work.information)
    square = 0.0
    for a in range(6):
        for c in range(6):
            square += d[a] * work.information[a, c] * d[c]
    return square


@part
def _add(joined: Joined, i: int, j: int, image: Image, work: Work) -> None:
    """Adds the mode j, by its image, to the mode i.

    The joint mean is m + p d, and P becomes (1 - p) P + p (J P' J^T + J m' u^T + u (J m')^T + u u^T).
    """
    mass, spread, effective_samples, first, second = joined
    p = mass[j] / (mass[i] + mass[j])
    u, mean, d, C, products = image.u, work.mean, work.d, work.C, work.L
    _transport(image.turn, first[j], spread[j], mean, work.half, C)
    _transport(image.turn, first[j], second[j], mean, work.half, products)
    for a in range(6):
        d[a] = u[a] + mean[a] - first[i, a]
    for a in range(6):
        first[i, a] += p * d[a]
        for c in range(6):
            product = products[a, c] + mean[a] * u[c] + u[a] * mean[c] + u[a] * u[c]
            second[i, a, c] = (1.0 - p) * second[i, a, c] + p * product
            spread[i, a, c] = (1.0 - p) * spread[i, a, c] + p * C[a, c] + p * (1.0 - p) * d[a] * d[c]
    effective_samples[i] = 1.0 / ((1.0 - p) ** 2 / effective_samples[i] + p**2 / effective_samples[j])
    mass[i] += mass[j]
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
