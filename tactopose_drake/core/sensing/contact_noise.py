"""Propagation of the errors of wrench and radius to an intrinsic contact: covariances of its point and normal.

With white noise of the moment and the force, the point's error across the force is about that of the moment, plus the
force's noise times the distance from the sensor's origin, over the force: 45 um rms for a push of 1 N on a sphere of
9 mm about a Nano17's origin, and more the longer the lever arm. The contact is an exact function of the wrench, so this
is also the Cramer-Rao bound of an unbiased estimator from one wrench.

On a surface that is thicker than told, the contact is farther out along the force's line of action: under friction, it
is also displaced across the normal, and the normal with it.

Source: [B16] J. Bimbo, thesis, 2016, eqs. 2.2 to 2.4, differentiated.
"""

from typing import Final, NamedTuple

import numpy as np

from tactopose_drake.core.compilation import read_only
from tactopose_drake.core.sensing.contact_noise_kernels import Covariances, Found, WrenchNoise, fill_covariances
from tactopose_drake.core.sensing.intrinsic_contact import ContactSolution, ContactSolutions
from tactopose_drake.core.sensing.soft_layer import SoftLayer
from tactopose_drake.core.surfaces.surface import Surface
from tactopose_drake.core.validation import FloatArray, positive_number

NANO17_SIGMA_MOMENT: Final = 1.0 / 64e3  # N m, the resolution of an ATI Nano17 (calibration SI-12-0.12)
NANO17_SIGMA_FORCE: Final = 1.0 / 320.0  # N


class ContactCovariance(NamedTuple):
    """Covariances of contacts, in S.

    Attributes:
        p: of the contact point, shape (B, 3, 3) or (3, 3), m^2; on a rigid surface of known radius, zero along the
            normal.
        n: of the unit normal, same shape; zero along the normal.
        pn: of the point (rows) and the normal, same shape, m: on a curved surface both move together.
    """

    p: FloatArray
    n: FloatArray
    pn: FloatArray


def contact_covariance(
    contacts: ContactSolution | ContactSolutions,
    surface: Surface,
    *,
    layer: SoftLayer | None = None,
    sigma_moment: float = NANO17_SIGMA_MOMENT,
    sigma_force: float = NANO17_SIGMA_FORCE,
    sigma_radius: float = 0.0,
) -> ContactCovariance:
    """Covariances of the points and normals that `solve_contact(s)` found; NaN for contacts that are not valid.

    Args:
        contacts: solution(s) found on `surface` with `layer`.
        surface: the fingertip's surface.
        layer: soft layer on it, if any.
        sigma_moment: standard deviation of each component of m, N m, >= 0.
        sigma_force: standard deviation of each component of f, N, >= 0.
        sigma_radius: standard deviation of the surface's radius, or of its thickness everywhere alike, m, >= 0.

    Raises:
        InvalidInputError: a sigma below zero or not finite.
    """
    sigma_moment = positive_number("sigma_moment", sigma_moment, allow_zero=True)
    sigma_force = positive_number("sigma_force", sigma_force, allow_zero=True)
    sigma_radius = positive_number("sigma_radius", sigma_radius, allow_zero=True)
    rows = contacts.p_SC, contacts.n_S, contacts.normal_force, contacts.friction_force, contacts.local_torque
    p_SC, n_S, normal_force, friction_force, torque = (read_only(each.reshape(-1, 3)) for each in rows)
    depth, valid = (read_only(np.atleast_1d(each)) for each in (contacts.deformation, contacts.valid))
    found = Found(p_SC, n_S, normal_force, friction_force, torque, depth, valid)
    compliance = 0.0 if layer is None else 1.0 / layer.stiffness
    noise = WrenchNoise(sigma_moment**2, sigma_force**2, sigma_radius**2, compliance)
    filled = Covariances(*np.full((3, len(valid), 3, 3), np.nan))
    fill_covariances(surface.kind, surface.shape, surface.X_SF, found, noise, filled)
    return ContactCovariance(*(each[0] if isinstance(contacts, ContactSolution) else each for each in filled))
