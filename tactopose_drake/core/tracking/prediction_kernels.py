"""The motion of a held object and what it makes of poses, compiled; see `motion_prediction.py`."""

import numpy as np

from tactopose_drake.core.compilation import Floats1, Floats2, Floats3, OutFloats1, OutFloats2, OutFloats3, kernel, part
from tactopose_drake.core.kernels.matrix_kernels import cholesky, invert, multiply, solve, transform
from tactopose_drake.core.kernels.pose_kernels import compose_one


@kernel
def join_velocities(
    p: Floats2,
    n: Floats2,
    velocity: Floats2,
    noise: Floats2,
    free: Floats1,
    twist: OutFloats1,
    covariance: OutFloats2,
) -> None:
    """The twist of least squares by the velocities of k contacts, per second, and its covariance.

    Args:
        p: the contacts' points, shape (k, 3), m.
        n: their normals, shape (k, 3); zeros where there are none.
        velocity: spatial velocities [w, v] of what touches there, shape (k, 6).
        noise: standard deviations of the velocity across the normal and along it, m/s, and of the turn about it, rad/s,
            shape (k, 3).
        free: variances of a twist that nothing holds, shape (6,).
        twist: [w, v] at the origin, written, shape (6,).
        covariance: written, shape (6, 6).
    """
    H, L, rows, wanted = np.zeros((6, 6)), np.empty((6, 6)), np.zeros((4, 6)), np.empty(4)
    for a in range(6):
        H[a, a], twist[a] = 1.0 / free[a], 0.0
    for i in range(p.shape[0]):
        _velocity_rows(p[i], n[i], noise[i], rows)
        for k in range(4):
            wanted[k] = 0.0
            for a in range(6):
                wanted[k] += rows[k, a] * velocity[i, a]
            for a in range(6):
                twist[a] += rows[k, a] * wanted[k]
                for c in range(6):
                    H[a, c] += rows[k, a] * rows[k, c]
    cholesky(H, L)
    solve(L, twist)
    invert(L, covariance)
    for a in range(6):
        for c in range(a):
            covariance[a, c] = covariance[c, a] = 0.5 * (covariance[a, c] + covariance[c, a])


@part
def _velocity_rows(p: Floats1, n: Floats1, noise: Floats1, rows: OutFloats2) -> None:
    """Rows (4, 6) of the grasp matrix of one contact, over their standard deviations.

    A contact's velocity is [-[p]x 1] (w, v). Its three rows are made those of a matrix of unit variance whose fourth
    one is the turn about the normal: along the normal they say more than across it.
    """
    across, more = 1.0 / noise[0], 1.0 / noise[1] - 1.0 / noise[0]
    for a in range(3):
        c, d = (a + 1) % 3, (a + 2) % 3
        rows[a, a], rows[a, c], rows[a, d] = 0.0, across * p[d], -across * p[c]
        rows[a, 3], rows[a, 4], rows[a, 5] = 0.0, 0.0, 0.0
        rows[a, 3 + a] = across
        rows[3, a] = n[a] / noise[2]
    for k in range(3):
        for a in range(3):
            c, d = (a + 1) % 3, (a + 2) % 3
            rows[k, a] += more * n[k] * (p[c] * n[d] - p[d] * n[c])
            rows[k, 3 + a] += more * n[k] * n[a]


@kernel
def carry(
    motion: Floats2,
    error: Floats2,
    X: Floats3,
    P: Floats3,
    C: Floats3,
    X_after: OutFloats3,
    P_after: OutFloats3,
    C_after: OutFloats3,
) -> None:
    """Poses, covariances of their increments, and those with biases after a motion; see `predict_poses`.

    Args:
        motion: a pose that acts from the left, shape (3, 4).
        error: covariance of a small twist about the origin of P after it, shape (6, 6).
        X: poses, shape (n, 3, 4).
        P: covariances of increments from them, shape (n, 6, 6).
        C: of the increments with what else there is, shape (n, 6, m).
        X_after: the poses after, written.
        P_after: likewise.
        C_after: likewise.
    """
    turn, arm, work, more = np.zeros((6, 6)), np.zeros((6, 6)), np.empty((6, 6)), np.empty((6, 6))
    for a in range(3):
        turn[a, a] = arm[3 + a, 3 + a] = 1.0
        for c in range(3):
            turn[3 + a, 3 + c] = motion[a, c]
    for b in range(X.shape[0]):
        compose_one(motion, X[b], X_after[b])
        for a in range(3):
            c, d = (a + 1) % 3, (a + 2) % 3
            arm[3 + a, c], arm[3 + a, d] = X_after[b, d, 3], -X_after[b, c, 3]
            for k in range(3):
                arm[a, k] = X_after[b, k, a]
        transform(arm, error, work, more)
        transform(turn, P[b], work, P_after[b])
        for a in range(6):
            for c in range(6):
                P_after[b, a, c] += more[a, c]
        multiply(turn, C[b], C_after[b])
