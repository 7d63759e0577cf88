"""What the judgement of poses on the coarse field reads of each contact."""

import numpy as np

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.shape.coarse_field import CoarseField
from tactopose_drake.core.validation import FloatArray


def contact_table(field: CoarseField, contacts: Contacts, sigma_position: float, sigma_normal: float) -> FloatArray:
    """What `pair_lane_kernels.add_cost` reads of each contact, shape (k, 8): point, normal, weights of their squares.

    The standard deviations say how far off the poses are that will be judged; the sensors' own and the voxels' are
    added.
    """
    table = np.zeros((len(contacts), 8))
    table[:, :3] = contacts.p_PC
    variance = np.asarray(contacts.sigma_position) ** 2 + sigma_position**2 + field.spacing**2 / 12.0
    table[:, 6] = field.step**2 / variance
    if contacts.n_PC is not None:
        table[:, 3:6] = contacts.n_PC
        table[:, 7] = 1.0 / (np.asarray(contacts.sigma_normal) ** 2 + sigma_normal**2)
    return table
