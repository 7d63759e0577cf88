"""The inner loops of the evidence of forces, friction and balance, in the style of `pose_kernels.py`.

Poses are (B, 3, 4); increments (w, v) as in `poses.py`.
"""

from typing import NamedTuple

import numpy as np

from tactopose_drake.core.compilation import kernel
from tactopose_drake.core.kernel_types import Floats1, Floats2, Floats3, OutFloats2, OutFloats3
from tactopose_drake.core.kernels.grid_kernels import Grid, look_up_with_derivative
from tactopose_drake.core.kernels.pose_kernels import chain, rotate_to_object, to_object

# Bounds the derivative of the angle between two directions where they are parallel.
_SOFT_SINE = 1e-9


class Forces(NamedTuple):
    """Forces, read-only: points (k, 3) and directions (k, 3) in P, and variances (k,) of their angle to normals."""

    p: Floats2
    u: Floats2
    variance: Floats1


@kernel
def friction_residuals(
    grid: Grid, forces: Forces, cone: float, X: Floats3, residuals: OutFloats2, jacobian: OutFloats3
) -> None:
    """Residuals (B, k), see `objectives.friction_cone`, and their Jacobian (B, k, 6) with respect to the increment.

    cone is the friction angle, rad.
    """
    p, u, variance = forces
    q, f, field, slope, row = np.empty(3), np.empty(3), np.empty(4), np.empty((4, 3)), np.empty(3)
    for b in range(X.shape[0]):
        for i in range(p.shape[0]):
            residuals[b, i] = 0.0
            jacobian[b, i] = 0.0
            to_object(X[b], p[i], q)
            look_up_with_derivative(grid, q[0], q[1], q[2], field, slope)
            rotate_to_object(X[b], u[i], f)
            n = field[1:]
            square = n[0] * n[0] + n[1] * n[1] + n[2] * n[2]
            along = f[0] * n[0] + f[1] * n[1] + f[2] * n[2]
            beside = np.sqrt(max(square - along * along, _SOFT_SINE**2))
            angle = np.arctan2(beside, along)
            if angle <= cone:
                continue
            # The more unit vectors spread, the shorter is their mean, see `surface_contact_kernels.normal_weight`.
            total = variance[i] + 0.5 * max(0.0, 1.0 - square)
            weight = 1.0 / np.sqrt(total)
            residuals[b, i] = weight * (angle - cone)
            shrink = 0.5 * (angle - cone) / total if square < 1.0 else 0.0
            row[:] = 0.0
            for c in range(3):
                # The derivative of the angle with respect to the normal, and of the weight to its length.
                part = (along * (n[c] - along * f[c]) / beside - beside * f[c]) / (square + _SOFT_SINE) + shrink * n[c]
                for a in range(3):
                    row[a] += part * slope[c + 1, a]
            chain(row, q, X[b], weight, jacobian[b, i])
            # The force turns with the increment, too: d(R^T u) = f x w.
            weight /= beside
            jacobian[b, i, 0] -= weight * (n[1] * f[2] - n[2] * f[1])
            jacobian[b, i, 1] -= weight * (n[2] * f[0] - n[0] * f[2])
            jacobian[b, i, 2] -= weight * (n[0] * f[1] - n[1] * f[0])


@kernel
def balance_residuals(
    A: Floats2, offset: Floats1, c: Floats1, X: Floats3, residuals: OutFloats2, jacobian: OutFloats3
) -> None:
    """Residuals (B, m) that are linear in the position of a point c (3,) of the object: A (R c + t) + offset.

    A is (m, 3) and offset (m,). Also writes their Jacobian (B, m, 6) with respect to the increment.
    """
    for b in range(X.shape[0]):
        for k in range(A.shape[0]):
            x = A[k, 0] * X[b, 0, 0] + A[k, 1] * X[b, 1, 0] + A[k, 2] * X[b, 2, 0]
            y = A[k, 0] * X[b, 0, 1] + A[k, 1] * X[b, 1, 1] + A[k, 2] * X[b, 2, 1]
            z = A[k, 0] * X[b, 0, 2] + A[k, 1] * X[b, 1, 2] + A[k, 2] * X[b, 2, 2]
            residuals[b, k] = offset[k] + x * c[0] + y * c[1] + z * c[2]
            J = jacobian[b, k]
            # d(R c) = R (w x c).
            J[0], J[1], J[2] = c[1] * z - c[2] * y, c[2] * x - c[0] * z, c[0] * y - c[1] * x
            for a in range(3):
                residuals[b, k] += A[k, a] * X[b, a, 3]
                J[3 + a] = A[k, a]
