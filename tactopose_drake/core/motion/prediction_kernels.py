"""The motion of a held object and its effect on poses, compiled; see `object_motion.py` and `rigid_motion.py`."""

import numpy as np

from tactopose_drake.core.compilation import kernel
from tactopose_drake.core.kernel_types import Floats2, Floats3, OutFloats1, OutFloats2, OutFloats3
from tactopose_drake.core.kernels.matrix_kernels import multiply, transform


@kernel
def add_velocities(
    p: Floats2, n: Floats2, velocity: Floats2, noise: Floats2, information: OutFloats2, right: OutFloats1
) -> None:
    """Adds the velocities of k contacts to the normal equations of a twist.

    A contact's velocity is [-[p]x 1] (w, v). Its three rows are whitened, more strongly along the normal than across
    it; a fourth row is the rotation about the normal.

    Args:
        p: the contacts' points, shape (k, 3), m.
        n: their normals, shape (k, 3); zeros where there are none.
        velocity: spatial velocities [w, v] of the bodies that touch there, shape (k, 6).
        noise: standard deviations of the velocity across the normal and along it, m/s, and of the rotation about it,
            rad/s, shape (k, 3).
        information: of the twist [w, v] at the origin, shape (6, 6).
        right: right-hand side, shape (6,).
    """
    rows, normal = np.zeros((4, 6)), np.empty(6)
    for i in range(p.shape[0]):
        x, y, z, across = p[i, 0], p[i, 1], p[i, 2], 1.0 / noise[i, 0]
        more = 1.0 / noise[i, 1] - across
        normal[0], normal[1], normal[2] = (
            y * n[i, 2] - z * n[i, 1],
            z * n[i, 0] - x * n[i, 2],
            x * n[i, 1] - y * n[i, 0],
        )
        for k in range(3):
            normal[3 + k] = n[i, k]
        for k in range(3):
            for a in range(6):
                rows[k, a] = more * n[i, k] * normal[a]
            rows[k, 3 + k] += across
            rows[3, k] = n[i, k] / noise[i, 2]
        rows[0, 1] += across * z
        rows[0, 2] -= across * y
        rows[1, 0] -= across * z
        rows[1, 2] += across * x
        rows[2, 0] += across * y
        rows[2, 1] -= across * x
        for k in range(4):
            wanted = 0.0
            for a in range(6):
                wanted += rows[k, a] * velocity[i, a]
            for a in range(6):
                right[a] += rows[k, a] * wanted
                for c in range(6):
                    information[a, c] += rows[k, a] * rows[k, c]


@kernel
def carry(
    turn: Floats2, error: Floats2, X: Floats3, P: Floats3, C: Floats3, P_after: OutFloats3, C_after: OutFloats3
) -> None:
    """Covariances of the increments of poses, and their covariances with biases, after a motion; see `predict_poses`.

    Args:
        turn: maps increments before the motion to those after it: w stays, v rotates with it; shape (6, 6).
        error: covariance of a small error twist about the origin of P after the motion, shape (6, 6).
        X: poses after the motion, shape (n, 3, 4).
        P: covariances of increments before, shape (n, 6, 6).
        C: covariances of the increments with the other variables, shape (n, 6, m).
        P_after: output, like P.
        C_after: output, like C.
    """
    arm, work, more = np.zeros((6, 6)), np.empty((6, 6)), np.empty((6, 6))
    for a in range(3):
        arm[3 + a, 3 + a] = 1.0
    for b in range(X.shape[0]):
        x, y, z = X[b, 0, 3], X[b, 1, 3], X[b, 2, 3]
        for a in range(3):
            for k in range(3):
                arm[a, k] = X[b, k, a]
        arm[3, 1], arm[3, 2], arm[4, 0], arm[4, 2], arm[5, 0], arm[5, 1] = z, -y, -z, x, y, -x
        transform(arm, error, work, more)
        transform(turn, P[b], work, P_after[b])
        for a in range(6):
            for c in range(6):
                P_after[b, a, c] += more[a, c]
        multiply(turn, C[b], C_after[b])
