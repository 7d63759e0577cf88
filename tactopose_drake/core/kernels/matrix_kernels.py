"""Compiled algebra of small symmetric matrices, for which calls of NumPy would take most of the time.

Source: [GV] G. Golub and C. Van Loan, Matrix Computations, 4th ed., 2013, section 8.5 (Jacobi's method).
"""

import numpy as np

from tactopose_drake.core.compilation import inlined, kernel, part
from tactopose_drake.core.kernel_types import Floats2, Floats3, OutFloats1, OutFloats2, OutFloats3
from tactopose_drake.core.validation import FloatArray

_MOST_SWEEPS = 30  # Six or seven suffice for any matrix of six rows.


def inverses(matrices: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The inverses (B, n, n) of symmetric matrices (B, n, n), and the logarithms (B,) of their determinants.

    Where a matrix is not positive definite the logarithm is infinite and the inverse NaN.
    """
    inverse, logarithm = np.empty_like(matrices), np.empty(len(matrices))
    _invert_all(matrices, inverse, logarithm)
    return inverse, logarithm


def eigenpairs(matrices: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Eigenvalues (B, n), in any order, and eigenvectors (B, n, n), as rows, of symmetric matrices (B, n, n)."""
    values, rows = np.empty(matrices.shape[:2]), np.empty_like(matrices)
    _diagonalize_all(matrices.copy(), values, rows)
    return values, rows


@kernel
def _diagonalize_all(matrices: OutFloats3, values: OutFloats2, rows: OutFloats3) -> None:
    """Diagonalises each matrix, which it overwrites."""
    for b in range(matrices.shape[0]):
        diagonalize(matrices[b], values[b], rows[b])


@part
def diagonalize(A: OutFloats2, values: OutFloats1, V: OutFloats2) -> None:
    """Eigenvalues (n,), in any order, and eigenvectors (n, n), as rows, of a symmetric A (n, n), which is overwritten.

    By cyclic Jacobi rotations, until the off-diagonal is down to rounding errors.
    """
    n = A.shape[0]
    size = 0.0
    for i in range(n):
        for k in range(n):
            V[i, k] = 1.0 if i == k else 0.0
            size += A[i, k] ** 2
    for _ in range(_MOST_SWEEPS):
        off = 0.0
        for i in range(n):
            for k in range(i):
                off += A[k, i] ** 2
        if off <= 1e-30 * size:
            break
        for i in range(1, n):
            for k in range(i):
                if A[k, i] != 0.0:
                    _rotate(A, V, k, i)
    for i in range(n):
        values[i] = A[i, i]


@inlined
def _rotate(A, V, p, q):
    """Zeroes A[p, q] by a rotation in the plane of both axes. [GV] algorithm 8.5.1."""
    tau = 0.5 * (A[q, q] - A[p, p]) / A[p, q]
    t = 1.0 / (tau + np.sqrt(1.0 + tau * tau)) if tau >= 0.0 else -1.0 / (np.sqrt(1.0 + tau * tau) - tau)
    c = 1.0 / np.sqrt(1.0 + t * t)
    s = t * c
    for k in range(A.shape[0]):
        A[k, p], A[k, q] = c * A[k, p] - s * A[k, q], s * A[k, p] + c * A[k, q]
    for k in range(A.shape[0]):
        A[p, k], A[q, k] = c * A[p, k] - s * A[q, k], s * A[p, k] + c * A[q, k]
        V[p, k], V[q, k] = c * V[p, k] - s * V[q, k], s * V[p, k] + c * V[q, k]


@kernel
def _invert_all(matrices: Floats3, inverse: OutFloats3, logarithm: OutFloats1) -> None:
    n = matrices.shape[1]
    L = np.empty((n, n))
    for b in range(matrices.shape[0]):
        logarithm[b] = cholesky(n, matrices[b], L)
        invert(n, L, inverse[b])


@part
def multiply(A: Floats2, B: Floats2, C: OutFloats2) -> None:
    """C = A B of (n, m) and (m, l)."""
    for i in range(A.shape[0]):
        for j in range(B.shape[1]):
            s = 0.0
            for k in range(A.shape[1]):
                s += A[i, k] * B[k, j]
            C[i, j] = s


@part
def transform(U: Floats2, A: Floats2, work: OutFloats2, out: OutFloats2) -> None:
    """out = U A U^T for a symmetric A (m, m); U and the scratch `work` are (n, m)."""
    multiply(U, A, work)
    for i in range(U.shape[0]):
        for j in range(i + 1):
            s = 0.0
            for k in range(A.shape[0]):
                s += work[i, k] * U[j, k]
            out[i, j] = out[j, i] = s


@part
def widen(
    root: Floats2,
    unit: Floats2,
    covariance: OutFloats2,
    A: OutFloats2,
    values: OutFloats1,
    rows: OutFloats2,
    work: OutFloats2,
) -> None:
    """Enlarges a covariance (n, n) so that in no direction it is less than another one, root^T root.

    `unit` is the inverse of the root, transposed; the arguments after the covariance are scratch.
    """
    n = values.shape[0]
    transform(unit, covariance, work, A)
    diagonalize(A, values, rows)
    multiply(rows, root, work)
    for i in range(n):
        for j in range(i + 1):
            s = 0.0
            for k in range(n):
                s += max(values[k], 1.0) * work[k, i] * work[k, j]
            covariance[i, j] = covariance[j, i] = s


@part
def orthonormalize(rows: OutFloats2, count: int) -> None:
    """Orthonormalises the first `count` rows of (n, m) by Gram-Schmidt."""
    for c in range(count):
        for _ in range(2):  # The second pass removes what rounding has left.
            for before in range(c):
                along = 0.0
                for k in range(rows.shape[1]):
                    along += rows[c, k] * rows[before, k]
                for k in range(rows.shape[1]):
                    rows[c, k] -= along * rows[before, k]
            square = 0.0
            for k in range(rows.shape[1]):
                square += rows[c, k] * rows[c, k]
            for k in range(rows.shape[1]):
                rows[c, k] /= np.sqrt(square)


@inlined
def cholesky(n, A, L):
    """Writes the lower triangle L of A = L L^T (n, n), which may be A itself; returns the logarithm of A's determinant.

    With a number n that is known to the compiler the loops are unrolled, which is nearly twice as fast, here and below.
    Reads only A's lower triangle. Where A is not positive definite the logarithm is infinite, and L's diagonal NaN.
    """
    total = 0.0
    for i in range(n):
        for k in range(i + 1):
            s = A[i, k]
            for c in range(k):
                s -= L[i, c] * L[k, c]
            if i > k:
                L[i, k] = s / L[k, k]
            elif s > 0.0:
                total += np.log(s)
                L[i, i] = np.sqrt(s)
            else:
                total = np.inf
                L[i, i] = np.nan
    return total


@inlined
def solve_transposed(n, L, z, u):
    """u = L^-T z (n,), in place if u is z: with H = L L^T and white z, u has the covariance H^-1."""
    for i in range(n - 1, -1, -1):
        s = z[i]
        for k in range(i + 1, n):
            s -= L[k, i] * u[k]
        u[i] = s / L[i, i]


@inlined
def solve(n, L, x):
    """Replaces x (n,) by (L L^T)^-1 x."""
    for i in range(n):
        s = x[i]
        for k in range(i):
            s -= L[i, k] * x[k]
        x[i] = s / L[i, i]
    solve_transposed(n, L, x, x)


@inlined
def invert(n, L, inverse):
    """(L L^T)^-1 (n, n), column by column; L may be reused afterwards."""
    for j in range(n):
        for i in range(n):
            inverse[j, i] = 1.0 if i == j else 0.0
        solve(n, L, inverse[j])
    for j in range(n):
        for i in range(j):
            inverse[i, j], inverse[j, i] = inverse[j, i], inverse[i, j]
