"""The compiled loops of a mixture of Student-t densities over poses; see `student_t_mixture.py`.

A component is a density of increments u from its group's pose, with middle m, information H and f degrees of freedom
over n dimensions: scale (f / (f + (u - m)^T H (u - m)))^((f + n) / 2). Its samples are m + L^-T z sqrt(f / c) with
H = L L^T, z white and c of chi-square with f degrees of freedom. By the volume of poses it is divided by the
determinant of the right Jacobian of the increment's rotation vector.
"""

from typing import NamedTuple

import numpy as np

from tactopose_drake.core.compilation import (
    Floats2,
    Floats3,
    Longs1,
    OutFloats1,
    OutFloats2,
    OutFloats3,
    OutLongs1,
    kernel,
    part,
)
from tactopose_drake.core.kernels import pose_kernels
from tactopose_drake.core.kernels.matrix_kernels import cholesky, invert, solve_transposed


class Components(NamedTuple):
    """The components of a mixture, sorted by group; see `prepare`.

    Attributes:
        first: the first component of each group, and behind the last one's, shape (g + 1,).
        center: increments from the group's pose, shape (n, 6).
        information: over the directions across the turns, shape (n, 6, 6).
        reach: squared distance in translation within which a pose may belong to each group, shape (g,), m^2.
        scale: the densities' constants, times how many samples are drawn of each, shape (n,).
    """

    first: OutLongs1
    center: Floats2
    information: OutFloats3
    reach: OutFloats1
    scale: OutFloats1


@kernel
def prepare(
    group: Longs1, turns: Floats3, count: Longs1, constant: float, farthest: float, components: Components
) -> None:
    """Fills what is left to know of components: `first` and `reach` are zero, and the information whole, on entry.

    Beyond a squared Mahalanobis distance a pose does not belong to a component.
    """
    first, center, information, reach, scale = components
    L, covariance, image = np.empty((6, 6)), np.empty((6, 6)), np.empty(6)
    for j in range(group.shape[0]):
        logarithm = cholesky(information[j], L)
        invert(L, covariance)
        spread, square = 0.0, 0.0
        for i in range(3, 6):
            spread += covariance[i, i]
            square += center[j, i] ** 2
        g = group[j]
        reach[g] = max(reach[g], (np.sqrt(square) + np.sqrt(farthest * spread)) ** 2)
        scale[j] = count[j] * np.exp(constant + 0.5 * (logarithm - _leave_out(turns[j], information[j], image)))
        first[g + 1] += 1
    for g in range(reach.shape[0]):
        first[g + 1] += first[g]


@kernel
def leave_out(turns: Floats3, across: OutFloats3, logarithm: OutFloats1) -> None:
    """Leaves turns (n, 6, c) out of information (n, 6, 6); logarithms (n,) of what is left of its determinants."""
    L, image = np.empty((6, 6)), np.empty(6)
    for j in range(across.shape[0]):
        logarithm[j] = cholesky(across[j], L)
        logarithm[j] -= _leave_out(turns[j], across[j], image)


@part
def _leave_out(turns: Floats2, A: OutFloats2, image: OutFloats1) -> float:
    """Leaves one turn (6, c) out after the other; the logarithm of what that takes off the determinant.

    image (6,) is for work.
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
    """By the right Jacobian of the rotations and its inverse: J. Sola et al., A micro Lie theory for state estimation,
    2018, eqs. 143 and 144.
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
        # Only the rows and columns of the rotation change.
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
    """Poses X (B, 3, 4), so many of each component, from white increments, those of one group behind each other.

    If they are opposed, every second one of a component is the opposite of the one before it.
    """
    u, L = np.empty(6), np.empty((6, 6))
    b, place = 0, 0
    for j in range(count.shape[0]):
        if j > 0 and group[j] != group[j - 1]:
            place = 0
        cholesky(information[j], L)
        for c in range(count[j]):
            is_opposite = opposed and c % 2 == 1
            solve_transposed(L, white[place - is_opposite], u)
            for i in range(6):
                u[i] = center[j, i] - u[i] if is_opposite else center[j, i] + u[i]
            pose_kernels.retract_one(X_group[group[j]], u, X[b])
            b, place = b + 1, place + 1


@kernel
def find_increments(X_group: Floats3, X: Floats3, increment: OutFloats3, volume: OutFloats2) -> None:
    """Increments from each group's pose (g, 3, 4) to each pose (B, 3, 4), and their volume over that of poses there.

    That is the determinant of the right Jacobian of the rotation.
    """
    for b in range(X.shape[0]):
        for g in range(X_group.shape[0]):
            u = increment[b, g]
            pose_kernels.increment_between(X_group[g], X[b], u)
            angle2 = u[0] ** 2 + u[1] ** 2 + u[2] ** 2
            volume[b, g] = 1.0 - angle2 / 12.0 if angle2 < 1e-4 else 2.0 * (1.0 - np.cos(np.sqrt(angle2))) / angle2


@kernel
def add_densities(
    components: Components, freedom: int, power: int, increment: Floats3, volume: Floats2, density: OutFloats2
) -> None:
    """Adds scale (f / (f + d^T H d))^(power / 2) of each component, d from its center, by the volume of poses.

    Each number of the components is an array by itself, so that several components are reckoned at once.
    """
    first, center, information, reach, scale = components
    count = center.shape[0]
    c, H = np.empty((6, count)), np.empty((21, count))
    for j in range(count):
        row = 0
        for a in range(6):
            c[a, j] = center[j, a]
            for i in range(a):
                H[row, j] = 2.0 * information[j, a, i]
                row += 1
            H[row, j] = information[j, a, a]
            row += 1
    ratio, share = np.empty(count), np.empty(count)
    for b in range(increment.shape[0]):
        for g in range(reach.shape[0]):
            u = increment[b, g]
            if u[3] ** 2 + u[4] ** 2 + u[5] ** 2 > reach[g]:
                continue
            begin, end = np.uintp(first[g]), np.uintp(first[g + 1])
            for j in range(begin, end):
                x, y, z = u[0] - c[0, j], u[1] - c[1, j], u[2] - c[2, j]
                r, s, t = u[3] - c[3, j], u[4] - c[4, j], u[5] - c[5, j]
                square = x * (H[0, j] * x) + y * (H[1, j] * x + H[2, j] * y)
                square += z * (H[3, j] * x + H[4, j] * y + H[5, j] * z)
                square += r * (H[6, j] * x + H[7, j] * y + H[8, j] * z + H[9, j] * r)
                square += s * (H[10, j] * x + H[11, j] * y + H[12, j] * z + H[13, j] * r + H[14, j] * s)
                square += t * (H[15, j] * x + H[16, j] * y + H[17, j] * z + H[18, j] * r + H[19, j] * s + H[20, j] * t)
                ratio[j] = freedom / (freedom + square)
                share[j] = scale[j] * (np.sqrt(ratio[j]) if power % 2 else 1.0)
            for _ in range(power // 2):
                for j in range(begin, end):
                    share[j] *= ratio[j]
            total = 0.0
            for j in range(begin, end):
                total += share[j]
            density[b, g] += total / volume[b, g]
