"""The poses that pairs of contacts propose, which any number of contacts judge."""

import dataclasses

import numpy as np

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.searches.pairs.contact_pairs import PairChoice
from tactopose_drake.core.searches.pairs.contact_tables import contact_table
from tactopose_drake.core.searches.pairs.distinct import distinct_poses
from tactopose_drake.core.searches.pairs.pair_poses import MatchedPairs, best_poses
from tactopose_drake.core.searches.search import PoseSpace, is_near
from tactopose_drake.core.shape.free_spin import nearest_images
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import FloatArray


@dataclasses.dataclass(frozen=True, eq=False)
class PairProposals:
    """Matches of pairs of contacts with pairs of an object's surface samples, each of which lays the object somewhere.

    Attributes:
        model: the object.
        space: where it may be.
        matched: the pairs of contacts, and what they match.
        table: all contacts, from `contact_table`.
        apart: the size of the cells in which poses nearly coincide, about rad, and m.
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
        """Looks pairs of the contacts up."""
        offset, bend = choice.offset * model.pair_features.spacing, choice.bend
        table = contact_table(model.coarse_field, contacts, offset, 2.0 * bend)
        return cls(model, space, choice.choose(model.pair_features, contacts, generator), table, (bend, offset))

    def best(self, count: int, but_for_one: int = 0) -> tuple[FloatArray, FloatArray]:
        """So many distinct poses (n, 3, 4), at most, within the space's reach that suit all contacts, the best first.

        And so many that suit all but one, whichever each suits least.
        """
        model, center, reach = self.model, self.space.center, self.space.reach
        turns = model.symmetry_turns
        if not is_near(self.space):
            reach = np.pi, np.inf  # All poses that lay a contact on the surface are within reach.
        if len(model.continuous_symmetries) > 1:
            turns, reach = turns[:1], (np.pi, reach[1])  # A sphere's rotation is always within reach.
        features, field, counts = model.pair_features, model.coarse_field, (count, but_for_one)
        by_all, by_others = best_poses(self.matched, features, field, self.table, counts, center, reach, turns)
        return self._one_of_each(by_all.X_PO), self._one_of_each(by_others.X_PO)

    def _one_of_each(self, X_PO: FloatArray) -> FloatArray:
        """Of poses (n, 3, 4) that look the same, or nearly coincide, the first."""
        model = self.model
        if len(model.symmetry_turns) > 1:
            # Near the prior; without one, wherever, but of all that look the same only one.
            X_PO = nearest_images(X_PO, self.space.center, model.symmetry_turns, model.symmetries)
        return self.distinct(X_PO)

    def distinct(self, X_PO: FloatArray) -> FloatArray:
        """Of poses (n, 3, 4) the first in each cell."""
        bend, offset = self.apart
        return X_PO.compress(distinct_poses(X_PO, offset, bend), axis=0)
