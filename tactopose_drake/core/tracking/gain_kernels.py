"""What an update by contacts makes of the covariances of modes, compiled; see `contact_update.py`."""

import numpy as np

from tactopose_drake.core.compilation import Floats2, Floats3, OutFloats3, kernel
from tactopose_drake.core.kernels.linear_system_kernels import invert_columns
from tactopose_drake.core.kernels.matrix_kernels import cholesky, diagonalize, multiply, solve_transposed, transform


@kernel
def invert_joint(P: Floats3, C: Floats3, variances: Floats2, information: OutFloats3) -> None:
    """The inverses (n, 6 + m, 6 + m) of [P C; C^T B] by Schur complements.

    Args:
        P: covariances of increments, shape (n, 6, 6).
        C: with the biases, shape (n, 6, m).
        variances: of the biases, the diagonals of B, shape (n, m).
        information: written.
    """
    m = C.shape[2]
    left, work, A, gain, A_gain = np.empty((6, 6)), np.empty((6, 6)), np.empty((6, 6)), np.empty((6, m)), np.empty((6, m))
    for b in range(P.shape[0]):
        for i in range(6):
            for c in range(m):
                gain[i, c] = C[b, i, c] / variances[b, c]
            for j in range(6):
                s = P[b, i, j]
                for c in range(m):
                    s -= gain[i, c] * C[b, j, c]
                left[i, j] = s
        invert_columns(left, work, A)
        for i in range(6):
            for j in range(i + 1):
                A[i, j] = A[j, i] = information[b, i, j] = information[b, j, i] = 0.5 * (A[i, j] + A[j, i])
        multiply(A, gain, A_gain)
        for c in range(m):
            for i in range(6):
                information[b, i, 6 + c] = information[b, 6 + c, i] = -A_gain[i, c]
            for d in range(c + 1):
                s = 1.0 / variances[b, c] if c == d else 0.0
                for i in range(6):
                    s += gain[i, c] * A_gain[i, d]
                information[b, 6 + c, 6 + d] = information[b, 6 + d, 6 + c] = s


@kernel
def bound_covariances(before: Floats3, most: Floats3, after: OutFloats3) -> None:
    """Widens what an update claims; see `contact_update.limit_gain`. All are (n, 6, 6).

    Raises:
        LinAlgError: a covariance before it has no root.
    """
    L, Lt = np.empty((6, 6)), np.empty((6, 6))
    values, rows, work = np.empty(6), np.empty((6, 6)), np.empty((6, 6))
    unit, root, A = np.empty((6, 6)), np.empty((6, 6)), np.empty((6, 6))
    for b in range(before.shape[0]):
        if not np.isfinite(cholesky(before[b], L)):
            raise np.linalg.LinAlgError("Matrix is not positive definite")
        for i in range(6):
            for j in range(6):
                Lt[i, j] = L[j, i] if i <= j else 0.0
        # In the rows of `root`, whose outer products are what is left of the covariance at least, what was known is 1,
        # and what the touch may tell are the values: the larger one of both holds. `unit` is the inverse of the root.
        transform(Lt, most[b], work, A)
        diagonalize(A, values, rows)
        multiply(rows, Lt, root)
        for i in range(6):
            solve_transposed(L, rows[i], unit[i])
            scale = np.sqrt(max(values[i], 1.0))
            for j in range(6):
                root[i, j] /= scale
                unit[i, j] *= scale
        transform(unit, after[b], work, A)
        diagonalize(A, values, rows)
        multiply(rows, root, work)
        for i in range(6):
            for j in range(i + 1):
                s = 0.0
                for k in range(6):
                    s += max(values[k], 1.0) * work[k, i] * work[k, j]
                after[b, i, j] = after[b, j, i] = s
