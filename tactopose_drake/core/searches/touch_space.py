"""The possible poses if nothing but the touch is known."""

import numpy as np

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.evidence.gaussian_prior import GaussianPrior
from tactopose_drake.core.poses import RANDOM_ROTATION_VARIANCE, make_poses, random_rotations
from tactopose_drake.core.searches.search import PriorSpace
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
        return self.put_in_touch(random_rotations(generator, count), generator)

    def put_in_touch(self, R_PO: FloatArray, generator: np.random.Generator) -> FloatArray:
        """Poses (n, 3, 4) of these rotations (n, 3, 3) that put a random contact on a random surface sample."""
        count = len(R_PO)
        contact = self._p_PC[generator.integers(len(self._p_PC), size=count)]
        point = self._surface.points[generator.integers(len(self._surface), size=count)]
        return make_poses(R_PO, contact - np.einsum("bij,bj->bi", R_PO, point))


class TurnSpace(PriorSpace):
    """The rotations of a prior that does not tell the position, with the translations of `TouchSpace`.

    Attributes:
        center: the prior's pose, its translation moved to where contacts and surface can meet, shape (3, 4).
        information: of the prior's rotations and of the touch's translations, shape (6, 6).
        reach: of the prior's rotations, rad, and of the touch's translations, m.
    """

    def __init__(self, model: ObjectModel, contacts: Contacts, prior: GaussianPrior) -> None:
        super().__init__(prior)
        self._touch = TouchSpace(model, contacts)
        middle, reach = self._touch.center[:, 3], self._touch.reach[1]
        self.center = prior.mean.copy()
        self.center[:, 3] = self.center[:, 3].clip(middle - reach, middle + reach)
        self.information[3:, 3:] = self._touch.information[3:, 3:]
        self.reach = self.reach[0], reach + float(np.linalg.norm(self.center[:, 3] - middle))

    def sample(self, generator: np.random.Generator, count: int) -> FloatArray:
        """Random rotations of the prior that put a random contact on a random surface sample, shape (count, 3, 4)."""
        return self._touch.put_in_touch(super().sample(generator, count)[:, :, :3], generator)
