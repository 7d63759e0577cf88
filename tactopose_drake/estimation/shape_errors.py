"""What an object's mesh may be off, and how it bends, counts among the errors of its contacts."""

import numpy as np

from tactopose_drake.core.evidence.contact_variance_kernels import fill_tangential, widen
from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import FloatArray


def with_shape_errors(model: ObjectModel, contacts: Contacts) -> Contacts:
    """The contacts of an object whose surface is not quite where its mesh has it, and not flat.

    A surface that is off along its normal is, for the pose, a contact that is. By how much a wrong scale moves it
    depends on where the object is touched, |n . (p - middle)|; for the pose is what is asked for, that counts with its
    root mean square over the surface.

    A contact that is off *along* the surface is compared with another place of it, which lies higher or lower and is
    turned. Where covariances say by how much it is off, that counts too, as `Unevenness` has it.

    Args:
        model: the object, with its `surface_sigma` and `scale_sigma`.
        contacts: of the hand's errors alone.
    """
    if not len(contacts) or (contacts.covariance is None and model.surface_sigma == model.scale_sigma == 0.0):
        return contacts
    outward, tangential = (model.scale_sigma * lever for lever in model.growth)
    variance = model.surface_sigma**2 + outward**2
    if contacts.covariance is None:
        return contacts.with_arrays(sigma_position=np.sqrt(np.square(contacts.sigma_position) + variance))
    n_PC = np.zeros((0, 3)) if contacts.n_PC is None else contacts.n_PC
    covariance, along = contacts.covariance.copy(), np.empty(len(contacts))
    fill_tangential(covariance, n_PC, along)
    height, turn = model.unevenness.variances(np.hypot(along, tangential))
    widen(n_PC, variance + height, turn, covariance)
    return contacts.with_covariance(covariance)


def log_dilution(told: Contacts, felt: Contacts) -> float:
    """Logarithm of how many times less dense exact contacts are with an object's errors counted than as told.

    Likelihoods are relative to those of exact contacts. With larger errors these are spread over more places: what is
    less sure of everything explains nothing better, and evidence for objects of unlike errors compares only with that
    counted.

    Args:
        told: of the hand's errors alone.
        felt: what `with_shape_errors` has made of them.
    """
    dilution = np.log(felt.sigma_position) - np.log(told.sigma_position)
    if felt.n_PC is not None:
        # Of a normal the density is at least that of any direction, as in `ContactMixture`.
        dilution += np.log(_share_of_sphere(felt.sigma_normal)) - np.log(_share_of_sphere(told.sigma_normal))
    return float(dilution.sum())


def _share_of_sphere(sigma_normal: FloatArray | float) -> FloatArray:
    return np.minimum(0.5 * np.square(sigma_normal), 1.0)
