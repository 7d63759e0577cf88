"""Which two contacts say most about the pose: those that few pairs of surface samples match."""

import dataclasses

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.pairs.pair_features import PairFeatures
from tactopose_drake.core.pairs.pair_poses import ContactPair
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
        most = len(among) * (len(among) - 1) // 2
        pairs, spins = np.empty((2, most), dtype=np.intp), np.empty(most, dtype=np.int64)
        feature, sigma = np.empty((most, 4)), np.empty((most, 4))
        arguments = (
            contacts.p_PC,
            np.zeros_like(contacts.p_PC) if contacts.n_PC is None else contacts.n_PC,
            np.asarray(contacts.sigma_position),
            np.asarray(contacts.sigma_normal),
            contacts.n_PC is not None,
            among,
            features.length,
            offset,
            self.bend,
            self.spins,
        )
        count = _measure_pairs(*arguments, pairs, feature, sigma, spins)
        return pairs[0, :count], pairs[1, :count], feature[:count], sigma[:count], spins[:count]


def spread_out(points: FloatArray, count: int) -> NDArray[np.intp]:
    """Indices of `count` of the points (n, 3), or all: first the farthest from the middle, each next from those."""
    chosen = np.empty(min(count, len(points)), dtype=np.intp)
    _spread_out(points, chosen)
    return chosen


@njit(cache=True)
def _spread_out(points, chosen):  # type: ignore[no-untyped-def]
    start, nearest = np.zeros(3), np.full(points.shape[0], np.inf)
    for i in range(points.shape[0]):
        for a in range(3):
            start[a] += points[i, a] / points.shape[0]
    for k in range(chosen.shape[0]):
        for i in range(points.shape[0]):
            square = 0.0
            for a in range(3):
                square += (points[i, a] - start[a]) ** 2
            # Those that are chosen are no more asked; the middle's distances count for the first one alone.
            nearest[i] = square if k < 2 and nearest[i] >= 0.0 else min(nearest[i], square)
        chosen[k] = np.argmax(nearest)
        nearest[chosen[k]] = -1.0
        for a in range(3):
            start[a] = points[chosen[k], a]


@njit(cache=True)
def _measure_pairs(  # type: ignore[no-untyped-def]
    p, n, sigma_p, sigma_n, has_normals, among, length, offset, bend, open_spins, pairs, feature, sigma, spins
):
    """See `PairChoice._queries`; returns their number."""
    count = 0
    cosines = np.empty(3)
    for i in range(among.shape[0]):
        for j in range(i + 1, among.shape[0]):
            a, b = among[i], among[j]
            noise = sigma_p[a] ** 2 + sigma_p[b] ** 2
            x, y, z = p[b, 0] - p[a, 0], p[b, 1] - p[a, 1], p[b, 2] - p[a, 2]
            distance, off = np.sqrt(x * x + y * y + z * z), np.sqrt(noise + offset**2)
            if distance < 3.0 * np.sqrt(noise) or distance > length + 3.0 * off:
                continue
            pairs[0, count], pairs[1, count], spins[count] = a, b, open_spins
            feature[count], sigma[count] = 0.0, np.inf
            feature[count, 0], sigma[count, 0] = distance, off
            if has_normals:
                cosines[0] = (n[a, 0] * x + n[a, 1] * y + n[a, 2] * z) / distance
                cosines[1] = (n[b, 0] * x + n[b, 1] * y + n[b, 2] * z) / distance
                cosines[2] = n[a, 0] * n[b, 0] + n[a, 1] * n[b, 1] + n[a, 2] * n[b, 2]
                for c in range(3):
                    feature[count, 1 + c] = np.arccos(min(1.0, max(-1.0, cosines[c])))
                turn_a, turn_b = sigma_n[a] ** 2 + bend**2, sigma_n[b] ** 2 + bend**2
                tilt = 2.0 * (off / distance) ** 2
                sigma[count, 1], sigma[count, 2] = np.sqrt(turn_a + tilt), np.sqrt(turn_b + tilt)
                sigma[count, 3] = np.sqrt(turn_a + sigma_n[b] ** 2)
                # The normals' parts across the line, which say the spin, against their errors.
                across = np.sin(feature[count, 1]) ** 2 + np.sin(feature[count, 2]) ** 2
                if across > 4.0 * sigma[count, 3] ** 2:
                    spins[count] = 1
            count += 1
    return count
