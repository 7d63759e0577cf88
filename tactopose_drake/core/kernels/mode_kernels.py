"""Which of many poses are the same mode, compiled: up to the object's symmetries and what is known of each."""

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.compilation import Floats3, OutLongs1, kernel
from tactopose_drake.core.kernels.matrix_kernels import cholesky, invert
from tactopose_drake.core.kernels.pose_kernels import compose_one, increment_between
from tactopose_drake.core.validation import FloatArray


def owners(X_PO: FloatArray, information: FloatArray, symmetry_poses: FloatArray, sigmas: float) -> NDArray[np.int64]:
    """For each pose (n, 3, 4), the best one first, the first that it equals up to a symmetry (g, 3, 4), maybe itself.

    Two are equal when they lie within so many standard deviations of the better one, by its information (n, 6, 6).
    """
    owner = np.empty(len(X_PO), dtype=np.int64)
    _find_owners(X_PO, information, symmetry_poses, sigmas**2, owner)
    return owner


def one_of_each(owner: NDArray[np.int64]) -> NDArray[np.intp]:
    """The poses that own themselves."""
    return np.flatnonzero(owner == np.arange(len(owner)))


@kernel
def _find_owners(X: Floats3, information: Floats3, symmetries: Floats3, threshold: float, owner: OutLongs1) -> None:
    """Finds for each pose X (B, 3, 4) the first that owns itself and that it equals up to a symmetry.

    Two poses are equal when the squared Mahalanobis length of the increment between them, by the information (B, 6, 6)
    of the better one, is below the threshold for one of the symmetries (g, 3, 4). Most are told apart sooner, by how
    far such increments move and turn at the most: their squares are below the threshold times the covariance's traces.
    """
    u, Y = np.empty(6), np.empty((symmetries.shape[0], 3, 4))
    L, covariance = np.empty((6, 6)), np.empty((6, 6))
    farthest, least_trace = np.empty(X.shape[0]), np.empty(X.shape[0])
    for b in range(X.shape[0]):
        for s in range(symmetries.shape[0]):
            compose_one(X[b], symmetries[s], Y[s])
        owner[b] = b
        for a in range(b):
            if owner[a] != a:
                continue
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
                    owner[b] = a
                    break
            if owner[b] != b:
                break
        if owner[b] == b:
            cholesky(information[b], L)
            invert(L, covariance)
            farthest[b] = threshold * (covariance[3, 3] + covariance[4, 4] + covariance[5, 5])
            widest = np.sqrt(threshold * (covariance[0, 0] + covariance[1, 1] + covariance[2, 2]))
            least_trace[b] = 1.0 + 2.0 * np.cos(min(widest, np.pi))
