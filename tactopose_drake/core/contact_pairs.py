"""Which two contacts say most about the pose: those that few pairs of surface samples match."""

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.contacts import Contacts
from tactopose_drake.core.pair_features import PairFeatures
from tactopose_drake.core.pair_poses import ContactPair
from tactopose_drake.core.validation import FloatArray


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
    contacts: int = 5
    pairs: int = 8
    spins: int = 24
    poses: int = 4000

    def choose(self, features: PairFeatures, contacts: Contacts, generator: np.random.Generator) -> list[ContactPair]:
        """The pairs of contacts, the most telling first; none where no two contacts match any samples."""
        offset = self.offset * features.spacing
        first, second, feature, sigma, spins = self._queries(features, contacts, offset)
        guess = features.guess_match_counts(feature, sigma, self.reach) * spins
        chosen: list[ContactPair] = []
        room = self.poses
        for row in np.argsort(guess, kind="stable").tolist():
            most = min(room, self.poses // 4) // int(spins[row])
            if most == 0 or len(chosen) == self.pairs:
                break
            # Of more matches than there is room for, every second or third, and so on: evenly over the features.
            step = max(1, int(guess[row]) // (int(spins[row]) * most))
            matches = features.matches(feature[row], sigma[row], self.reach, step)
            if len(matches) > most:
                matches = matches[((np.arange(most) + generator.random()) * (len(matches) / most)).astype(np.intp)]
            if len(matches):
                chosen.append(ContactPair(int(first[row]), int(second[row]), matches, int(spins[row])))
                room -= chosen[-1].count
        return chosen

    def _queries(
        self, features: PairFeatures, contacts: Contacts, offset: float
    ) -> tuple[NDArray[np.intp], NDArray[np.intp], FloatArray, FloatArray, NDArray[np.int64]]:
        """What is looked up: the contacts' indices (q,) and (q,), features (q, 4), their standard deviations (q, 4),
        and the turns (q,) that each match stands for; not of contacts that together say nothing, or are too far apart.
        """
        among = spread_out(contacts.p_PC, self.contacts)
        i, j = np.triu_indices(len(among), 1)
        first, second = among[i], among[j]
        p_a, p_b = contacts.p_PC[first], contacts.p_PC[second]
        sigma_p = np.asarray(contacts.sigma_position)
        noise = np.hypot(sigma_p[first], sigma_p[second])
        way = p_b - p_a
        distance, sigma_distance = np.sqrt(np.sum(way * way, axis=1)), np.hypot(noise, offset)
        tell = (distance >= 3.0 * noise) & (distance <= features.length + 3.0 * sigma_distance)
        first, second, distance, sigma_distance = first[tell], second[tell], distance[tell], sigma_distance[tell]
        feature, sigma = np.zeros((len(first), 4)), np.full((len(first), 4), np.inf)
        feature[:, 0], sigma[:, 0] = distance, sigma_distance
        if contacts.n_PC is None:
            return first, second, feature, sigma, np.full(len(first), self.spins)
        along = way[tell] / distance[:, None]
        n_a, n_b = contacts.n_PC[first], contacts.n_PC[second]
        cosines = np.stack(
            [np.sum(n_a * along, axis=1), np.sum(n_b * along, axis=1), np.sum(n_a * n_b, axis=1)], axis=1
        )
        feature[:, 1:] = np.arccos(np.clip(cosines, -1.0, 1.0))
        tilt = math.sqrt(2.0) * sigma_distance / distance
        sigma_n = np.asarray(contacts.sigma_normal)
        turn_a, turn_b = np.hypot(sigma_n[first], self.bend), np.hypot(sigma_n[second], self.bend)
        sigma[:, 1], sigma[:, 2] = np.hypot(turn_a, tilt), np.hypot(turn_b, tilt)
        sigma[:, 3] = np.hypot(turn_a, sigma_n[second])
        # The normals' parts across the line, which say the spin, against their errors.
        across = np.hypot(np.sin(feature[:, 1]), np.sin(feature[:, 2]))
        return first, second, feature, sigma, np.where(across > 2.0 * sigma[:, 3], 1, self.spins)


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
