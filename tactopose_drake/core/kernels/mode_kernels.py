"""Finds which of many poses are the same mode, up to the object's symmetries and each pose's uncertainty, compiled."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.compilation import kernel
from tactopose_drake.core.kernel_types import Floats1, Floats2, Floats3, OutFloats1, OutFloats3, OutLongs1
from tactopose_drake.core.kernels.matrix_kernels import cholesky, invert
from tactopose_drake.core.kernels.pose_kernels import compose_one, increment_between
from tactopose_drake.core.kernels.sorting_kernels import sort_stably
from tactopose_drake.core.validation import FloatArray

NO_SYMMETRY = np.eye(3, 4)[None]
"""The symmetry poses of an object without symmetries, shape (1, 3, 4)."""
_NOTHING_ELSE = np.zeros((6, 6))


class Minima(NamedTuple):
    """Poses (n, 3, 4) in any order, their costs (n,), and the Hessians there (n, 6, 6)."""

    X_PO: FloatArray
    cost: FloatArray
    hessian: FloatArray


class Distinct(NamedTuple):
    """Minima that are distinct, by rising cost, and what is known of each in all.

    Attributes:
        chosen: the index of each among all minima, shape (m,).
        covariance: inverses of the sums of their Hessians and what else is known, shape (m, 6, 6).
        log_determinant: logarithms of these sums' determinants, shape (m,); infinite where one is not positive
            definite, and the covariance is NaN.
    """

    chosen: NDArray[np.int64]
    covariance: FloatArray
    log_determinant: FloatArray


def best_of_each(
    minima: Minima,
    known: FloatArray,
    symmetry_poses: FloatArray,
    sigmas: float,
    most: int | None = None,
    worth: float = math.inf,
) -> Distinct:
    """Finds distinct poses: each equals no cheaper one of these.

    Two poses are equal if the Mahalanobis distance between the better and some symmetric image of the other is below
    `sigmas`, by the better one's Hessian and what else is known, shape (6, 6). At most `most` are found, and only such
    that cost at most by `worth` more than the best.
    """
    room = len(minima.X_PO) if most is None else min(most, len(minima.X_PO))
    found = Distinct(np.empty(room, dtype=np.int64), np.empty((room, 6, 6)), np.empty(room))
    count = _find_distinct(*minima, known, symmetry_poses, sigmas**2, worth, *found)
    return Distinct(found.chosen[:count], found.covariance[:count], found.log_determinant[:count])


def one_of_each(
    X_PO: FloatArray, information: FloatArray, symmetry_poses: FloatArray, sigmas: float
) -> NDArray[np.int64]:
    """The indices of distinct poses (n, 3, 4) that are sorted, the best first, by all information on them (n, 6, 6)."""
    as_sorted = np.zeros(len(X_PO))
    return best_of_each(Minima(X_PO, as_sorted, information), _NOTHING_ELSE, symmetry_poses, sigmas).chosen


@kernel
def _find_distinct(
    X: Floats3,
    cost: Floats1,
    hessian: Floats3,
    known: Floats2,
    symmetries: Floats3,
    threshold: float,
    worth: float,
    index: OutLongs1,
    covariance: OutFloats3,
    log_determinant: OutFloats1,
) -> int:
    """Writes `Distinct` for the poses X (B, 3, 4) that equal none of the cheaper ones, and returns their number.

    Stops when `index` is full, or when poses cost more than the best by `worth`.

    Two poses are equal if the squared Mahalanobis length of the increment between them, by the information on the
    better one, is below the threshold for one of the symmetries (g, 3, 4). Most are told apart more cheaply, by bounds
    on the translation and rotation of such increments: their squares are at most the threshold times the traces of the
    covariance's blocks.
    """
    u, Y, count = np.empty(6), np.empty((symmetries.shape[0], 3, 4)), 0
    L, information = np.empty((6, 6)), np.empty((index.shape[0], 6, 6))
    farthest, least_trace = np.empty(index.shape[0]), np.empty(index.shape[0])
    order, spare = np.empty(X.shape[0], dtype=np.int64), np.empty(X.shape[0], dtype=np.int64)
    sort_stably(cost, order, spare)
    for b in order:
        if count == index.shape[0] or cost[b] > cost[order[0]] + worth:
            break
        for s in range(symmetries.shape[0]):
            compose_one(X[b], symmetries[s], Y[s])
        is_new = True
        for k in range(count):
            a = index[k]
            H = information[k]
            for s in range(symmetries.shape[0]):
                square, trace = 0.0, 0.0
                for i in range(3):
                    square += (Y[s, i, 3] - X[a, i, 3]) ** 2
                    for j in range(3):
                        trace += X[a, i, j] * Y[s, i, j]
                if square > farthest[k] or trace < least_trace[k]:
                    continue
                increment_between(X[a], Y[s], u)
                total = 0.0
                for i in range(6):
                    half = 0.5 * H[i, i] * u[i]
                    for j in range(i):
                        half += H[i, j] * u[j]
                    total += 2.0 * half * u[i]
                if total < threshold:
                    is_new = False
                    break
            if not is_new:
                break
        if is_new:
            own, inverse = information[count], covariance[count]
            for i in range(6):
                for j in range(6):
                    own[i, j] = hessian[b, i, j] + known[i, j]
            log_determinant[count] = cholesky(6, own, L)
            invert(6, L, inverse)
            farthest[count] = threshold * (inverse[3, 3] + inverse[4, 4] + inverse[5, 5])
            widest = np.sqrt(threshold * (inverse[0, 0] + inverse[1, 1] + inverse[2, 2]))
            least_trace[count] = 1.0 + 2.0 * np.cos(min(widest, np.pi))
            index[count] = b
            count += 1
    return count
