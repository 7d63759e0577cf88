"""Covariances of intrinsic contacts, compiled; see `contact_noise.py`."""

from typing import NamedTuple

import numpy as np

from tactopose_drake.core.compilation import inlined, kernel, part
from tactopose_drake.core.kernel_types import Flags1, Floats1, Floats2, OutFloats1, OutFloats2, OutFloats3
from tactopose_drake.core.kernels.matrix_kernels import multiply, transform
from tactopose_drake.core.surfaces.surface_kernels import evaluate_one


class Found(NamedTuple):
    """Contacts in S of B wrenches, read-only.

    Points, normals, normal and friction forces and local torques (B, 3), deformations (B,), and validity (B,).
    """

    p: Floats2
    n: Floats2
    normal_force: Floats2
    friction_force: Floats2
    torque: Floats2
    depth: Floats1
    valid: Flags1


class WrenchNoise(NamedTuple):
    """Variances of each moment, (N m)^2, and force, N^2, and of the radius, m^2; the layer's compliance, m/N."""

    moment: float
    force: float
    radius: float
    compliance: float


class Covariances(NamedTuple):
    """Output: covariances of the points (B, 3, 3), of the normals, and of the points (rows) with the normals."""

    point: OutFloats3
    normal: OutFloats3
    both: OutFloats3


class SensedContact(NamedTuple):
    """A contact's point and the fingertip's normal there, in S, shape (3,), and their covariances.

    These are due to the sensor's noise and the radius: of the point, of the normal, and of the point (rows) with the
    normal, shape (3, 3).
    """

    p: Floats1
    n: Floats1
    by_point: Floats2
    by_normal: Floats2
    by_both: Floats2


class HandVariances(NamedTuple):
    """Variances of a fingertip's position, m^2, and rotation, rad^2, by axis."""

    place: float
    turn: float


class _Work(NamedTuple):
    """Scratch vectors (3,) and matrices (3, 3)."""

    g: OutFloats1
    A: OutFloats2
    B: OutFloats2
    W: OutFloats2
    step: OutFloats2
    gain: OutFloats2
    product: OutFloats2
    of_point: OutFloats2
    of_point_by_force: OutFloats2


@kernel
def fill_covariances(
    kind: int,
    shape: Floats1,
    X_SF: Floats2,
    found: Found,
    noise: WrenchNoise,
    out: Covariances,
) -> None:
    """Fills the covariances of the valid contacts' points and normals, in S."""
    square = (3, 3)
    work = _Work(
        np.empty(3),
        np.empty(square),
        np.empty(square),
        np.empty(square),
        np.empty(square),
        np.empty(square),
        np.empty(square),
        np.empty(square),
        np.empty(square),
    )
    f, across, bent, by_force = np.empty(3), np.empty(3), np.empty(3), np.empty((3, 3))
    W, step, gain = work.W, work.step, work.gain
    for b in range(found.valid.shape[0]):
        if not found.valid[b]:
            continue
        p, n, f_t, depth = found.p[b], found.n[b], found.friction_force[b], found.depth[b]
        _bend(kind, shape, X_SF, p, n, depth, work)
        push, torque = 0.0, 0.0
        for i in range(3):
            f[i] = found.normal_force[b, i] + f_t[i]
            push += f[i] * n[i]
            torque += found.torque[b, i] * n[i]
            bent[i] = W[i, 0] * f_t[0] + W[i, 1] * f_t[1] + W[i, 2] * f_t[2]
        _cross(n, f, across)  # The normal force's part of the product vanishes.
        # The Jacobian of the residual by a step t on the surface, as in `contact_newton_kernels.linearize`, here as a
        # matrix of the tangent plane; n n^T makes it invertible and cancels in `step`.
        J = work.A
        for k in range(3):
            for i in range(3):
                work.B[i, k] = (1.0 if i == k else 0.0) - depth * W[i, k]
            _cross(n, work.B[:, k], work.g)
            for i in range(3):
                J[i, k] = push * work.g[i] - torque * W[i, k] - noise.compliance * across[i] * bent[k] + n[i] * n[k]
        _invert_plane(J, n, step)
        # The derivative of the residual by noise (dm, df) is dm + by_force df; then that of the point at a fixed step.
        _fill_lever(p, across, n, noise.compliance, by_force)
        for i in range(3):
            for k in range(3):
                work.B[i, k] += noise.compliance * n[i] * bent[k]
        # The derivatives of the point and the normal by moment and force; the force moves the point along n, too.
        multiply(work.B, step, work.of_point)
        multiply(work.of_point, by_force, work.of_point_by_force)
        for i in range(3):
            for k in range(3):
                work.of_point_by_force[i, k] += noise.compliance * n[i] * n[k]
        multiply(W, step, gain)
        multiply(gain, by_force, work.product)
        _add_noise(work.of_point, work.of_point_by_force, work.of_point, work.of_point_by_force, noise, out.point[b])
        _add_noise(gain, work.product, gain, work.product, noise, out.normal[b])
        _add_noise(work.of_point, work.of_point_by_force, gain, work.product, noise, out.both[b])
        _add_radius(n, across, noise.radius, work, out.point[b], out.normal[b], out.both[b])


@kernel
def fill_hand_covariance(
    X: Floats2, contact: SensedContact, by_joints: Floats2, errors: HandVariances, out: OutFloats2
) -> None:
    """Fills the covariance (6, 6) of a contact's point and of a small rotation of its normal, in P.

    Args:
        X: X_PS, shape (3, 4).
        contact: the contact from the sensor.
        by_joints: rotation and displacement of the contact by one standard deviation of each joint's offset, shape
            (6, k).
        errors: variances of the fingertip's pose.
        out: output.
    """
    p, n, by_point, by_normal, by_both = contact
    R, turned, rotation = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    a, m = np.empty(3), np.empty(3)
    for i in range(3):
        a[i], m[i] = 0.0, 0.0
        for k in range(3):
            R[i, k] = X[i, k]
            a[i] += X[i, k] * p[k]
            m[i] += X[i, k] * n[k]
    for i in range(6):
        for k in range(i + 1):
            out[i, k] = 0.0
            for c in range(by_joints.shape[1]):
                out[i, k] += by_joints[(i + 3) % 6, c] * by_joints[(k + 3) % 6, c]
    # A rotation w of the fingertip moves the point, at a from S, by w x a.
    square = a[0] * a[0] + a[1] * a[1] + a[2] * a[2]
    for i in range(3):
        out[i, i] += errors.place + errors.turn * square
        out[3 + i, 3 + i] += errors.turn
        out[3 + i, (i + 1) % 3] -= errors.turn * a[(i + 2) % 3]
        out[3 + i, (i + 2) % 3] += errors.turn * a[(i + 1) % 3]
        for k in range(i + 1):
            out[i, k] -= errors.turn * a[i] * a[k]
    transform(R, by_point, turned, rotation)
    for i in range(3):
        for k in range(i + 1):
            out[i, k] += rotation[i, k]
    # A change dn of the normal is a rotation by n x dn.
    for c in range(3):
        _cross(m, R[:, c], a)
        for i in range(3):
            turned[i, c] = a[i]
    for i in range(3):
        for k in range(3):
            for c in range(3):
                for d in range(3):
                    out[3 + i, k] += turned[i, c] * by_both[d, c] * R[k, d]
    transform(turned, by_normal, R, rotation)
    for i in range(3):
        for k in range(i + 1):
            out[3 + i, 3 + k] += rotation[i, k]
    for i in range(6):
        for k in range(i):
            out[k, i] = out[i, k]


@part
def _bend(kind: int, shape: Floats1, X: Floats2, p: Floats1, n: Floats1, depth: float, work: _Work) -> None:
    """W, 1/m, with dn = W t for steps t on the undeformed surface at the contact; X (3, 4) is X_SF."""
    g, A, B, W = work.g, work.A, work.B, work.W
    for i in range(3):
        g[i] = p[i] + depth * n[i] - X[i, 3]
    x = X[0, 0] * g[0] + X[1, 0] * g[1] + X[2, 0] * g[2]
    y = X[0, 1] * g[0] + X[1, 1] * g[1] + X[2, 1] * g[2]
    z = X[0, 2] * g[0] + X[1, 2] * g[1] + X[2, 2] * g[2]
    evaluate_one(kind, shape, x, y, z, g, A)
    length = np.sqrt(g[0] * g[0] + g[1] * g[1] + g[2] * g[2])
    # (1 - n n^T) R, which transforms the Hessian in F to W in S.
    for k in range(3):
        along = n[0] * X[0, k] + n[1] * X[1, k] + n[2] * X[2, k]
        for i in range(3):
            B[i, k] = X[i, k] - n[i] * along
    transform(B, A, work.product, W)
    for i in range(3):
        for k in range(3):
            W[i, k] /= length


@inlined
def _invert_plane(J, n, step):
    """step = -J^-1 (1 - n n^T), from J's cofactors."""
    for i in range(3):
        a, b = (i + 1) % 3, (i + 2) % 3
        for k in range(3):
            c, d = (k + 1) % 3, (k + 2) % 3
            step[k, i] = J[a, c] * J[b, d] - J[a, d] * J[b, c]
    determinant = J[0, 0] * step[0, 0] + J[0, 1] * step[1, 0] + J[0, 2] * step[2, 0]
    for i in range(3):
        along = step[i, 0] * n[0] + step[i, 1] * n[1] + step[i, 2] * n[2]
        for k in range(3):
            step[i, k] = (along * n[k] - step[i, k]) / determinant


@inlined
def _fill_lever(p, across, n, compliance, out):
    """-[p]x - compliance (n x f) n^T."""
    for i in range(3):
        a, b = (i + 1) % 3, (i + 2) % 3
        out[i, i], out[i, a], out[i, b] = 0.0, p[b], -p[a]
    for i in range(3):
        for k in range(3):
            out[i, k] -= compliance * across[i] * n[k]


@part
def _add_noise(
    moment: Floats2, force: Floats2, other_moment: Floats2, other_force: Floats2, noise: WrenchNoise, out: OutFloats2
) -> None:
    """The covariance of two quantities with these gains for the noise of moment and force."""
    for i in range(3):
        for k in range(3):
            by_moment, by_force = 0.0, 0.0
            for c in range(3):
                by_moment += moment[i, c] * other_moment[k, c]
                by_force += force[i, c] * other_force[k, c]
            out[i, k] = noise.moment * by_moment + noise.force * by_force


@part
def _add_radius(
    n: Floats1, across: Floats1, variance: float, work: _Work, point: OutFloats2, normal: OutFloats2, both: OutFloats2
) -> None:
    """Adds those by the radius: a surface that is thicker by d moves points by d n, and a moment d n x f is lacking."""
    moved, changed = work.g, work.step[0]
    for i in range(3):
        moved[i], changed[i] = n[i], 0.0
        for k in range(3):
            moved[i] -= work.of_point[i, k] * across[k]
            changed[i] -= work.gain[i, k] * across[k]
    for i in range(3):
        for k in range(3):
            point[i, k] += variance * moved[i] * moved[k]
            normal[i, k] += variance * changed[i] * changed[k]
            both[i, k] += variance * moved[i] * changed[k]


@inlined
def _cross(a, b, out):
    out[0], out[1], out[2] = a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
