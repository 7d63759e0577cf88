"""What an object's mesh may be off, and how it bends, counts among the errors of its contacts."""

import dataclasses

import numpy as np

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
        return dataclasses.replace(contacts, sigma_position=np.sqrt(np.square(contacts.sigma_position) + variance))
    along = np.hypot(_along(contacts.covariance, contacts.n_PC), tangential)
    height, turn = model.unevenness.variances(along)
    covariance = contacts.covariance.copy()
    covariance[:, :3, :3] += (variance + height)[:, None, None] * _outward(contacts)
    covariance[:, 3:, 3:] += turn[:, None, None] * np.eye(3)
    return contacts.with_covariance(covariance)


def _outward(contacts: Contacts) -> FloatArray:
    """n n' of each contact, shape (k, 3, 3); where no normal is known, of all directions."""
    if contacts.n_PC is None:
        return np.broadcast_to(np.eye(3), (len(contacts), 3, 3))
    outward: FloatArray = contacts.n_PC[:, :, None] * contacts.n_PC[:, None, :]
    return outward


def _along(covariance: FloatArray, n_PC: FloatArray | None) -> FloatArray:
    """By how much points are off along each of the surface's tangents, rms, shape (k,), m."""
    point = covariance[:, :3, :3]
    total = np.trace(point, axis1=1, axis2=2)
    outward = total / 3.0 if n_PC is None else np.einsum("ki,kij,kj->k", n_PC, point, n_PC)
    along: FloatArray = np.sqrt(np.maximum(0.5 * (total - outward), 0.0))
    return along
