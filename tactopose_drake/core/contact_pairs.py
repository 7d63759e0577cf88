"""Which two contacts say most about the pose: those that few pairs of surface samples match."""

import dataclasses
import itertools
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.contacts import Contacts
from tactopose_drake.core.pair_features import PairFeatures, pair_feature
from tactopose_drake.core.pair_poses import ContactPair
from tactopose_drake.core.validation import FloatArray


class _Query(NamedTuple):
    """Two contacts' feature, its standard deviations, and the turns that each match stands for."""

    first: int
    second: int
    feature: FloatArray
    sigma: FloatArray
    spins: int


@dataclasses.dataclass(frozen=True, kw_only=True)
class PairChoice:
    """How pairs of contacts are matched with pairs of surface samples, and chosen.

    Attributes:
        offset: how far a contact lies from the nearest sample, one sigma, in spacings of the samples.
        bend: by how much the normal differs there, one sigma, rad.
        reach: a pair of samples matches within so many sigmas.
        contacts: of so many, as far apart as possible, all pairs are looked up.
        pairs: so many are used.
        spins: turns that are tried of a match that leaves the spin open.
        poses: so many come out, at most; a quarter of them, at most, from one pair.
    """

    offset: float = 0.5
    bend: float = 0.12
    reach: float = 2.0
    contacts: int = 6
    pairs: int = 10
    spins: int = 24
    poses: int = 10000

    def choose(self, features: PairFeatures, contacts: Contacts, generator: np.random.Generator) -> list[ContactPair]:
        """The pairs of contacts, the most telling first; none where no two contacts match any samples."""
        offset = self.offset * features.spacing
        indices = itertools.combinations(spread_out(contacts.p_PC, self.contacts).tolist(), 2)
        queries = [self._query(features, contacts, a, b, offset) for a, b in indices]
        guessed = [
            (features.guess_match_count(query.feature, query.sigma, self.reach) * query.spins, query)
            for query in queries
            if query is not None
        ]
        guessed.sort(key=lambda guess_and_query: guess_and_query[0])
        chosen: list[ContactPair] = []
        room = self.poses
        for _, query in guessed:
            most = min(room, self.poses // 4) // query.spins
            if most == 0 or len(chosen) == self.pairs:
                break
            matches = features.matches(query.feature, query.sigma, self.reach)
            if len(matches) > most:
                # Of more matches than there is room for, some at random.
                matches = generator.choice(matches, most, replace=False)
            if len(matches):
                chosen.append(ContactPair(query.first, query.second, matches, query.spins))
                room -= chosen[-1].count
        return chosen

    def _query(self, features: PairFeatures, contacts: Contacts, a: int, b: int, offset: float) -> _Query | None:
        """What is looked up for contacts a and b; None where the two say nothing, or are too far apart."""
        p_a, p_b = contacts.p_PC[a], contacts.p_PC[b]
        distance = float(np.linalg.norm(p_b - p_a))
        sigmas = np.asarray(contacts.sigma_position)[[a, b]]
        sigma_distance = math.hypot(*sigmas, offset)
        if distance < 3.0 * math.hypot(*sigmas) or distance > features.length + 3.0 * sigma_distance:
            return None
        if contacts.n_PC is None:
            unknown = np.array([sigma_distance, np.inf, np.inf, np.inf])
            return _Query(a, b, np.array([distance, 0.0, 0.0, 0.0]), unknown, self.spins)
        feature = pair_feature(p_a, contacts.n_PC[a], p_b, contacts.n_PC[b])
        turn_a, turn_b = np.asarray(contacts.sigma_normal)[[a, b]]
        tilt = math.sqrt(2.0) * math.hypot(*sigmas, offset) / distance
        sigma = np.array(
            [
                sigma_distance,
                math.hypot(turn_a, tilt, self.bend),
                math.hypot(turn_b, tilt, self.bend),
                math.hypot(turn_a, turn_b, self.bend),
            ]
        )
        # The normals' parts across the line, which say the spin, against their errors.
        across = math.hypot(math.sin(feature[1]), math.sin(feature[2]))
        return _Query(a, b, feature, sigma, 1 if across > 2.0 * sigma[3] else self.spins)


def spread_out(points: FloatArray, count: int) -> NDArray[np.intp]:
    """Indices of `count` of the points (n, 3), or all: first the farthest from the middle, each next from those."""
    nearest = np.linalg.norm(points - points.mean(axis=0), axis=1)
    chosen = [int(nearest.argmax())]
    nearest = np.full(len(points), np.inf)
    while len(chosen) < min(count, len(points)):
        nearest = np.minimum(nearest, np.linalg.norm(points - points[chosen[-1]], axis=1))
        nearest[chosen] = -1.0
        chosen.append(int(nearest.argmax()))
    return np.array(chosen)
