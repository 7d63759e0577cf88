"""Sigma points of a mode, compiled, and the contacts' residuals at each.

The points lie along the principal axes of the mode's covariance, so that a direction that the contacts do not determine
is one of these axes: a cubature rule of 2 d points in d = 6 dimensions [A09].

Source: [A09] I. Arasaratnam and S. Haykin, Cubature Kalman filters, IEEE Trans. Automatic Control, 2009.
"""

from typing import NamedTuple

import numpy as np

from tactopose_drake.core.compilation import part
from tactopose_drake.core.kernel_types import Floats1, Floats2, Floats3, OutFloats1, OutFloats2, OutFloats3
from tactopose_drake.core.kernels import grid_kernels, pose_kernels
from tactopose_drake.core.kernels.grid_kernels import Grid
from tactopose_drake.core.kernels.matrix_kernels import diagonalize
from tactopose_drake.core.tracking.joint_state_kernels import ContactArrays

# Distance of the sigma points in standard deviations: the root of the number of dimensions. [A09]
SPREAD = 2.449489742783178
# The least variance along an axis, m^2.
_LEAST_VARIANCE = 1e-16


class RegressionSettings(NamedTuple):
    """The numbers of `ContactUpdateParams` that the regression uses; see there.

    Attributes:
        lever_arm: m per rad.
        max_displacement: of the contacts by a sigma point, root mean square, m.
        rounds: of the regression of a mode.
        bend_penalty: weight of the squared bend by which a slope is reduced.
        lasting_share, new_share: parts of the spread of normals around a contact that last, and that are new each time.
    """

    lever_arm: float
    max_displacement: float
    rounds: int
    bend_penalty: float
    lasting_share: float
    new_share: float


class SigmaPoints(NamedTuple):
    """The centre, and two points on each of six axes: in positive direction at 2 j + 1, in negative at 2 j + 2.

    Attributes:
        root: a square root of the covariance, whose columns are the axes, shape (6, 6).
        inverse_root: its inverse, shape (6, 6).
        scale: factor by which each axis is shortened, shape (6,).
        increment: scratch, shape (1, 6).
        pose: scratch, shape (1, 3, 4).
        weight_n: one over the standard deviations of the normals' differences, shape (k,).
        rows: whitened residuals of each contact at each point, shape (13, k, 4).
    """

    root: OutFloats2
    inverse_root: OutFloats2
    scale: OutFloats1
    increment: OutFloats2
    pose: OutFloats3
    weight_n: OutFloats1
    rows: OutFloats3


@part
def make_sigma_points(count: int) -> SigmaPoints:
    """Allocates the sigma points of a mode for `count` contacts."""
    return SigmaPoints(
        np.empty((6, 6)),
        np.empty((6, 6)),
        np.empty(6),
        np.empty((1, 6)),
        np.empty((1, 3, 4)),
        np.empty(count),
        np.empty((13, count, 4)),
    )


@part
def find_axes(P: Floats2, lever_arm: float, points: SigmaPoints) -> None:
    """Finds a root of the covariance P (6, 6) whose columns are its principal axes.

    The axes are principal with rotations multiplied by the lever arm, m: with S = diag(1 / arm, 1), and eigenvectors V
    and variances of S^-1 P S^-1, the root is S V diag(deviations).
    """
    root, inverse_root = points.root, points.inverse_root
    scaled, variances, rows = np.empty((6, 6)), np.empty(6), np.empty((6, 6))
    for i in range(6):
        for j in range(6):
            scaled[i, j] = 0.5 * (P[i, j] + P[j, i]) * (lever_arm if i < 3 else 1.0) * (lever_arm if j < 3 else 1.0)
    diagonalize(scaled, variances, rows)
    for j in range(6):
        deviation = np.sqrt(max(variances[j], _LEAST_VARIANCE))
        for i in range(6):
            unit = lever_arm if i < 3 else 1.0
            root[i, j] = rows[j, i] * deviation / unit
            inverse_root[j, i] = rows[j, i] / deviation * unit


@part
def limit_axes(X: Floats2, p: Floats2, max_displacement: float, points: SigmaPoints) -> None:
    """Shortens each axis so that its sigma points displace the contacts p (k, 3) by at most this root mean square, m.

    A point q of O moves in O by w x q + R^T v.
    """
    root, q = points.root, np.empty(3)
    for j in range(6):
        square = 0.0
        for i in range(p.shape[0]):
            pose_kernels.to_object(X, p[i], q)
            for a in range(3):
                c, d = (a + 1) % 3, (a + 2) % 3
                moved = root[c, j] * q[d] - root[d, j] * q[c]
                for k in range(3):
                    moved += X[k, a] * root[3 + k, j]
                square += moved * moved
        displacement = SPREAD * np.sqrt(square / p.shape[0])
        points.scale[j] = 1.0 if displacement < max_displacement else max_displacement / displacement


@part
def weigh_normals(
    grid: Grid,
    contacts: ContactArrays,
    settings: RegressionSettings,
    X: Floats2,
    points: SigmaPoints,
    roughness: OutFloats2,
) -> None:
    """The normals' weights (k,) at the centre X (3, 4), and the contribution of their spread to the roughness (k, 2).

    The more unit vectors spread, the shorter is their mean: 1 - |n|^2 is the variance of the normals around a contact.
    """
    q, mean = np.empty(3), np.empty(4)
    for i in range(contacts.p.shape[0]):
        weight = contacts.weight_n[i]
        if weight > 0.0:
            pose_kernels.to_object(X, contacts.p[i], q)
            grid_kernels.look_up(grid, q[0], q[1], q[2], mean)
            spread = max(0.0, 1.0 - (mean[1] ** 2 + mean[2] ** 2 + mean[3] ** 2))
            points.weight_n[i] = weight / np.sqrt(1.0 + settings.new_share * spread * weight**2)
            roughness[i, 1] = settings.lasting_share * spread


@part
def sample_rows(grid: Grid, contacts: ContactArrays, X: Floats3, points: SigmaPoints) -> None:
    """The rows at the sigma points: at the centre X (1, 3, 4), and then in both directions along each axis."""
    _find_rows(grid, contacts, points.weight_n, X[0], points.rows[0])
    increment = points.increment
    for s in range(1, 13):
        j = (s - 1) // 2
        sign = 1.0 if s % 2 else -1.0
        for i in range(6):
            increment[0, i] = sign * SPREAD * points.scale[j] * points.root[i, j]
        pose_kernels.retract(X, increment, points.pose)
        _find_rows(grid, contacts, points.weight_n, points.pose[0], points.rows[s])


@part
def _find_rows(grid: Grid, contacts: ContactArrays, weight_n: Floats1, X: Floats2, rows: OutFloats2) -> None:
    """The whitened rows (k, 4) of the contacts at a pose: distance, and the expected normal less the measured, in P.

    In P their slope is that of the expected normal alone. In O, the measured normal would rotate with the object, and
    so would its error, whose square would then count as information.
    """
    q, mean = np.empty(3), np.empty(4)
    for i in range(contacts.p.shape[0]):
        pose_kernels.to_object(X, contacts.p[i], q)
        grid_kernels.look_up(grid, q[0], q[1], q[2], mean)
        rows[i, 0] = mean[0] * contacts.weight_p[i]
        for k in range(3):
            rows[i, 1 + k] = 0.0
        if contacts.weight_n[i] > 0.0:
            square = mean[1] ** 2 + mean[2] ** 2 + mean[3] ** 2
            length = np.sqrt(square + grid_kernels.SOFT_LENGTH**2)
            for k in range(3):
                normal = X[k, 0] * mean[1] + X[k, 1] * mean[2] + X[k, 2] * mean[3]
                rows[i, 1 + k] = (normal / length - contacts.n[i, k]) * weight_n[i]
