"""Compiled loops that prepare and sample a mixture of Student-t densities over poses; see `student_t_mixture.py`.

A component is a density over increments u from its group's pose, with centre m, information H and f degrees of freedom
in n dimensions: scale (f / (f + (u - m)^T H (u - m)))^((f + n) / 2). Its samples are m + L^-T z sqrt(f / c) with
H = L L^T, z standard normal and c chi-square with f degrees of freedom. To be a density with respect to the volume of
poses, it is divided by the determinant of the right Jacobian of the increment's rotation vector.
"""

from typing import NamedTuple

import numpy as np

from tactopose_drake.core.compilation import kernel, part
from tactopose_drake.core.kernel_types import (
    Floats2,
    Floats3,
    Longs1,
    OutFloats1,
    OutFloats2,
    OutFloats3,
    OutLongs1,
)
from tactopose_drake.core.kernels import pose_kernels
from tactopose_drake.core.kernels.matrix_kernels import cholesky, solve, solve_transposed


class Preparation(NamedTuple):
    """Output of `prepare`: the remaining arrays of `student_t_density_kernels.Components`.

    On entry `first` and `reach` are zero, and the information includes the turns.
    """

    first: OutLongs1
    information: OutFloats3
    reach: OutFloats1
    scale: OutFloats1


@kernel
def prepare(
    group: Longs1,
    turns: Floats3,
    center: Floats2,
    count: Longs1,
    constant: float,
    farthest: float,
    preparation: Preparation,
) -> None:
    """Fills the rest of `Components`; beyond the squared Mahalanobis distance `farthest`, a pose belongs to none."""
    first, information, reach, scale = preparation
    L, column, image = np.empty((6, 6)), np.empty(6), np.empty(6)
    for j in range(group.shape[0]):
        logarithm = cholesky(6, information[j], L)
        spread, square = 0.0, 0.0
        for i in range(3, 6):
            for k in range(6):
                column[k] = 1.0 if k == i else 0.0
            solve(6, L, column)  # A column of the covariance.
            spread += column[i]
            square += center[j, i] ** 2
        g = group[j]
        reach[g] = max(reach[g], (np.sqrt(square) + np.sqrt(farthest * spread)) ** 2)
        scale[j] = count[j] * np.exp(constant + 0.5 * (logarithm - _leave_out(turns[j], information[j], image)))
        first[g + 1] += 1
    for g in range(reach.shape[0]):
        first[g + 1] += first[g]


@kernel
def leave_out(turns: Floats3, across: OutFloats3, logarithm: OutFloats1) -> None:
    """Projects turns (n, 6, c) out of information `across` (n, 6, 6); fills the log determinants (n,) that remain."""
    L, image = np.empty((6, 6)), np.empty(6)
    for j in range(across.shape[0]):
        logarithm[j] = cholesky(6, across[j], L)
        logarithm[j] -= _leave_out(turns[j], across[j], image)


@part
def _leave_out(turns: Floats2, A: OutFloats2, image: OutFloats1) -> float:
    """Projects turns (6, c) out of the information A one by one; returns what this takes off the log determinant.

    image (6,) is scratch.
    """
    lost = 0.0
    for c in range(turns.shape[1]):
        along = 0.0
        for i in range(6):
            image[i] = 0.0
            for k in range(6):
                image[i] += A[i, k] * turns[k, c]
            along += image[i] * turns[i, c]
        lost += np.log(along)
        for i in range(6):
            for k in range(6):
                A[i, k] -= image[i] * image[k] / along
    return lost


@kernel
def enter_chart(
    X_group: Floats3,
    group: Longs1,
    X: Floats3,
    information: Floats3,
    center: OutFloats2,
    inside: OutFloats3,
    turns: OutFloats3,
) -> None:
    """Fills centres, information and turns in the group's chart; see `student_t_mixture.in_chart`.

    The right Jacobian of the rotation and its inverse: J. Sola et al., A micro Lie theory for state estimation, 2018,
    eqs. 143 and 144.
    """
    J, inverse, W, part = np.empty((3, 3)), np.empty((3, 3)), np.zeros((3, 3)), np.empty((3, 6))
    for j in range(X.shape[0]):
        u = center[j]
        pose_kernels.increment_between(X_group[group[j]], X[j], u)
        W[0, 1], W[0, 2], W[1, 2] = -u[2], u[1], -u[0]
        W[1, 0], W[2, 0], W[2, 1] = u[2], -u[1], u[0]
        angle2 = u[0] * u[0] + u[1] * u[1] + u[2] * u[2]
        if angle2 < 1e-6:
            first, second, back = 0.5 - angle2 / 24.0, 1.0 / 6.0 - angle2 / 120.0, 1.0 / 12.0 + angle2 / 720.0
        else:
            angle = np.sqrt(angle2)
            first, second = (1.0 - np.cos(angle)) / angle2, (angle - np.sin(angle)) / (angle * angle2)
            back = 1.0 / angle2 - np.cos(0.5 * angle) / (2.0 * angle * np.sin(0.5 * angle))
        for a in range(3):
            for c in range(3):
                square = W[a, 0] * W[0, c] + W[a, 1] * W[1, c] + W[a, 2] * W[2, c]
                J[a, c] = -first * W[a, c] + second * square
                inverse[a, c] = 0.5 * W[a, c] + back * square
            J[a, a] += 1.0
            inverse[a, a] += 1.0
        # Only the rows and columns of the rotation change, and their Jacobian is J.
        A, B = information[j], inside[j]
        for a in range(3):
            for c in range(6):
                part[a, c] = J[0, a] * A[0, c] + J[1, a] * A[1, c] + J[2, a] * A[2, c]
        for a in range(6):
            for c in range(6):
                B[a, c] = part[a, c] if a < 3 else A[a, c]
        for a in range(3):
            for c in range(3):
                B[3 + a, c] = B[c, 3 + a]
                B[a, c] = part[a, 0] * J[0, c] + part[a, 1] * J[1, c] + part[a, 2] * J[2, c]
        for c in range(turns.shape[2]):
            x, y, z = turns[j, 0, c], turns[j, 1, c], turns[j, 2, c]
            for a in range(3):
                turns[j, a, c] = inverse[a, 0] * x + inverse[a, 1] * y + inverse[a, 2] * z


@kernel
def draw(
    X_group: Floats3,
    group: Longs1,
    center: Floats2,
    information: Floats3,
    count: Longs1,
    white: Floats2,
    opposed: bool,
    X: OutFloats3,
) -> None:
    """Draws poses X (B, 3, 4), `count` (J,) of each component, from white increments.

    The white increments are consumed from the start in each group. If they are opposed, every second sample of a
    component is the antithesis of the one before it. They are along the axes of the group's pose, so that samples turn
    with the frame of the poses.
    """
    u, L, own = np.empty(6), np.empty((6, 6)), np.empty((6, 6))
    b, place = 0, 0
    for j in range(count.shape[0]):
        if j > 0 and group[j] != group[j - 1]:
            place = 0
        R = X_group[group[j]]
        _turn_translations(R, information[j], own)
        cholesky(6, own, L)
        for c in range(count[j]):
            is_opposite = opposed and c % 2 == 1
            solve_transposed(6, L, white[place - is_opposite], u)
            x, y, z = u[3], u[4], u[5]
            for i in range(3):
                u[3 + i] = R[i, 0] * x + R[i, 1] * y + R[i, 2] * z
            for i in range(6):
                u[i] = center[j, i] - u[i] if is_opposite else center[j, i] + u[i]
            pose_kernels.retract_one(X_group[group[j]], u, X[b])
            b, place = b + 1, place + 1


@part
def _turn_translations(R: Floats2, A: Floats2, out: OutFloats2) -> None:
    """The lower triangle of information A (6, 6) on increments (w, R^T v), whose translation is along the own axes."""
    for i in range(3):
        for j in range(i + 1):
            out[i, j] = A[i, j]
        for j in range(3):
            out[3 + i, j] = R[0, i] * A[3, j] + R[1, i] * A[4, j] + R[2, i] * A[5, j]
        for j in range(i + 1):
            square = 0.0
            for k in range(3):
                square += (R[0, i] * A[3, 3 + k] + R[1, i] * A[4, 3 + k] + R[2, i] * A[5, 3 + k]) * R[k, j]
            out[3 + i, 3 + j] = square
