"""The data of each contact from which poses are ranked on the coarse field."""

import numpy as np

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.shape.coarse_field import CoarseField
from tactopose_drake.core.validation import FloatArray


def contact_table(field: CoarseField, contacts: Contacts, sigma_position: float, sigma_normal: float) -> FloatArray:
    """What `pair_lane_kernels.add_cost` reads of each contact, shape (k, 8): point, normal, and two weights.

    The weights are those of the squared distance and the squared difference of normals. The given standard deviations
    are the errors of the poses to be ranked; those of the sensors and of the voxels are added.
    """
    table = np.zeros((len(contacts), 8))
    table[:, :3] = contacts.p_PC
    variance = np.asarray(contacts.sigma_position) ** 2 + sigma_position**2 + field.spacing**2 / 12.0
    table[:, 6] = field.step**2 / variance
    if contacts.n_PC is not None:
        table[:, 3:6] = contacts.n_PC
        table[:, 7] = 1.0 / (np.asarray(contacts.sigma_normal) ** 2 + sigma_normal**2)
    return table
