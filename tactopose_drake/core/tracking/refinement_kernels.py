"""The most probable pose and biases of a mode, compiled: Levenberg-Marquardt on prior and contacts together.

The cost is half the squared Mahalanobis distance from the prior plus half the squared residuals of the contacts, as in
`surface_contact_kernels.py`, after the biases are subtracted. The Hessian is Gauss-Newton's.

Source: [M63] D. Marquardt, An algorithm for least-squares estimation of nonlinear parameters, J. SIAM, 1963.
"""

from typing import NamedTuple

import numpy as np

from tactopose_drake.core.compilation import inlined, kernel, part
from tactopose_drake.core.kernel_types import Floats2, OutFloats1, OutFloats2, OutFloats3
from tactopose_drake.core.kernels import least_squares_kernels, pose_kernels, surface_contact_kernels
from tactopose_drake.core.kernels.grid_kernels import Grid
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

# Initial damping, and the least after a rejected step: shares of the Hessian's diagonal.
_FIRST_DAMPING, _LEAST_REFUSED_DAMPING = 1e-4, 1e-2


class _Point(NamedTuple):
    """A joint state and the cost's expansion there: pose (1, 3, 4), biases, cost (1,), gradient and Hessian."""

    X: OutFloats3
    bias: OutFloats1
    cost: OutFloats1
    g: OutFloats2
    H: OutFloats3


class _Scratch(NamedTuple):
    """Scratch for one evaluation of the prior and of one contact.

    Attributes:
        prior: the increment from the prior's pose, and its derivative.
        increment: of the pose, shape (1, 6).
        z, slope: the joint increment from the prior, and the gradient of its cost, shape (m,).
        p, n: the contact less its biases, shape (3,).
        residual, J, smooth, work: see `surface_contact_kernels.contact_rows`.
        gradient_rows, hessian_rows: derivatives of the residuals by the increment and the contact's biases, exact and
            along the smoothed surface, shape (4, 12).
    """

    prior: PriorRows
    increment: OutFloats2
    z: OutFloats1
    slope: OutFloats1
    p: OutFloats1
    n: OutFloats1
    residual: OutFloats1
    J: OutFloats2
    smooth: OutFloats2
    work: OutFloats2
    gradient_rows: OutFloats2
    hessian_rows: OutFloats2


@kernel
def refine_modes(
    grid: Grid,
    contacts: ContactArrays,
    priors: ModePriors,
    X: OutFloats3,
    max_iterations: int,
    tolerance: float,
    hessian: OutFloats3,
) -> None:
    """Moves poses X (B, 3, 4) to minima of the cost of their priors and the contacts.

    Args:
        grid: of the object.
        contacts: of the frame.
        priors: of the modes.
        X: initial poses; the minima are written here.
        max_iterations: limit on the steps.
        tolerance: stops when the predicted decrease of the cost is less.
        hessian: output, at the minima, with respect to the joint increment, shape (B, m, m).
    """
    size = priors.information.shape[1]
    here, there, scratch = _make_point(size), _make_point(size), _make_scratch(size)
    step, damping = np.empty((1, size)), np.empty(1)
    for b in range(X.shape[0]):
        copy_matrix(X[b], here.X[0])
        here.bias[:] = 0.0
        _evaluate(grid, contacts, priors, b, here, scratch)
        damping[0] = _FIRST_DAMPING
        for _ in range(max_iterations):
            least_squares_kernels.damped_steps(here.H, here.g, damping, step)
            if least_squares_kernels.promised_decrease(here.g[0], step[0]) < tolerance:
                break
            _move(here, step, scratch.increment, there)
            _evaluate(grid, contacts, priors, b, there, scratch)
            has_fallen = there.cost[0] < here.cost[0]
            damping[0] = least_squares_kernels.next_damping(damping[0], has_fallen, _LEAST_REFUSED_DAMPING)
            if has_fallen:
                _copy(there, here)
        copy_matrix(here.X[0], X[b])
        copy_matrix(here.H[0], hessian[b])


@part
def _make_point(size: int) -> _Point:
    return _Point(np.empty((1, 3, 4)), np.empty(size - 6), np.empty(1), np.empty((1, size)), np.empty((1, size, size)))


@part
def _make_scratch(size: int) -> _Scratch:
    return _Scratch(
        make_prior_rows(),
        np.empty((1, 6)),
        np.empty(size),
        np.empty(size),
        np.empty(3),
        np.empty(3),
        np.empty(5),
        np.empty((5, 6)),
        np.empty((4, 6)),
        np.empty((10, 4)),
        np.empty((4, 12)),
        np.empty((4, 12)),
    )


@kernel
def _move(point: _Point, step: Floats2, increment: OutFloats2, moved: _Point) -> None:
    """Writes the joint state after a step (1, m); also writes the step's pose part into the increment (1, 6)."""
    copy_vector(step[0, :6], increment[0])
    pose_kernels.retract(point.X, increment, moved.X)
    for i in range(point.bias.shape[0]):
        moved.bias[i] = point.bias[i] + step[0, 6 + i]


@part
def _copy(source: _Point, target: _Point) -> None:
    copy_matrix(source.X[0], target.X[0])
    copy_vector(source.bias, target.bias)
    target.cost[0] = source.cost[0]
    copy_vector(source.g[0], target.g[0])
    copy_matrix(source.H[0], target.H[0])


@kernel
def _evaluate(
    grid: Grid, contacts: ContactArrays, priors: ModePriors, b: int, point: _Point, scratch: _Scratch
) -> None:
    """Cost, gradient and Hessian of prior b and the contacts at a point.

    Where the surface's normals spread, as at an edge, they have less weight. The normalisation of this wider density is
    not in the cost: an edge is no less likely to be touched than the surface beside it.
    """
    _put_prior(priors.X[b], priors.information[b], point, scratch)
    for i in range(contacts.p.shape[0]):
        _remove_bias(contacts, i, point.bias, scratch)
        _contact_rows(grid, contacts.weight_p[i], contacts.weight_n[i], point.X[0], scratch)
        for k in range(4):
            point.cost[0] += 0.5 * scratch.residual[k] * scratch.residual[k]
        gradient_rows, rows = scratch.gradient_rows, scratch.hessian_rows
        add_normal_equations(contacts.source[i], gradient_rows, rows, rows, scratch.residual, point.g[0], point.H[0])


@inlined
def _put_prior(X_prior, information, point, scratch):
    """Cost z^T I z / 2 of the prior, with z = (increment from its pose, biases); gradient and Hessian by chain rule."""
    z, slope, g = scratch.z, scratch.slope, point.g[0]
    compare_with_prior(X_prior, point.X, scratch.prior)
    copy_vector(scratch.prior.increment[0], z[:6])
    copy_vector(point.bias, z[6:])
    point.cost[0] = 0.0
    for i in range(z.shape[0]):
        slope[i] = 0.0
        for j in range(z.shape[0]):
            slope[i] += information[i, j] * z[j]
        point.cost[0] += 0.5 * z[i] * slope[i]
    A = scratch.prior.jacobian[0]
    copy_vector(slope, g)
    for i in range(6):
        g[i] = 0.0
        for k in range(6):
            g[i] += A[k, i] * slope[k]
    copy_matrix(information, point.H[0])
    transport_information(A, point.H[0])


@inlined
def _remove_bias(contacts, i, bias, scratch):
    """The contact i less the biases of its source: its point less their shift, its normal n less their turn x n."""
    n, at = contacts.n[i], 6 * contacts.source[i]
    for a in range(3):
        scratch.p[a] = contacts.p[i, a] - bias[at + a]
    x, y, z = bias[at + 3], bias[at + 4], bias[at + 5]
    scratch.n[0] = n[0] - (y * n[2] - z * n[1])
    scratch.n[1] = n[1] - (z * n[0] - x * n[2])
    scratch.n[2] = n[2] - (x * n[1] - y * n[0])


@inlined
def _contact_rows(grid, weight_p, weight_n, X, scratch):
    """Residuals of the contact in the scratch at the pose X (3, 4), and their derivatives by increment and biases.

    A bias of the position shifts the contact: the derivatives are those with respect to v. Correcting for a
    turn b changes the measured normal in O, m = R^T n, by R^T (n x b), and the normal's residual by -R^T [n]x b: a row
    is the cross product of an axis of O, expressed in P, with n.
    """
    n, exact, smooth = scratch.n, scratch.gradient_rows, scratch.hessian_rows
    rows = surface_contact_kernels.Rows(scratch.residual, scratch.J, scratch.smooth, scratch.work)
    surface_contact_kernels.contact_rows(grid, scratch.p, n, weight_p, weight_n, X, rows)
    for k in range(4):
        for c in range(6):
            exact[k, c], smooth[k, c] = scratch.J[k, c], scratch.smooth[k, c]
        for c in range(3):
            exact[k, 6 + c], smooth[k, 6 + c] = scratch.J[k, 3 + c], scratch.smooth[k, 3 + c]
            exact[k, 9 + c] = smooth[k, 9 + c] = 0.0
    if weight_n > 0.0:
        mean_field = scratch.work[4]
        weight, _ = surface_contact_kernels.normal_weight(mean_field, weight_n)
        for a in range(3):
            r0, r1, r2 = X[0, a], X[1, a], X[2, a]
            exact[1 + a, 9] = smooth[1 + a, 9] = -weight * (r1 * n[2] - r2 * n[1])
            exact[1 + a, 10] = smooth[1 + a, 10] = -weight * (r2 * n[0] - r0 * n[2])
            exact[1 + a, 11] = smooth[1 + a, 11] = -weight * (r0 * n[1] - r1 * n[0])
