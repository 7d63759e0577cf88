"""What an object's mesh may be off counts among the errors of its contacts."""

import dataclasses

import numpy as np

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.shape.object_model import ObjectModel


def with_shape_errors(model: ObjectModel, contacts: Contacts) -> Contacts:
    """The contacts of an object whose surface is not quite where its mesh has it.

    A surface that is off along its normal is, for the pose, a contact that is. By how much a wrong scale moves it
    depends on where the object is touched, |n . (p - middle)|; for the pose is what is asked for, that counts with its
    root mean square over the surface.

    Args:
        model: the object, with its `surface_sigma` and `scale_sigma`.
        contacts: of the hand's errors alone.
    """
    variance = model.surface_sigma**2 + (model.scale_sigma * model.normal_lever) ** 2
    if variance == 0.0 or not len(contacts):
        return contacts
    if contacts.covariance is None:
        return dataclasses.replace(contacts, sigma_position=np.sqrt(np.square(contacts.sigma_position) + variance))
    n_PC = contacts.n_PC
    along = np.broadcast_to(np.eye(3), (len(contacts), 3, 3)) if n_PC is None else n_PC[:, :, None] * n_PC[:, None, :]
    covariance = contacts.covariance.copy()
    covariance[:, :3, :3] += variance * along
    return dataclasses.replace(contacts, covariance=covariance)
