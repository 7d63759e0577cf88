"""The inner loop that regresses what contacts say over the spread of a mode, compiled by numba.

Source: [G15] A. Garcia-Fernandez et al., Posterior linearization filter: principles and implementation using sigma
points, IEEE Trans. Signal Processing, 2015.
"""

import numpy as np
from numba import njit

from tactopose_drake.core import kernels

# Sigma points lie so many standard deviations out: the root of the number of dimensions.
_OUT = 2.449489742783178
# What a regression leaves is no noise that is new at each frame: while the mode stays, it stays. It counts so many
# times, for about as many frames as the belief remembers.
_REPEATED = 16.0
# A slope counts as far as it stands out from the bend beside it: what facets and edges make up is about as large.
_DOUBT = 4.0


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
):
    """Moves poses X (B, 3, 4), with their Hessians (B, m, m), by statistical linear regression over their own spread.

    A tangent says what the contacts tell at one pose. Over the spread of a mode the surface bends, and its facets and
    edges make the tangent's slope one of many. The contacts' rows are therefore regressed over sigma points of the
    mode, moved by at most `reach`, m, where a radian moves the surface by `arm`, m; what the regression leaves is noise
    too. Writes cost, logarithms and Hessian as `refine_modes` does.
    """
    size, count = information.shape[1], p.shape[0]
    here, there = np.empty((1, 3, 4)), np.empty((1, 3, 4))
    whitened, turned = np.empty((1, 6)), np.empty((1, 6, 6))
    units = np.zeros((size, 6))
    for i in range(6):
        units[i, i] = 1.0
    rows = np.empty((13, count, 4))
    field, q, m, increment = np.empty(4), np.empty(3), np.empty(3), np.empty((1, 6))
    root, scale = np.empty((6, 6)), np.empty(6)
    z, slope = np.empty(size), np.empty(size)
    g, H, step, damping = np.empty((1, size)), np.empty((1, size, size)), np.empty((1, size)), np.zeros(1)
    weights = np.empty(count)
    J, R, W, mean = np.empty((4, 12)), np.empty((4, 4)), np.empty((4, 4)), np.empty(4)
    for b in range(X.shape[0]):
        here[0] = X[b]
        for _ in range(rounds):
            P = np.linalg.solve(hessian[b], units)[:6]
            root[:, :] = np.linalg.cholesky(0.5 * (P + P.T))
            for j in range(6):
                way = 0.0
                for i in range(3):
                    way += (arm * root[i, j]) ** 2 + root[3 + i, j] ** 2
                way = _OUT * np.sqrt(way)
                scale[j] = 1.0 if way < reach else reach / way
            # The rows at the middle and at the sigma points, whitened as at the middle.
            for s in range(13):
                there[0] = here[0]
                if s > 0:
                    j = (s - 1) // 2
                    sign = 1.0 if s % 2 else -1.0
                    for i in range(6):
                        increment[0, i] = sign * _OUT * scale[j] * root[i, j]
                    kernels.retract(here, increment, there)
                for i in range(count):
                    kernels._to_object(there[0], p[i], q)
                    kernels._look_up(values, origin, inverse_spacing, q[0], q[1], q[2], field)
                    rows[s, i, 0] = field[0] * weight_p[i]
                    for k in range(3):
                        rows[s, i, 1 + k] = 0.0
                    if weight_n[i] > 0.0:
                        if s == 0:
                            weights[i], _ = kernels._normal_weight(field, weight_n[i])
                        kernels._rotate_to_object(there[0], n[i], m)
                        for k in range(3):
                            rows[s, i, 1 + k] = (field[1 + k] - m[k]) * weights[i]
            # The prior, as in `_evaluate`, with the biases' mean at zero.
            kernels.prior_residuals(X_prior[b], np.ones(6), here, whitened, turned)
            z[:6], z[6:] = whitened[0], 0.0
            for i in range(size):
                slope[i] = 0.0
                for j in range(6):
                    slope[i] += information[b, i, j] * z[j]
            total = 0.0
            A = np.ascontiguousarray(turned[0])
            for i in range(6):
                total += 0.5 * z[i] * slope[i]
            for i in range(size):
                g[0, i] = slope[i]
                for j in range(size):
                    H[0, i, j] = information[b, i, j]
            for i in range(6):
                g[0, i] = 0.0
                for k in range(6):
                    g[0, i] += A[k, i] * slope[k]
            H[0, :6, :] = np.ascontiguousarray(A.T) @ np.ascontiguousarray(H[0, :6, :])
            H[0, :, :6] = np.ascontiguousarray(H[0, :, :6]) @ A
            inverse_root = np.linalg.inv(root)
            logarithms = 0.0
            for i in range(count):
                at = 6 + 6 * source[i]
                J[:, :] = 0.0
                used = 4 if weight_n[i] > 0.0 else 1
                for k in range(4):
                    mean[k] = 0.0
                    for s in range(1, 13):
                        mean[k] += rows[s, i, k] / 12.0
                    # Half the difference along each axis of the spread, back in increments.
                    for j in range(6):
                        half = 0.5 * (rows[2 * j + 1, i, k] - rows[2 * j + 2, i, k])
                        bend = 0.5 * (rows[2 * j + 1, i, k] + rows[2 * j + 2, i, k]) - rows[0, i, k]
                        half *= half * half / (half * half + _DOUBT * bend * bend + 1e-12) / (_OUT * scale[j])
                        for c in range(6):
                            J[k, c] += half * inverse_root[j, c]
                # What the regression leaves, a 4x4 covariance.
                for k in range(4):
                    for c in range(4):
                        R[k, c] = 1.0 if k == c else 0.0
                for s in range(1, 13):
                    j = (s - 1) // 2
                    sign = 1.0 if s % 2 else -1.0
                    far = 1.0 / scale[j] ** 2
                    for k in range(used):
                        along_k = 0.5 * sign * (rows[2 * j + 1, i, k] - rows[2 * j + 2, i, k])
                        left_k = rows[s, i, k] - mean[k] - along_k
                        for c in range(used):
                            along_c = 0.5 * sign * (rows[2 * j + 1, i, c] - rows[2 * j + 2, i, c])
                            left_c = rows[s, i, c] - mean[c] - along_c
                            R[k, c] += _REPEATED * far * left_k * left_c / 12.0
                W[:, :] = np.linalg.inv(R)
                logarithms += 0.5 * np.log(np.linalg.det(R))
                for c in range(3):
                    for k in range(4):
                        J[k, 6 + c] = J[k, 3 + c]
                if weight_n[i] > 0.0:
                    for a in range(3):
                        r0, r1, r2 = here[0, 0, a], here[0, 1, a], here[0, 2, a]
                        J[1 + a, 9] = -weights[i] * (r1 * n[i, 2] - r2 * n[i, 1])
                        J[1 + a, 10] = -weights[i] * (r2 * n[i, 0] - r0 * n[i, 2])
                        J[1 + a, 11] = -weights[i] * (r0 * n[i, 1] - r1 * n[i, 0])
                WJ = W @ J
                for k in range(4):
                    for c in range(4):
                        total += 0.5 * mean[k] * W[k, c] * mean[c]
                for a in range(12):
                    row = a if a < 6 else at + a - 6
                    for k in range(4):
                        g[0, row] += WJ[k, a] * mean[k]
                    for c in range(12):
                        column = c if c < 6 else at + c - 6
                        for k in range(4):
                            H[0, row, column] += J[k, a] * WJ[k, c]
            kernels.damped_steps(H, g, damping, step)
            for i in range(size):
                total += 0.5 * g[0, i] * step[0, i]
            kernels.retract(here, step[:, :6], there)
            here[0], hessian[b] = there[0], H[0]
            cost[b], spread[b] = total + logarithms, logarithms
        X[b] = here[0]
