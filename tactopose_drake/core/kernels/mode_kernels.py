"""Finds which of many poses are the same mode, up to the object's symmetries and each pose's uncertainty, compiled."""

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.compilation import kernel
from tactopose_drake.core.kernel_types import Floats3, OutLongs1
from tactopose_drake.core.kernels.matrix_kernels import cholesky, invert
from tactopose_drake.core.kernels.pose_kernels import compose_one, increment_between
from tactopose_drake.core.validation import FloatArray


def one_of_each(
    X_PO: FloatArray, information: FloatArray, symmetry_poses: FloatArray, sigmas: float, most: int | None = None
) -> NDArray[np.int64]:
    """The indices of distinct poses (n, 3, 4), which are sorted best first: each equals no earlier one of these.

    Two poses are equal if the Mahalanobis distance, by the information (n, 6, 6) of the better one, between the better
    and some symmetric image of the other is below `sigmas`. At most `most` are found.
    """
    index = np.empty(len(X_PO) if most is None else min(most, len(X_PO)), dtype=np.int64)
    return index[: _find_distinct(X_PO, information, symmetry_poses, sigmas**2, index)]


@kernel
def _find_distinct(X: Floats3, information: Floats3, symmetries: Floats3, threshold: float, index: OutLongs1) -> int:
    """Writes the indices of poses X (B, 3, 4) that equal none of the earlier ones, and returns their number.

    Stops when `index` is full.

    Two poses are equal if the squared Mahalanobis length of the increment between them, by the information (B, 6, 6) of
    the better one, is below the threshold for one of the symmetries (g, 3, 4). Most are told apart more cheaply, by
    bounds on the translation and rotation of such increments: their squares are at most the threshold times the traces
    of the covariance's blocks.
    """
    u, Y, count = np.empty(6), np.empty((symmetries.shape[0], 3, 4)), 0
    L, covariance = np.empty((6, 6)), np.empty((6, 6))
    farthest, least_trace = np.empty(X.shape[0]), np.empty(X.shape[0])
    for b in range(X.shape[0]):
        if count == index.shape[0]:
            break
        for s in range(symmetries.shape[0]):
            compose_one(X[b], symmetries[s], Y[s])
        is_new = True
        for k in range(count):
            a = index[k]
            H = information[a]
            for s in range(symmetries.shape[0]):
                way, trace = 0.0, 0.0
                for i in range(3):
                    way += (Y[s, i, 3] - X[a, i, 3]) ** 2
                    for j in range(3):
                        trace += X[a, i, j] * Y[s, i, j]
                if way > farthest[a] or trace < least_trace[a]:
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
            index[count] = b
            count += 1
            cholesky(information[b], L)
            invert(L, covariance)
            farthest[b] = threshold * (covariance[3, 3] + covariance[4, 4] + covariance[5, 5])
            widest = np.sqrt(threshold * (covariance[0, 0] + covariance[1, 1] + covariance[2, 2]))
            least_trace[b] = 1.0 + 2.0 * np.cos(min(widest, np.pi))
    return count
