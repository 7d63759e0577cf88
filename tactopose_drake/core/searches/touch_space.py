"""The possible poses if nothing but the touch is known."""

import numpy as np

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.poses import RANDOM_ROTATION_VARIANCE, make_poses, random_rotations
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import FloatArray


class TouchSpace:
    """All rotations, with the translations that put a contact on the surface.

    Attributes:
        center: rotation identity, with the centroids of contacts and surface on each other, shape (3, 4).
        information: that of a Gaussian as wide as the space, shape (6, 6): the contacts' centroid may lie on any of the
            surface's samples, in any orientation.
        reach: any rotation, rad; the translations, m, at which the contacts and the surface can still meet.
    """

    def __init__(self, model: ObjectModel, contacts: Contacts) -> None:
        self._p_PC, self._surface = contacts.p_PC, model.samples
        # A pose with the identity's rotation and the centres of touch and surface on each other.
        middle_O, arm, variance = self._surface.spread
        middle_P = self._p_PC.mean(axis=0)
        self.center = np.eye(3, 4)
        self.center[:, 3] = middle_P - middle_O
        # Bound on the distance from there to p_PC - R q, for any contact, any rotation and any surface point q.
        spread = np.linalg.norm(self._p_PC - middle_P, axis=1).max()
        self.reach = np.pi, float(spread + arm + np.linalg.norm(middle_O))
        self.information = np.diag(1.0 / np.repeat([RANDOM_ROTATION_VARIANCE, variance], 3))

    def sample(self, generator: np.random.Generator, count: int) -> FloatArray:
        """Random rotations that put a random contact on a random surface sample, shape (count, 3, 4)."""
        R_PO = random_rotations(generator, count)
        contact = self._p_PC[generator.integers(len(self._p_PC), size=count)]
        point = self._surface.points[generator.integers(len(self._surface), size=count)]
        return make_poses(R_PO, contact - np.einsum("bij,bj->bi", R_PO, point))
