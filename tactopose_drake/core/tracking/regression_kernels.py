"""The inner loop that regresses what contacts say over the spread of a mode, compiled by numba.

A tangent says what the contacts tell at one pose. Over the spread of a mode the surface bends, and its facets and edges
make the tangent's slope one of many. The contacts' rows are therefore regressed over sigma points of the mode [G15].
The points lie along the axes of the spread, so that a direction of which the touch tells nothing is one of them, and
neither the others' slopes nor their bends leak into it.

What the surface does beside its slope is no noise: while the contact stays, it stays. It is told to the caller as
roughness, which belongs to the part of the contacts' errors that is the same at all times.

Source: [G15] A. Garcia-Fernandez et al., Posterior linearization filter: principles and implementation using sigma
points, IEEE Trans. Signal Processing, 2015.
"""

import numpy as np
from numba import njit

from tactopose_drake.core.kernels import grid_kernels, least_squares_kernels, pose_kernels, prior_kernels

# Sigma points lie so many standard deviations out: the root of the number of dimensions.
_OUT = 2.449489742783178
# A slope counts as far as it stands out from the bend beside it: what facets and edges make up is about as large.
_DOUBT = 4.0
# Of the spread of the surface's normals about a contact, 1 - |n|^2, some half is an error of the expected normal that
# stays as long as the contact does, across an edge all in one direction; and a quarter is new at each time, because the
# contact is measured elsewhere.
_STAYS, _NEW = 0.5, 0.25
# The least variance along an axis, m^2.
_LEAST = 1e-16


@njit(cache=True, nogil=True)
def regress_modes(  # type: ignore[no-untyped-def]
    values,
    origin,
    inverse_spacing,
    p,
    n,
    weight_p,
    weight_n,
    source,
    X_prior,
    information,
    X,
    arm,
    reach,
    rounds,
    cost,
    spread,
    hessian,
    roughness,
):
    """Moves poses X (B, 3, 4), with their Hessians (B, m, m), by statistical linear regression over their own spread.

    Sigma points move what is touched by at most `reach`, m, root mean square. A radian counts as `arm`, m, where axes
    of the spread are asked for. Writes the cost (B,), that part of it which is logarithms of variances rather than
    squares (B,), the Hessian by the increment and the biases, and the roughness (B, k, 2) of the surface about each
    contact: variances of its distance, m^2, and of its normal about each axis, rad^2.
    """
    size, count = information.shape[1], p.shape[0]
    here, there = np.empty((1, 3, 4)), np.empty((1, 3, 4))
    whitened, turned = np.empty((1, 6)), np.empty((1, 6, 6))
    units = np.zeros((size, 6))
    for i in range(6):
        units[i, i] = 1.0
    rows = np.empty((13, count, 4))
    increment, m = np.empty((1, 6)), np.empty(3)
    root, inverse_root, scale = np.empty((6, 6)), np.empty((6, 6)), np.empty(6)
    g, H, step, damping = np.empty((1, size)), np.empty((1, size, size)), np.empty((1, size)), np.zeros(1)
    weights = np.empty(count)
    J, R, W, mean = np.empty((4, 12)), np.empty((4, 4)), np.empty((4, 4)), np.empty(4)
    for b in range(X.shape[0]):
        here[0] = X[b]
        for _ in range(rounds):
            _find_axes(np.linalg.solve(hessian[b], units)[:6], here[0], p, arm, reach, root, inverse_root, scale)
            for s in range(13):
                there[0] = here[0]
                if s > 0:
                    j = (s - 1) // 2
                    sign = 1.0 if s % 2 else -1.0
                    for i in range(6):
                        increment[0, i] = sign * _OUT * scale[j] * root[i, j]
                    pose_kernels.retract(here, increment, there)
                _look(
                    values, origin, inverse_spacing, p, n, weight_p, weight_n, there[0], s == 0, rows[s], weights,
                    roughness[b],
                )  # fmt: skip
            # The prior, as in `tracking_kernels`, with the biases' mean at zero.
            prior_kernels.prior_residuals(X_prior[b], np.ones(6), here, whitened, turned)
            A, z = np.ascontiguousarray(turned[0]), whitened[0]
            H[0] = information[b]
            slope = np.ascontiguousarray(H[0, :, :6]) @ z
            total = 0.5 * np.dot(z, slope[:6])
            g[0] = slope
            g[0, :6] = A.T @ slope[:6]
            H[0, :6, :] = np.ascontiguousarray(A.T) @ np.ascontiguousarray(H[0, :6, :])
            H[0, :, :6] = np.ascontiguousarray(H[0, :, :6]) @ A
            logarithms = 0.0
            for i in range(count):
                _regress(rows[:, i], inverse_root, scale, J, R, mean)
                roughness[b, i, 0] = (R[0, 0] - 1.0) / weight_p[i] ** 2
                J[:, 6:] = 0.0
                for k in range(4):
                    for c in range(3):
                        J[k, 6 + c] = J[k, 3 + c]
                if weight_n[i] > 0.0:
                    roughness[b, i, 1] += 0.5 * (R[1, 1] + R[2, 2] + R[3, 3] - 3.0) / weights[i] ** 2
                    # A turn b takes the normal m that is expected to one that differs by m x b.
                    for k in range(3):
                        m[k] = rows[0, i, 1 + k] + weights[i] * n[i, k]
                    J[1, 10], J[1, 11] = -m[2], m[1]
                    J[2, 9], J[2, 11] = m[2], -m[0]
                    J[3, 9], J[3, 10] = -m[1], m[0]
                W[:, :] = np.linalg.inv(R)
                logarithms += 0.5 * np.log(np.linalg.det(R))
                WJ = W @ J
                for k in range(4):
                    for c in range(4):
                        total += 0.5 * mean[k] * W[k, c] * mean[c]
                at = 6 * source[i]
                for a in range(12):
                    row = a if a < 6 else at + a
                    for k in range(4):
                        g[0, row] += WJ[k, a] * mean[k]
                    for c in range(12):
                        column = c if c < 6 else at + c
                        for k in range(4):
                            H[0, row, column] += J[k, a] * WJ[k, c]
            least_squares_kernels.damped_steps(H, g, damping, step)
            total += 0.5 * np.dot(g[0], step[0])
            pose_kernels.retract(here, step[:, :6], there)
            here[0], hessian[b] = there[0], H[0]
            cost[b], spread[b] = total + logarithms, logarithms
        X[b] = here[0]


@njit(cache=True, nogil=True)
def _find_axes(P, X, p, arm, reach, root, inverse_root, scale):  # type: ignore[no-untyped-def]
    """The axes of a covariance P (6, 6) as a root of it, the root's inverse, and by how much reach shortens each."""
    for i in range(6):
        for j in range(6):
            root[i, j] = 0.5 * (P[i, j] + P[j, i]) * (arm if i < 3 else 1.0) * (arm if j < 3 else 1.0)
    variances, vectors = np.linalg.eigh(root)
    q = np.empty(3)
    for j in range(6):
        deviation = np.sqrt(max(variances[j], _LEAST))
        for i in range(6):
            unit = arm if i < 3 else 1.0
            root[i, j] = vectors[i, j] * deviation / unit
            inverse_root[j, i] = vectors[i, j] / deviation * unit
        way = 0.0
        for i in range(p.shape[0]):
            pose_kernels.to_object(X, p[i], q)
            for a in range(3):
                c, d = (a + 1) % 3, (a + 2) % 3
                moved = root[c, j] * q[d] - root[d, j] * q[c]
                for k in range(3):
                    moved += X[k, a] * root[3 + k, j]
                way += moved * moved
        way = _OUT * np.sqrt(way / p.shape[0])
        scale[j] = 1.0 if way < reach else reach / way


@njit(cache=True, nogil=True)
def _look(  # type: ignore[no-untyped-def]
    values, origin, inverse_spacing, p, n, weight_p, weight_n, X, is_middle, rows, weights, roughness
):
    """The whitened rows (k, 4) of the contacts at a pose: distance, and the expected normal less the measured, in P.

    Seen from P their slope is that of the expected normal alone. Seen from O, the measured one would turn with the
    object, its error with it, and the error's square pass for information. At the middle the normals' weights (k,) are
    written, and their part of the roughness.
    """
    q, field = np.empty(3), np.empty(4)
    for i in range(p.shape[0]):
        pose_kernels.to_object(X, p[i], q)
        grid_kernels.look_up(values, origin, inverse_spacing, q[0], q[1], q[2], field)
        rows[i, 0] = field[0] * weight_p[i]
        for k in range(3):
            rows[i, 1 + k] = 0.0
        if weight_n[i] > 0.0:
            square = field[1] ** 2 + field[2] ** 2 + field[3] ** 2
            if is_middle:
                apart = max(0.0, 1.0 - square)
                weights[i] = weight_n[i] / np.sqrt(1.0 + _NEW * apart * weight_n[i] ** 2)
                roughness[i, 1] = _STAYS * apart
            length = np.sqrt(square + grid_kernels.SOFT_LENGTH**2)
            for k in range(3):
                normal = X[k, 0] * field[1] + X[k, 1] * field[2] + X[k, 2] * field[3]
                rows[i, 1 + k] = (normal / length - n[i, k]) * weights[i]


@njit(cache=True, nogil=True)
def _regress(rows, inverse_root, scale, J, R, mean):  # type: ignore[no-untyped-def]
    """Of a contact's rows (13, 4) at the sigma points: slopes by the increment J[:, :6], mean, covariance R (4, 4).

    R is that of the rows' noise, one, and of what the slopes leave over.
    """
    for k in range(4):
        mean[k] = 0.0
        for s in range(1, 13):
            mean[k] += rows[s, k] / 12.0
        for c in range(4):
            R[k, c] = 1.0 if k == c else 0.0
        for c in range(6):
            J[k, c] = 0.0
        for j in range(6):
            half = 0.5 * (rows[2 * j + 1, k] - rows[2 * j + 2, k])
            bend = 0.5 * (rows[2 * j + 1, k] + rows[2 * j + 2, k]) - rows[0, k]
            half *= half * half / (half * half + _DOUBT * bend * bend + 1e-12) / (_OUT * scale[j])
            for c in range(6):
                J[k, c] += half * inverse_root[j, c]
    for j in range(6):
        share = 1.0 / (6.0 * scale[j] ** 2)
        for k in range(4):
            left_k = 0.5 * (rows[2 * j + 1, k] + rows[2 * j + 2, k]) - mean[k]
            for c in range(4):
                left_c = 0.5 * (rows[2 * j + 1, c] + rows[2 * j + 2, c]) - mean[c]
                R[k, c] += share * left_k * left_c
