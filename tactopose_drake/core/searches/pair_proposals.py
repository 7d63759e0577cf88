"""Poses proposed by pairs of contacts, and ranked by all contacts."""

import dataclasses

import numpy as np

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.searches.pairs.contact_pairs import PairChoice
from tactopose_drake.core.searches.pairs.distinct_kernels import distinct_poses
from tactopose_drake.core.searches.pairs.pair_poses import MatchedPairs, best_poses, contact_table
from tactopose_drake.core.searches.search import PoseSpace, is_near_prior
from tactopose_drake.core.shape.free_spin import nearest_images
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import FloatArray


@dataclasses.dataclass(frozen=True, eq=False)
class PairProposals:
    """Matches of pairs of contacts with pairs of an object's surface samples, each of which determines a pose.

    Attributes:
        model: the object.
        space: the possible poses.
        matched: the pairs of contacts and their matches.
        table: all contacts, from `contact_table`.
        apart: size of the cells in which poses count as nearly the same, about rad, and m.
    """

    model: ObjectModel
    space: PoseSpace
    matched: MatchedPairs
    table: FloatArray
    apart: tuple[float, float]

    @classmethod
    def match(
        cls,
        model: ObjectModel,
        contacts: Contacts,
        choice: PairChoice,
        space: PoseSpace,
        generator: np.random.Generator,
    ) -> "PairProposals":
        """Looks up matches for pairs of the contacts."""
        offset, bend = choice.offset * model.pair_features.spacing, choice.bend
        table = contact_table(model.coarse_field, contacts, offset, 2.0 * bend)
        return cls(model, space, choice.choose(model.pair_features, contacts, generator), table, (bend, offset))

    def best(self, count: int, but_for_one: int = 0) -> tuple[FloatArray, FloatArray]:
        """Returns at most `count` distinct poses (n, 3, 4) within the space's reach that fit all contacts, best first.

        And at most `but_for_one` that fit all contacts except the one that fits worst.
        """
        model, center, reach = self.model, self.space.center, self.space.reach
        turns = model.symmetry_turns
        if not is_near_prior(self.space):
            reach = np.pi, np.inf  # All poses that put a contact on the surface are within reach.
        if len(model.continuous_symmetries) > 1:
            turns, reach = turns[:1], (np.pi, reach[1])  # A sphere's rotation is always within reach.
        features, field, counts = model.pair_features, model.coarse_field, (count, but_for_one)
        by_all, by_others = best_poses(self.matched, features, field, self.table, counts, center, reach, turns)
        return self._one_of_each(by_all.X_PO), self._one_of_each(by_others.X_PO)

    def _one_of_each(self, X_PO: FloatArray) -> FloatArray:
        """The first of each set of poses (n, 3, 4) that are symmetric images or nearly coincide."""
        model = self.model
        if len(model.symmetry_turns) > 1:
            # The image nearest to the prior; without one, to any fixed pose, so that only one image is left.
            X_PO = nearest_images(X_PO, self.space.center, model.symmetry_turns, model.symmetries)
        return self.distinct(X_PO)

    def distinct(self, X_PO: FloatArray) -> FloatArray:
        """The first in each cell of poses (n, 3, 4)."""
        bend, offset = self.apart
        return X_PO.compress(distinct_poses(X_PO, offset, bend), axis=0)
