"""The inner loops of the belief's update, compiled by numba: a mode with the biases of the contacts.

The unknowns are the pose and, for each source of contacts, six errors that are the same at all times: of the contact's
position in P, m, and a turn of its normal, rad, in P. Contacts are compared with the distance grid as in
`surface_contact_kernels.py`.
"""

import numpy as np
from numba import njit

from tactopose_drake.core.kernels import least_squares_kernels, pose_kernels, prior_kernels, surface_contact_kernels


@njit(cache=True, nogil=True)
def _evaluate(  # type: ignore[no-untyped-def]
    values, origin, inverse_spacing, p, n, weight_p, weight_n, source, X_prior, information, X, bias, g, H
):
    """Cost of one pose (1, 3, 4) with its biases (6 s,), its gradient g (m,) and Gauss-Newton Hessian H (m, m).

    Where normals are spread, as at an edge, they say less. That this explains any normal, but none well, has no part in
    the cost: an edge is no less likely to be touched than what lies beside it.

    The bias shifts the contact as a shift of the object would: by its position the rows change as by v. A turn b of the
    normal m = R^T n in O changes them by -[m]x R^T b.
    """
    size = g.shape[0]
    residual, J, smooth, work = np.empty(5), np.empty((5, 6)), np.empty((4, 6)), np.empty((10, 4))
    whitened, turned = np.empty((1, 6)), np.empty((1, 6, 6))
    shifted, leaned, by_turn = np.empty(3), np.empty(3), np.empty((3, 3))
    # The prior: z = (increment from its pose, biases), whose derivative by the increment here is not quite one.
    z, slope = np.empty(size), np.empty(size)
    prior_kernels.prior_residuals(X_prior, np.ones(6), X, whitened, turned)
    z[:6], z[6:] = whitened[0], bias
    half = 0.0
    for i in range(size):
        slope[i] = 0.0
        for j in range(size):
            slope[i] += information[i, j] * z[j]
        half += 0.5 * z[i] * slope[i]
    A = turned[0]
    for i in range(size):
        g[i] = slope[i]
        for j in range(size):
            H[i, j] = information[i, j]
    for i in range(6):
        g[i] = 0.0
        for k in range(6):
            g[i] += A[k, i] * slope[k]
    H[:6, :] = np.ascontiguousarray(A.T) @ np.ascontiguousarray(H[:6, :])
    H[:, :6] = np.ascontiguousarray(H[:, :6]) @ A

    pose = X[0]
    for i in range(p.shape[0]):
        at = 6 * source[i]
        for a in range(3):
            shifted[a] = p[i, a] - bias[at + a]
        x, y, w = bias[at + 3], bias[at + 4], bias[at + 5]
        leaned[0] = n[i, 0] - (y * n[i, 2] - w * n[i, 1])
        leaned[1] = n[i, 1] - (w * n[i, 0] - x * n[i, 2])
        leaned[2] = n[i, 2] - (x * n[i, 1] - y * n[i, 0])
        surface_contact_kernels.contact_rows(
            values, origin, inverse_spacing, shifted, leaned, weight_p[i], weight_n[i], pose, residual, J, smooth, work
        )
        weight = 0.0
        if weight_n[i] > 0.0:
            weight, _ = surface_contact_kernels.normal_weight(work[4], weight_n[i])
        for k in range(4):
            half += 0.5 * residual[k] * residual[k]
        if weight_n[i] > 0.0:
            # Row a of -[m]x R^T is the cross product of the a-th axis of O, seen from P, with n.
            for a in range(3):
                r0, r1, r2 = pose[0, a], pose[1, a], pose[2, a]
                by_turn[a, 0] = -weight * (r1 * leaned[2] - r2 * leaned[1])
                by_turn[a, 1] = -weight * (r2 * leaned[0] - r0 * leaned[2])
                by_turn[a, 2] = -weight * (r0 * leaned[1] - r1 * leaned[0])
        else:
            by_turn[:] = 0.0
        column = 6 + at
        for a in range(6):
            for k in range(4):
                g[a] += J[k, a] * residual[k]
        for a in range(3):
            for k in range(4):
                g[column + a] += J[k, 3 + a] * residual[k]
            for k in range(3):
                g[column + 3 + a] += by_turn[k, a] * residual[k + 1]
        for k in range(4):
            for a in range(6):
                for c in range(6):
                    H[a, c] += smooth[k, a] * smooth[k, c]
                for c in range(3):
                    both = smooth[k, a] * smooth[k, 3 + c]
                    H[a, column + c] += both
                    H[column + c, a] += both
                    if k > 0:
                        both = smooth[k, a] * by_turn[k - 1, c]
                        H[a, column + 3 + c] += both
                        H[column + 3 + c, a] += both
            for a in range(3):
                for c in range(3):
                    H[column + a, column + c] += smooth[k, 3 + a] * smooth[k, 3 + c]
                    if k > 0:
                        both = smooth[k, 3 + a] * by_turn[k - 1, c]
                        H[column + a, column + 3 + c] += both
                        H[column + 3 + c, column + a] += both
                        H[column + 3 + a, column + 3 + c] += by_turn[k - 1, a] * by_turn[k - 1, c]
    return half


@njit(cache=True, nogil=True)
def refine_modes(  # type: ignore[no-untyped-def]
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
    steps,
    tolerance,
    hessian,
):
    """Moves poses X (B, 3, 4) to minima of their priors (B, 3, 4), (B, m, m) with the contacts: Levenberg-Marquardt.

    Writes each minimum's Hessian (B, m, m) by the increment there and the biases, m = 6 + 6 s.
    """
    size = information.shape[1]
    here, there = np.empty((1, 3, 4)), np.empty((1, 3, 4))
    bias, moved = np.empty(size - 6), np.empty(size - 6)
    g, H = np.empty((1, size)), np.empty((1, size, size))
    g_new, H_new = np.empty((1, size)), np.empty((1, size, size))
    step, damping = np.empty((1, size)), np.empty(1)
    for b in range(X.shape[0]):
        here[0] = X[b]
        bias[:] = 0.0
        damping[0] = 1e-4
        total = _evaluate(
            values,
            origin,
            inverse_spacing,
            p,
            n,
            weight_p,
            weight_n,
            source,
            X_prior[b],
            information[b],
            here,
            bias,
            g[0],
            H[0],
        )
        for _ in range(steps):
            least_squares_kernels.damped_steps(H, g, damping, step)
            promised = 0.0
            for i in range(size):
                promised -= 0.5 * g[0, i] * step[0, i]
            if promised < tolerance:
                break
            pose_kernels.retract(here, step[:, :6], there)
            for i in range(size - 6):
                moved[i] = bias[i] + step[0, 6 + i]
            new = _evaluate(
                values,
                origin,
                inverse_spacing,
                p,
                n,
                weight_p,
                weight_n,
                source,
                X_prior[b],
                information[b],
                there,
                moved,
                g_new[0],
                H_new[0],
            )
            if new < total:
                total, damping[0] = new, 0.1 * damping[0]
                here[0], bias[:], g[0], H[0] = there[0], moved, g_new[0], H_new[0]
            else:
                damping[0] = max(10.0 * damping[0], 1e-2)
        X[b], hessian[b] = here[0], H[0]
