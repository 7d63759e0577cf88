"""What an object's mesh may be off, and how it bends, counts among the errors of its contacts."""

import numpy as np

from tactopose_drake.core.evidence.contact_variance_kernels import fill_tangential, widen
from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.shape.object_model import ObjectModel


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
