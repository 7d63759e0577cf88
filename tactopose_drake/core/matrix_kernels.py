"""Compiled algebra of small positive definite matrices, beside which numpy's calls would take most of the time."""

import numpy as np
from numba import njit

from tactopose_drake.core.validation import FloatArray


def inverses(matrices: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The inverses (B, n, n) of symmetric matrices (B, n, n), and the logarithms (B,) of their determinants.

    Where a matrix is not positive definite the logarithm is infinite and the inverse not a number.
    """
    inverse, logarithm = np.empty_like(matrices), np.empty(len(matrices))
    _invert_all(matrices, inverse, logarithm)
    return inverse, logarithm


@njit(cache=True, nogil=True)
def _invert_all(matrices, inverse, logarithm):  # type: ignore[no-untyped-def]
    L = np.empty(matrices.shape[1:])
    for b in range(matrices.shape[0]):
        logarithm[b] = _cholesky(matrices[b], L)
        _invert(L, inverse[b])


@njit(cache=True, inline="always")
def _cholesky(A, L):  # type: ignore[no-untyped-def]
    """The lower triangle L of A = L L^T (n, n), from A's; the logarithm of A's determinant, infinite without L."""
    total = 0.0
    for i in range(L.shape[0]):
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


@njit(cache=True, inline="always")
def _solve_transposed(L, z, u):  # type: ignore[no-untyped-def]
    """u = L^-T z: with H = L L^T and white z, u has the covariance H^-1."""
    n = L.shape[0]
    for i in range(n - 1, -1, -1):
        s = z[i]
        for k in range(i + 1, n):
            s -= L[k, i] * u[k]
        u[i] = s / L[i, i]


@njit(cache=True, inline="always")
def _invert(L, inverse):  # type: ignore[no-untyped-def]
    """(L L^T)^-1 (n, n), column by column; L's own place is free for reuse afterwards."""
    n = L.shape[0]
    for j in range(n):
        for i in range(n):
            s = 1.0 if i == j else 0.0
            for k in range(i):
                s -= L[i, k] * inverse[k, j]
            inverse[i, j] = s / L[i, i]
        for i in range(n - 1, -1, -1):
            s = inverse[i, j]
            for k in range(i + 1, n):
                s -= L[k, i] * inverse[k, j]
            inverse[i, j] = s / L[i, i]
