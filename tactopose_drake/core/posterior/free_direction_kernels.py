"""The directions that information matrices leave free, compiled; see `hypotheses.free_directions`."""

import numpy as np

from tactopose_drake.core.compilation import kernel
from tactopose_drake.core.kernel_types import Floats1, Floats3, OutFloats3, OutLongs1
from tactopose_drake.core.kernels.matrix_kernels import cholesky, diagonalize, orthonormalize, transform
from tactopose_drake.core.kernels.sorting_kernels import copy_vector


@kernel
def find_free(information: Floats3, units: Floats1, limit: float, rows: OutFloats3, count: OutLongs1) -> None:
    """Finds the directions in which matrices (n, 6, 6) have less information than `limit`, in these units (6,).

    On entry rows (n, 6, 6) and count (n,) hold directions known to be free; on return, orthonormal rows that span these
    and the newly found ones, and their number. Where none is found, the rows stay unchanged.
    """
    A, L, work, across = np.empty((6, 6)), np.empty((6, 6)), np.empty((6, 6)), np.empty((6, 6))
    basis, vectors, values = np.empty((6, 6)), np.empty((6, 6)), np.empty(6)
    for b in range(information.shape[0]):
        known = count[b]
        for i in range(6):
            for k in range(6):
                A[i, k] = information[b, i, k] * units[i] * units[k]
                basis[i, k] = rows[b, i, k] / units[k]
        if known:
            # Give the known directions twice the limit, so that they are not found again.
            orthonormalize(basis, known)
            for i in range(6):
                for k in range(6):
                    across[i, k] = 1.0 if i == k else 0.0
                    for c in range(known):
                        across[i, k] -= basis[c, i] * basis[c, k]
            transform(across, A, work, A)
            for i in range(6):
                for k in range(6):
                    A[i, k] += 2.0 * limit * ((1.0 if i == k else 0.0) - across[i, k])
        for i in range(6):
            A[i, i] -= limit
        # Most matrices have no other: a Cholesky factorisation proves that sooner than the eigenvalues do.
        if cholesky(6, A, L) < np.inf:
            continue
        diagonalize(A, values, vectors)
        for c in range(6):
            if values[c] < 0.0:
                copy_vector(vectors[c], basis[count[b]])
                count[b] += 1
        if count[b] > known:
            for c in range(count[b]):
                for k in range(6):
                    rows[b, c, k] = basis[c, k] * units[k]
            orthonormalize(rows[b], count[b])
