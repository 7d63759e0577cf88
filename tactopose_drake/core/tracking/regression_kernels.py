"""Statistical linear regression of the contacts' residuals over the spread of a mode, compiled.

A tangent holds at one pose. Over the spread of a mode the surface bends, and facets and edges make the tangent's slope
one of many. The contacts' rows are therefore regressed over sigma points of the mode [G15]: over points x of mean zero
and covariance P, with rows r,

    r = J x + mean + error,    J = cov(r, x) P^-1,    R = I + cov(r) - J P J^T,

where the noise of the whitened rows adds the identity to the error's covariance R. Directions that the contacts do not
determine are axes of the sigma points: neither the other directions' slopes nor their bends leak into them.

The surface's deviation from the slope is not noise: it lasts while the contact does. The caller gets it as roughness,
which belongs to the part of the contacts' errors that is the same at all times.

Source: [G15] A. Garcia-Fernandez et al., Posterior linearization filter: principles and implementation using sigma
points, IEEE Trans. Signal Processing, 2015.
"""

from typing import NamedTuple

import numpy as np

from tactopose_drake.core.compilation import kernel, part
from tactopose_drake.core.kernel_types import Floats1, Floats2, OutFloats1, OutFloats2, OutFloats3
from tactopose_drake.core.kernels import least_squares_kernels, pose_kernels
from tactopose_drake.core.kernels.grid_kernels import Grid
from tactopose_drake.core.kernels.matrix_kernels import cholesky, invert
from tactopose_drake.core.kernels.sorting_kernels import copy_matrix, copy_vector
from tactopose_drake.core.tracking.joint_state_kernels import (
    ContactArrays,
    ModePriors,
    PriorRows,
    add_normal_equations,
    compare_with_prior,
    make_prior_rows,
    transport_information,
)
from tactopose_drake.core.tracking.sigma_point_kernels import (
    SPREAD,
    RegressionSettings,
    SigmaPoints,
    find_axes,
    limit_axes,
    make_sigma_points,
    sample_rows,
    weigh_normals,
)

# Bounds the quotient of squares where a row has neither slope nor bend.
_LEAST_SQUARE = 1e-12


class Regression(NamedTuple):
    """The output for B modes and k contacts.

    Attributes:
        roughness: of the surface around each contact: variances of its distance, m^2, and of its normal about each
            axis, rad^2, shape (B, k, 2).
        covariance: of the increment, shape (B, 6, 6); also input: the spread of the first round.
        cross_covariance: of the increment with the biases, shape (B, 6, m - 6).
    """

    roughness: OutFloats3
    covariance: OutFloats3
    cross_covariance: OutFloats3


class _Scratch(NamedTuple):
    """Scratch for one round.

    Attributes:
        here: the pose, shape (1, 3, 4).
        points: the sigma points about `here`.
        prior: the increment from the prior's pose, and its derivative.
        J: a contact's slopes with respect to the increment and the biases of its source, shape (4, 12).
        mean, R: mean and covariance of its rows, shape (4,) and (4, 4).
        L, W, WJ: the Cholesky factor of R, its inverse, and R^-1 J, shape (4, 4), (4, 4) and (4, 12).
        slope: gradient of the prior's cost, shape (m,).
        g, H, step: gradient, Hessian and step of the joint increment, shape (1, m), (1, m, m), (1, m).
        root, forward: scratch of `damped_step`, shape (m, m), (m,).
    """

    here: OutFloats3
    points: SigmaPoints
    prior: PriorRows
    J: OutFloats2
    mean: OutFloats1
    R: OutFloats2
    L: OutFloats2
    W: OutFloats2
    WJ: OutFloats2
    slope: OutFloats1
    g: OutFloats2
    H: OutFloats3
    step: OutFloats2
    root: OutFloats2
    forward: OutFloats1


@kernel
def regress_modes(
    grid: Grid,
    contacts: ContactArrays,
    priors: ModePriors,
    settings: RegressionSettings,
    X: OutFloats3,
    regression: Regression,
) -> None:
    """Moves poses X (B, 3, 4) to minima of their priors with the contacts, regressed over each mode's own spread.

    Args:
        grid: of the object.
        contacts: of the frame.
        priors: of the modes.
        settings: `RegressionSettings`.
        X: initial poses; the minima are written here.
        regression: `Regression`, output.
    """
    size, count = priors.information.shape[1], contacts.p.shape[0]
    scratch = _make_scratch(size, count)
    points, here, g, H, step = scratch.points, scratch.here, scratch.g, scratch.H, scratch.step
    for b in range(X.shape[0]):
        copy_matrix(X[b], here[0])
        P, C = regression.covariance[b], regression.cross_covariance[b]
        for _ in range(settings.rounds):
            find_axes(P, settings.lever_arm, points)
            limit_axes(here[0], contacts.p, settings.max_displacement, points)
            weigh_normals(grid, contacts, settings, here[0], points, regression.roughness[b])
            sample_rows(grid, contacts, here, points)
            _put_prior(priors.X[b], priors.information[b], scratch)
            for i in range(count):
                _fit_slopes(points, i, settings.bend_penalty, scratch.J, scratch.mean)
                _fit_covariance(points, i, scratch.mean, scratch.R)
                _add_roughness(contacts, i, scratch, regression.roughness[b, i])
                _add_bias_columns(contacts, i, scratch)
                _add_contact(contacts.source[i], scratch)
            least_squares_kernels.damped_step(size, H[0], g[0], 0.0, scratch.root, scratch.forward, step[0])
            _invert_rows(scratch.root, scratch.forward, P, C)
            copy_vector(step[0, :6], points.increment[0])
            pose_kernels.retract(here, points.increment, points.pose)
            copy_matrix(points.pose[0], here[0])
        copy_matrix(here[0], X[b])


@part
def _invert_rows(root: Floats2, x: OutFloats1, P: OutFloats2, C: OutFloats2) -> None:
    """The first six rows P, C of (L L^T)^-1, from L (m, m) whose diagonal holds inverses; x (m,) is scratch."""
    m = root.shape[0]
    for c in range(6):
        for i in range(m):
            s = 1.0 if i == c else 0.0
            for k in range(c, i):
                s -= root[i, k] * x[k]
            x[i] = s * root[i, i]
        for i in range(m - 1, -1, -1):
            s = x[i]
            for k in range(i + 1, m):
                s -= root[k, i] * x[k]
            x[i] = s * root[i, i]
        for i in range(6, m):
            C[c, i - 6] = x[i]
        for i in range(c + 1):
            P[c, i] = P[i, c] = x[i]


@part
def _make_scratch(size: int, count: int) -> _Scratch:
    return _Scratch(
        np.empty((1, 3, 4)),
        make_sigma_points(count),
        make_prior_rows(),
        np.empty((4, 12)),
        np.empty(4),
        np.empty((4, 4)),
        np.empty((4, 4)),
        np.empty((4, 4)),
        np.empty((4, 12)),
        np.empty(size),
        np.empty((1, size)),
        np.empty((1, size, size)),
        np.empty((1, size)),
        np.empty((size, size)),
        np.empty(size),
    )


@part
def _put_prior(X_prior: Floats2, information: Floats2, scratch: _Scratch) -> None:
    """Gradient and Hessian of the prior here, where the biases are at their mean, zero."""
    g, H = scratch.g[0], scratch.H[0]
    compare_with_prior(X_prior, scratch.here, scratch.prior)
    A, z, slope = scratch.prior.jacobian[0], scratch.prior.increment[0], scratch.slope
    for i in range(g.shape[0]):
        slope[i] = 0.0
        for k in range(6):
            slope[i] += information[i, k] * z[k]
        g[i] = slope[i]
    for i in range(6):
        g[i] = 0.0
        for k in range(6):
            g[i] += A[k, i] * slope[k]
    copy_matrix(information, H)
    transport_information(A, H)


@part
def _fit_slopes(points: SigmaPoints, i: int, bend_penalty: float, J: OutFloats2, mean: OutFloats1) -> None:
    """Mean (4,) of the rows of contact i, and their slopes J[:, :6] with respect to the increment.

    Along axis j the slope is the central difference d = (r+ - r-) / 2, per standard deviation. It is multiplied by
    d^2 / (d^2 + penalty c^2), with the bend c = (r+ + r-) / 2 - r0 along the axis: slopes that facets and edges feign
    are about as large as the bends.
    """
    rows = points.rows[:, i]
    for k in range(4):
        mean[k] = 0.0
        for s in range(1, 13):
            mean[k] += rows[s, k] / 12.0
        for c in range(6):
            J[k, c] = 0.0
        for j in range(6):
            out, back = rows[2 * j + 1, k], rows[2 * j + 2, k]
            half = 0.5 * (out - back)
            bend = 0.5 * (out + back) - rows[0, k]
            half *= (
                half * half / (half * half + bend_penalty * bend * bend + _LEAST_SQUARE) / (SPREAD * points.scale[j])
            )
            for c in range(6):
                J[k, c] += half * points.inverse_root[j, c]


@part
def _fit_covariance(points: SigmaPoints, i: int, mean: Floats1, R: OutFloats2) -> None:
    """Covariance R (4, 4) of the rows of contact i: that of the noise, the identity, and of the regression's residuals.

    Only the even part along an axis is counted, which has no slope: the mean of both sides less the mean of all.
    """
    rows = points.rows[:, i]
    for k in range(4):
        for c in range(4):
            R[k, c] = 1.0 if k == c else 0.0
    for j in range(6):
        share = 1.0 / (6.0 * points.scale[j] ** 2)
        for k in range(4):
            left_k = 0.5 * (rows[2 * j + 1, k] + rows[2 * j + 2, k]) - mean[k]
            for c in range(4):
                left_c = 0.5 * (rows[2 * j + 1, c] + rows[2 * j + 2, c]) - mean[c]
                R[k, c] += share * left_k * left_c


@part
def _add_roughness(contacts: ContactArrays, i: int, scratch: _Scratch, roughness: OutFloats1) -> None:
    """Roughness (2,) around contact i: the variance of its rows beyond slope and noise, in m^2 and rad^2."""
    R = scratch.R
    roughness[0] = (R[0, 0] - 1.0) / contacts.weight_p[i] ** 2
    if contacts.weight_n[i] > 0.0:
        roughness[1] += 0.5 * (R[1, 1] + R[2, 2] + R[3, 3] - 3.0) / scratch.points.weight_n[i] ** 2


@part
def _add_bias_columns(contacts: ContactArrays, i: int, scratch: _Scratch) -> None:
    """Slopes J[:, 6:] of contact i with respect to its biases.

    A bias of the position changes the rows as a shift v of the object does. A turn b changes the measured normal by
    b x m, with the expected normal m; as it is removed from the measured normal, the row grows by b x m.
    """
    J = scratch.J
    for k in range(4):
        for c in range(3):
            J[k, 6 + c], J[k, 9 + c] = J[k, 3 + c], 0.0
    if contacts.weight_n[i] > 0.0:
        weight, middle, n = scratch.points.weight_n[i], scratch.points.rows[0, i], contacts.n[i]
        m0, m1, m2 = middle[1] + weight * n[0], middle[2] + weight * n[1], middle[3] + weight * n[2]
        J[1, 10], J[1, 11] = m2, -m1
        J[2, 9], J[2, 11] = -m2, m0
        J[3, 9], J[3, 10] = m1, -m0


@part
def _add_contact(source: int, scratch: _Scratch) -> None:
    """Adds a regressed contact: J^T R^-1 mean to the gradient, J^T R^-1 J to the Hessian."""
    J, mean, W, WJ = scratch.J, scratch.mean, scratch.W, scratch.WJ
    cholesky(4, scratch.R, scratch.L)
    invert(4, scratch.L, W)
    for k in range(4):
        for c in range(12):
            WJ[k, c] = 0.0
            for e in range(4):
                WJ[k, c] += W[k, e] * J[e, c]
    add_normal_equations(source, WJ, J, WJ, mean, scratch.g[0], scratch.H[0])
