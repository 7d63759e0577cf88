"""What the compiled updates of a mode share: arrays, and the normal equations of pose and biases together.

The joint state is the pose and, for each source of contacts, six biases: of the contact's position in P, m, and a
rotation of its normal in P, rad. Its increment (w, v, biases) has m = 6 + 6 s entries for s sources.
"""

from typing import NamedTuple

import numpy as np

from tactopose_drake.core.compilation import part
from tactopose_drake.core.kernel_types import Floats1, Floats2, Floats3, Longs1, OutFloats1, OutFloats2, OutFloats3
from tactopose_drake.core.kernels import prior_kernels


class ContactArrays(NamedTuple):
    """The k contacts of a frame.

    Attributes:
        p: points in P, shape (k, 3), m.
        n: outward unit normals in P, shape (k, 3).
        weight_p: one over the standard deviations of the points, shape (k,), 1/m.
        weight_n: one over the standard deviations of the normals, shape (k,), 1/rad; 0 where there is none.
        source: the source of each contact, shape (k,).
    """

    p: Floats2
    n: Floats2
    weight_p: Floats1
    weight_n: Floats1
    source: Longs1


class ModePriors(NamedTuple):
    """Gaussians over the joint state of B modes; the biases have mean zero.

    Attributes:
        X: poses, shape (B, 3, 4).
        information: inverse covariances of the joint increment from X, shape (B, m, m).
    """

    X: Floats3
    information: Floats3


class PriorRows(NamedTuple):
    """Scratch: the increment from the prior's pose.

    Attributes:
        increment: shape (1, 6).
        jacobian: its derivative with respect to an increment of the current pose, the inverse right Jacobian, shape
            (1, 6, 6).
    """

    increment: OutFloats2
    jacobian: OutFloats3


@part
def make_prior_rows() -> PriorRows:
    """Allocates `PriorRows`."""
    return PriorRows(np.empty((1, 6)), np.empty((1, 6, 6)))


@part
def compare_with_prior(X_prior: Floats2, X: Floats3, rows: PriorRows) -> None:
    """Writes the increment from the prior's pose (3, 4) to the pose X (1, 3, 4), and its derivative."""
    prior_kernels.compare(X_prior, X[0], rows.increment[0], rows.jacobian[0])


@part
def transport_information(jacobian: Floats2, H: OutFloats2) -> None:
    """Replaces H (m, m), with respect to increments at the prior, by diag(A, 1)^T H diag(A, 1), with A the jacobian."""
    column, row = np.empty(6), np.empty(6)
    for c in range(H.shape[1]):
        for a in range(6):
            column[a] = 0.0
            for k in range(6):
                column[a] += jacobian[k, a] * H[k, c]
        for a in range(6):
            H[a, c] = column[a]
    for a in range(H.shape[0]):
        for c in range(6):
            row[c] = 0.0
            for k in range(6):
                row[c] += H[a, k] * jacobian[k, c]
        for c in range(6):
            H[a, c] = row[c]


@part
def add_normal_equations(
    source: int, G: Floats2, L: Floats2, R: Floats2, residual: Floats1, g: OutFloats1, H: OutFloats2
) -> None:
    """Adds the normal equations of one contact: g += G^T residual and H += L^T R.

    Args:
        source: the contact's.
        G: rows (4, 12) of the gradient, with respect to the increment and the biases of the source.
        L: rows (4, 12) of the Hessian's left factor.
        R: rows (4, 12) of the Hessian's right factor.
        residual: shape (4,).
        g: gradient with respect to the joint increment, shape (m,).
        H: Hessian, shape (m, m).
    """
    at = 6 * source
    for a in range(12):
        row = a if a < 6 else at + a
        l0, l1, l2, l3 = L[0, a], L[1, a], L[2, a], L[3, a]
        for k in range(4):
            g[row] += G[k, a] * residual[k]
        for c in range(6):
            H[row, c] = H[row, c] + l0 * R[0, c] + l1 * R[1, c] + l2 * R[2, c] + l3 * R[3, c]
        for c in range(6, 12):
            H[row, at + c] = H[row, at + c] + l0 * R[0, c] + l1 * R[1, c] + l2 * R[2, c] + l3 * R[3, c]
