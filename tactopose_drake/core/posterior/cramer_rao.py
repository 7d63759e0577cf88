"""The Cramer-Rao bound: how accurately any estimator can know an object's pose from a grasp.

The residuals' noise is white by construction, so the information of a touch is J^T J, with J the Jacobian of the
residuals with respect to the pose increment, at the true pose [K93]. A Gaussian prior adds its own information (the
Bayesian bound of [V68]). The variance of a linear function a^T u of the increment u is at least a^T (J^T J)^-1 a; it is
infinite where a has a component along a direction in which the object can move without changing the touch.

Sources: [K93] S. Kay, Fundamentals of Statistical Signal Processing: Estimation Theory, 1993, eqs. 3.20 and 3.30;
[V68] H. Van Trees, Detection, Estimation, and Modulation Theory, part I, 1968, section 2.4.3.
"""

import dataclasses

import numpy as np
from numpy.typing import ArrayLike

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.evidence.gaussian_prior import GaussianPrior
from tactopose_drake.core.geometry_checks import pose_matrix
from tactopose_drake.core.objectives.surface_contact import SurfaceContact
from tactopose_drake.core.posterior.modes import determined_part, free_directions
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import FloatArray, finite_array
from tactopose_drake.errors import TooFewContactsError

# A function of the increment involves the free directions when more than this share of it lies along them.
_NOTICEABLE = 1e-6


@dataclasses.dataclass(frozen=True, eq=False)
class CramerRaoBound:
    """The least covariance of the increment (w, v) that an unbiased estimator can have, rad and m.

    Attributes:
        information: Fisher information of touch and prior, shape (6, 6).
        free_directions: increments that the touch does not determine (see `hypotheses.free_directions`), orthonormal
            rows (f, 6). Along them the pose is known by the prior alone, or, without one, not at all.
        covariance: the bound, shape (6, 6). Without a prior it is that of the increment's determined part: zero along
            the free directions, where the variance is infinite, as `variance` and `sigmas` say.
        has_prior: whether a prior bounds the free directions too.
    """

    information: FloatArray
    free_directions: FloatArray
    covariance: FloatArray
    has_prior: bool

    def variance(self, function: ArrayLike) -> float:
        """The least variance of a linear function a^T u of the increment u, given as a, shape (6,); may be infinite.

        Raises:
            InvalidInputError: a shape that does not fit, or a number that is not finite.
        """
        a = finite_array("function", function, (6,))
        along_free = np.linalg.norm(self.free_directions @ a) if len(self.free_directions) else 0.0
        if not self.has_prior and along_free > _NOTICEABLE * np.linalg.norm(a):
            return float("inf")
        return float(a @ self.covariance @ a)

    @property
    def sigmas(self) -> FloatArray:
        """The least standard deviations of the six increments, shape (6,), rad and m; infinite where undetermined."""
        return np.sqrt([self.variance(row) for row in np.eye(6)])

    @property
    def rms_rotation(self) -> float:
        """The least root mean square of the rotation's error, rad; infinite where a part of it is undetermined."""
        return float(np.linalg.norm(self.sigmas[:3]))

    @property
    def rms_translation(self) -> float:
        """The least root mean square of the translation's error, m; infinite where a part of it is undetermined."""
        return float(np.linalg.norm(self.sigmas[3:]))


def cramer_rao_bound(
    model: ObjectModel, contacts: Contacts, X_PO: ArrayLike, prior: GaussianPrior | None = None
) -> CramerRaoBound:
    """The bound for the object at the true pose X_PO, touched as the contacts say.

    Args:
        model: the object.
        contacts: where it is touched and how well that is measured, in P. The noise-free points and normals give the
            bound itself; measured ones an estimate of it.
        X_PO: the true pose, shape (3, 4) or (4, 4), or a RigidTransform.
        prior: what is known without the touch.

    Raises:
        TooFewContactsError: no contact.
        InvalidInputError: if a pose is invalid.
    """
    if len(contacts) < 1:
        raise TooFewContactsError("contacts must be at least 1 for the bound, not 0.")
    X_true = pose_matrix("X_PO", X_PO)
    touch = SurfaceContact(model.grid, contacts).normal_equations(X_true[None]).hessian[0]
    free = free_directions(touch[None], model.size)[0]
    if prior is not None:
        information = touch + np.diag(1.0 / prior.sigmas**2)
        return CramerRaoBound(information, free, np.linalg.inv(information), True)
    # Invert on the remaining directions, as many as the information has rank.
    basis = np.linalg.svd(determined_part(np.eye(6), free, model.size), full_matrices=False)[2][: 6 - len(free)]
    covariance = basis.T @ np.linalg.inv(basis @ touch @ basis.T) @ basis
    return CramerRaoBound(touch, free, covariance, False)
