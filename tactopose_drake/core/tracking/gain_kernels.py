"""The effect of an update by contacts on the covariances of modes, compiled; see `contact_update.py`."""

import numpy as np

from tactopose_drake.core.compilation import kernel
from tactopose_drake.core.kernel_types import Floats1, Floats2, Floats3, Floats4, Longs1, OutFloats3
from tactopose_drake.core.kernels.matrix_kernels import (
    cholesky,
    diagonalize,
    multiply,
    solve_transposed,
    transform,
    widen,
)


@kernel
def inform(jacobian: Floats4, share: Floats3, information: OutFloats3, weighted: OutFloats3) -> None:
    """The information of k contacts on n poses, by their tangents, in full and with each row weighted.

    Args:
        jacobian: of the contacts' whitened rows, shape (n, k, 5, 6), the last of which carries no information; see
            `surface_contact_kernels.contact_rows`.
        share: weights of the distances' and of the normals' information, shape (n, k, 2).
        information: output, the full information, shape (n, 6, 6).
        weighted: output, the weighted information, shape (n, 6, 6).
    """
    for b in range(jacobian.shape[0]):
        for i in range(6):
            for j in range(i + 1):
                full, part = 0.0, 0.0
                for c in range(jacobian.shape[1]):
                    distance = jacobian[b, c, 0, i] * jacobian[b, c, 0, j]
                    normal = 0.0
                    for r in range(1, 4):
                        normal += jacobian[b, c, r, i] * jacobian[b, c, r, j]
                    full += distance + normal
                    part += share[b, c, 0] * distance + share[b, c, 1] * normal
                information[b, i, j] = information[b, j, i] = full
                weighted[b, i, j] = weighted[b, j, i] = part


@kernel
def join_information(A: Floats3, gain: Floats3, variances: Floats2, information: OutFloats3) -> None:
    """The inverses (n, 6 + m, 6 + m) of [P C; C^T B], by Schur complements.

    Args:
        A: inverses of P - C B^-1 C^T, shape (n, 6, 6).
        gain: C B^-1, shape (n, 6, m).
        variances: the diagonals of B, shape (n, m).
        information: output, the inverses.
    """
    m = gain.shape[2]
    for b in range(A.shape[0]):
        for i in range(6):
            for j in range(6):
                information[b, i, j] = 0.5 * (A[b, i, j] + A[b, j, i])
        for c in range(m):
            for i in range(6):
                s = 0.0
                for k in range(6):
                    s -= information[b, i, k] * gain[b, k, c]
                information[b, i, 6 + c] = information[b, 6 + c, i] = s
        for c in range(m):
            for d in range(c + 1):
                s = 1.0 / variances[b, c] if c == d else 0.0
                for i in range(6):
                    s -= gain[b, i, c] * information[b, i, 6 + d]
                information[b, 6 + c, 6 + d] = information[b, 6 + d, 6 + c] = s


@kernel
def bound_covariances(before: Floats3, most: Floats3, after: OutFloats3) -> None:
    """Widens the covariances that an update claims; see `contact_update.limit_gain`. All are (n, 6, 6).

    Raises:
        LinAlgError: a covariance before the update is not positive definite.
    """
    L, Lt = np.empty((6, 6)), np.empty((6, 6))
    values, rows, work = np.empty(6), np.empty((6, 6)), np.empty((6, 6))
    unit, root, A = np.empty((6, 6)), np.empty((6, 6)), np.empty((6, 6))
    for b in range(before.shape[0]):
        if not np.isfinite(cholesky(6, before[b], L)):
            raise np.linalg.LinAlgError("Matrix is not positive definite")
        for i in range(6):
            for j in range(6):
                Lt[i, j] = L[j, i] if i <= j else 0.0
        # The outer products of the rows of `root` sum to the least covariance that may remain. In these coordinates the
        # information before the update is 1, and the touch's the eigenvalues; the larger holds. `unit` is root^-T.
        transform(Lt, most[b], work, A)
        diagonalize(A, values, rows)
        multiply(rows, Lt, root)
        for i in range(6):
            solve_transposed(6, L, rows[i], unit[i])
            scale = np.sqrt(max(values[i], 1.0))
            for j in range(6):
                root[i, j] /= scale
                unit[i, j] *= scale
        widen(root, unit, after[b], A, values, rows, work)


@kernel
def follow_roughness(
    now: Floats3,
    lasting: Floats2,
    source: Longs1,
    variances: Floats1,
    gain: float,
    roughness: OutFloats3,
    C: OutFloats3,
) -> None:
    """Updates the roughness by source, and the covariances with the biases; see `contact_update.follow_roughness`.

    Args:
        now: roughness observed at k contacts, shape (n, k, 2).
        lasting: the variance of their other lasting errors, shape (k, 2).
        source: of each contact, shape (k,).
        variances: of a bias of the position and of the normal, without roughness, shape (2,).
        gain: of the exponential smoothing of the roughness.
        roughness: of s sources, shape (n, s, 2); updated.
        C: shape (n, 6, 6 s); updated.
    """
    for b in range(now.shape[0]):
        for i in range(source.shape[0]):
            s = source[i]
            for k in range(2):
                before = variances[k] + roughness[b, s, k]
                roughness[b, s, k] += gain * (now[b, i, k] + lasting[i, k] - roughness[b, s, k])
                left = min(1.0, (variances[k] + roughness[b, s, k]) / before)
                for a in range(6):
                    for c in range(3):
                        C[b, a, 6 * s + 3 * k + c] *= left
