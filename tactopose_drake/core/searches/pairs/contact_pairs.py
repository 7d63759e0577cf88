"""The choice of the most informative pairs of contacts: those that few pairs of surface samples match."""

import dataclasses

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.compilation import read_only
from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.searches.pairs.contact_pair_kernels import (
    Choice,
    Chosen,
    Library,
    Measured,
    choose,
    mark_spread_out,
)
from tactopose_drake.core.searches.pairs.pair_poses import MatchedPairs
from tactopose_drake.core.shape.pair_features import PairFeatures
from tactopose_drake.core.validation import FloatArray


@dataclasses.dataclass(frozen=True, kw_only=True)
class PairChoice:
    """How pairs of contacts are matched with pairs of surface samples, and chosen.

    Attributes:
        offset: standard deviation of a contact's distance from the nearest sample, in spacings of the samples.
        bend: standard deviation of the normal's difference there, rad.
        reach: a pair of samples matches if it is within this many standard deviations.
        contacts: number of contacts, as far apart as possible, whose pairs are looked up.
        pairs: most pairs of contacts that are used.
        spins: number of spins tried for a match that leaves the spin free.
        poses: most poses in all; at most a quarter of them from one pair.
    """

    offset: float = 0.5
    bend: float = 0.12
    reach: float = 2.0
    contacts: int = 5
    pairs: int = 8
    spins: int = 24
    poses: int = 24000

    def choose(self, features: PairFeatures, contacts: Contacts, generator: np.random.Generator) -> MatchedPairs:
        """The pairs of contacts, the most informative first; none if no two contacts match any samples.

        Contacts that nearly coincide are uninformative, and so are those too far apart for the object.
        """
        ends, spins = np.empty((self.pairs, 2), dtype=np.intp), np.empty(self.pairs, dtype=np.int64)
        begins, matches = np.zeros(self.pairs + 1, dtype=np.intp), np.empty(self.poses, dtype=np.int32)
        measured = Measured(
            read_only(contacts.p_PC),
            read_only(contacts.normals_or_zeros),
            read_only(np.asarray(contacts.sigma_position)),
            read_only(np.asarray(contacts.sigma_normal)),
            contacts.n_PC is not None,
        )
        kept, first, unit = map(read_only, (features.features, features.first, features.unit))
        library = Library(kept, first, unit, float(features.length))
        choice = Choice(
            self.contacts, float(self.offset * features.spacing), float(self.bend), float(self.reach), self.spins
        )
        phase = generator.random(self.pairs)
        count = choose(measured, library, choice, phase, Chosen(ends, spins, begins, matches))
        return MatchedPairs(ends[:count], spins[:count], begins[: count + 1], matches)


def spread_out(points: FloatArray, count: int) -> NDArray[np.intp]:
    """Farthest point sampling: `count` indices of points (n, 3), or all, from the farthest from the centroid on."""
    chosen = np.empty(min(count, len(points)), dtype=np.intp)
    mark_spread_out(points, chosen)
    return chosen
