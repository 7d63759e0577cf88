"""Systems of linear equations by LAPACK, called as `np.linalg.solve` in a kernel does, to the same bits.

Numba's own copies the right-hand sides as NumPy would, whose error message for arrays that do not match compiles half
of Python's strings: it takes six seconds, and this a tenth of one.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from numba.extending import overload

from tactopose_drake.core.compilation import Floats2, OutFloats2, part


def _solve_by_lapack(A: Any, X: Any) -> int:
    """LAPACK's dgesv, only for kernels: X (m, n) becomes X A^-1, and A (n, n) is destroyed; 0, or what is at fault."""
    raise NotImplementedError


@overload(_solve_by_lapack)
def _call_lapack(A: Any, X: Any) -> Callable[[Any, Any], int]:
    # Not imported before something is compiled: it takes longer than loading all kernels.
    from numba.np.linalg import _LAPACK, F_INT_nptype, ensure_lapack

    ensure_lapack()
    gesv, kind = _LAPACK().numba_xgesv(A.dtype), ord("d")

    def call(A: Any, X: Any) -> int:
        n = A.shape[0]
        pivots = np.empty(n, dtype=F_INT_nptype)
        fault = gesv(kind, n, X.shape[0], A.ctypes, n, pivots.ctypes, X.ctypes, n)
        # So long the arrays are needed.
        return fault + 0 * (A.size + X.size + pivots.size)

    return call


@part
def invert_columns(A: Floats2, work: OutFloats2, X: OutFloats2) -> None:
    """The first m columns of the inverse of A (n, n) as rows of X (m, n); work is (n, n).

    Raises:
        LinAlgError: A is singular, or not finite.
    """
    for i in range(A.shape[0]):
        for j in range(A.shape[0]):
            if not np.isfinite(A[i, j]):
                raise np.linalg.LinAlgError("Array must not contain infs or NaNs.")
            work[j, i] = A[i, j]
    for j in range(X.shape[0]):
        for i in range(A.shape[0]):
            X[j, i] = 1.0 if i == j else 0.0
    if _solve_by_lapack(work, X) != 0:
        raise np.linalg.LinAlgError("Matrix is singular to machine precision.")
