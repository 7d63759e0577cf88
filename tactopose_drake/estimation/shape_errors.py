"""Errors of an object's mesh, and the curvature of its surface, as additional noise of contacts."""

import numpy as np

from tactopose_drake.core.evidence.contact_variance_kernels import fill_tangential, widen
from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import FloatArray

# Up to this standard deviation of a point, m, the surface beside it counts as the same if no covariance is told.
_SMALL_SIGMA = 0.001


def with_shape_errors(model: ObjectModel, contacts: Contacts) -> Contacts:
    """The contacts with the object's shape errors added to their noise.

    An error of the surface along its normal affects the pose like an error of the contact. An error of the scale moves
    the surface by an amount that depends on the touched place, |n . (p - middle)|; since the pose is still unknown, its
    root mean square over the surface is used.

    A contact that is displaced *along* the surface is compared with another place, whose height and normal differ. If
    the contacts have covariances, these differences are added, too, as `Unevenness` gives them. Of a `sigma_position`
    they are added for what exceeds a millimetre: a normal known to a degree does not tell the surface's normal to a
    degree if its point is only known to five millimetres.

    Args:
        model: the object, with its `surface_sigma` and `scale_sigma`.
        contacts: contacts whose noise contains only the hand's errors.
    """
    is_exact = contacts.covariance is None and model.surface_sigma == model.scale_sigma == 0.0
    if not len(contacts) or (is_exact and np.max(contacts.sigma_position) <= _SMALL_SIGMA):
        return contacts
    outward, tangential = (model.scale_sigma * lever for lever in model.growth)
    variance = model.surface_sigma**2 + outward**2
    if contacts.covariance is None:
        squared, turned = np.square(contacts.sigma_position), np.square(contacts.sigma_normal)
        along = np.sqrt(np.maximum(squared - _SMALL_SIGMA**2, 0.0))
        if along.any():
            height, turn = model.unevenness.variances(along)
            squared, turned = squared + height, turned + turn
        return contacts.with_arrays(sigma_position=np.sqrt(squared + variance), sigma_normal=np.sqrt(turned))
    n_PC = np.zeros((0, 3)) if contacts.n_PC is None else contacts.n_PC
    covariance, along = contacts.covariance.copy(), np.empty(len(contacts))
    fill_tangential(covariance, n_PC, along)
    height, turn = model.unevenness.variances(np.hypot(along, tangential))
    widen(n_PC, variance + height, turn, covariance)
    return contacts.with_covariance(covariance)


def log_dilution(told: Contacts, felt: Contacts) -> float:
    """Logarithm of the ratio by which an object's shape errors reduce the peak density of contacts.

    Likelihoods are relative to those of exact contacts, whose density is lower the larger the errors are. The evidence
    of objects with different shape errors is comparable only after this correction; otherwise larger errors would
    explain everything better.

    Args:
        told: contacts whose noise contains only the hand's errors.
        felt: the result of `with_shape_errors` for them.
    """
    if felt is told:
        return 0.0
    dilution = np.log(felt.sigma_position) - np.log(told.sigma_position)
    if felt.n_PC is not None:
        # The density of a normal is at least that of the uniform distribution, as in `ContactMixture`.
        dilution += np.log(_share_of_sphere(felt.sigma_normal)) - np.log(_share_of_sphere(told.sigma_normal))
    return float(dilution.sum())


def _share_of_sphere(sigma_normal: FloatArray | float) -> FloatArray:
    return np.minimum(0.5 * np.square(sigma_normal), 1.0)
