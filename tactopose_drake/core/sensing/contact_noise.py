"""How far the wrench's noise moves an intrinsic contact: first-order covariances of its point and normal.

With white noise of the moment and the force, the point's error across the force is about that of the moment, plus the
force's noise times the distance from the sensor's origin, over the force: 45 um rms for a push of 1 N on a sphere of
9 mm about a Nano17's origin, and more the longer the lever arm. The contact is an exact function of the wrench, so this
is also the Cramer-Rao bound: no other unbiased estimator from one wrench does better.

Source: [B16] J. Bimbo, thesis, 2016, eqs. 2.2 to 2.4, differentiated.
"""

from typing import Final, NamedTuple

import numpy as np

from tactopose_drake.core.poses import skew
from tactopose_drake.core.sensing.intrinsic_contact import ContactSolution, ContactSolutions
from tactopose_drake.core.sensing.soft_layer import SoftLayer
from tactopose_drake.core.surfaces.surface import Surface
from tactopose_drake.core.validation import FloatArray, positive_number

NANO17_SIGMA_MOMENT: Final = 1.0 / 64e3  # N m, the resolution of an ATI Nano17 (calibration SI-12-0.12)
NANO17_SIGMA_FORCE: Final = 1.0 / 320.0  # N


class ContactCovariance(NamedTuple):
    """Covariances of contacts, in S.

    Attributes:
        p: of the contact point, shape (B, 3, 3) or (3, 3), m^2. On a rigid surface it has no part along the normal.
        n: of the unit normal, same shape; none of it is along the normal.
    """

    p: FloatArray
    n: FloatArray


def contact_covariance(
    contacts: ContactSolution | ContactSolutions,
    surface: Surface,
    *,
    layer: SoftLayer | None = None,
    sigma_moment: float = NANO17_SIGMA_MOMENT,
    sigma_force: float = NANO17_SIGMA_FORCE,
) -> ContactCovariance:
    """Covariances of the points and normals that `solve_contact(s)` found; NaN where a contact is not valid.

    Args:
        contacts: solution(s) found on `surface` with `layer`.
        surface: the fingertip's surface.
        layer: soft layer on it, if there is one.
        sigma_moment: standard deviation of each component of m, N m, >= 0.
        sigma_force: standard deviation of each component of f, N, >= 0.

    Raises:
        InvalidInputError: a sigma below zero or not finite.
    """
    sigma_moment = positive_number("sigma_moment", sigma_moment, allow_zero=True)
    sigma_force = positive_number("sigma_force", sigma_force, allow_zero=True)
    covariance_p, covariance_n = np.full((2, np.size(contacts.valid), 3, 3), np.nan)
    valid = np.atleast_1d(contacts.valid)
    p, n = np.atleast_2d(contacts.p_SC)[valid], np.atleast_2d(contacts.n_S)[valid]
    f_t = np.atleast_2d(contacts.friction_force)[valid]
    f = np.atleast_2d(contacts.normal_force)[valid] + f_t
    torque = _dot(np.atleast_2d(contacts.local_torque)[valid], n)
    depth = np.atleast_1d(contacts.deformation)[valid][:, None, None]
    compliance = 0.0 if layer is None else 1.0 / layer.stiffness

    W = _shape_operator(surface, p + depth[:, 0] * n, n)
    Wf = np.einsum("bij,bj->bi", W, f_t)
    inward = np.eye(3) - depth * W
    # The Jacobian of the residual to a step t on the surface, as in `contact_kernels.linearize`, here as a 3x3 matrix
    # of the tangent plane; n n^T makes it invertible and drops out again in `step`.
    J = _dot(f, n)[:, None, None] * (skew(n) @ inward) - torque[:, None, None] * W
    J -= compliance * _outer(np.cross(n, f_t), Wf)
    nn = _outer(n, n)
    step = -np.linalg.inv(J + nn) @ (np.eye(3) - nn)
    # What noise (dm, df) adds to the residual: dm + by_force df; and to the point at a fixed step: compliance n n^T df
    by_force = -skew(p) - compliance * _outer(np.cross(n, f), n)
    to_point = (inward + compliance * _outer(n, Wf)) @ step
    for covariance, by_moment, own in ((covariance_p, to_point, compliance * nn), (covariance_n, W @ step, 0.0 * nn)):
        force_gain = by_moment @ by_force + own
        covariance[valid] = sigma_moment**2 * _square(by_moment) + sigma_force**2 * _square(force_gain)
    if isinstance(contacts, ContactSolution):
        return ContactCovariance(covariance_p[0], covariance_n[0])
    return ContactCovariance(covariance_p, covariance_n)


def _shape_operator(surface: Surface, q_S: FloatArray, n_S: FloatArray) -> FloatArray:
    """W (B, 3, 3), 1/m, with dn = W t for steps t on the surface at its points q_S (B, 3)."""
    tangent = np.eye(3) - _outer(n_S, n_S)
    length = np.linalg.norm(surface.gradient(q_S), axis=1)
    W: FloatArray = tangent @ surface.hessian(q_S) @ tangent / length[:, None, None]
    return W


def _outer(a: FloatArray, b: FloatArray) -> FloatArray:
    return a[:, :, None] * b[:, None, :]


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    product: FloatArray = np.einsum("bi,bi->b", a, b)
    return product


def _square(A: FloatArray) -> FloatArray:
    product: FloatArray = A @ np.swapaxes(A, -1, -2)
    return product
