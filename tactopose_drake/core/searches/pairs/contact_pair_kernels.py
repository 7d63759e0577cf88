"""Selection of the pairs of contacts to look up, and their features, compiled."""

from typing import NamedTuple

import numpy as np

from tactopose_drake.core.compilation import kernel, part
from tactopose_drake.core.kernel_types import (
    Floats1,
    Floats2,
    Ints1,
    Longs1,
    OutFloats2,
    OutInts1,
    OutLongs1,
    OutLongs2,
    UnsignedBytes2,
)
from tactopose_drake.core.kernels.sorting_kernels import sort_stably
from tactopose_drake.core.shape.pair_feature_kernels import find_matches

# The number of matches is estimated from blocks of pairs of samples: as many as the processor reads at once.
_GUESS_STEP = 16
# Initial capacity for the matches of a pair of contacts.
_ROOM = 1 << 14


class Measured(NamedTuple):
    """Contacts, read-only: points (k, 3), normals (k, 3), their standard deviations (k,), and whether normals exist."""

    p: Floats2
    n: Floats2
    sigma_p: Floats1
    sigma_n: Floats1
    has_normals: bool


class Library(NamedTuple):
    """An object's pairs of samples, as `PairFeatures` holds them; read-only.

    Attributes:
        features: quantised to bytes, shape (m, 4).
        first: index of the first pair of each bin.
        unit: quantisation steps, shape (4,), m and rad.
        length: the largest distance, m.
    """

    features: UnsignedBytes2
    first: Ints1
    unit: Floats1
    length: float


class Choice(NamedTuple):
    """Parameters of `PairChoice`; `offset` is in m."""

    most_contacts: int
    offset: float
    bend: float
    reach: float
    open_spins: int


class Chosen(NamedTuple):
    """The fields of `MatchedPairs`, as output arrays."""

    ends: OutLongs2
    spins: OutLongs1
    begins: OutLongs1
    matches: OutInts1


class Queries(NamedTuple):
    """Pairs of contacts to look up.

    Their indices (q, 2), their features (q, 4), the inverse standard deviations of these (q, 4), and the number of
    spins (q,) that each match stands for.
    """

    pairs: OutLongs2
    feature: OutFloats2
    weight: OutFloats2
    spins: OutLongs1


@kernel
def mark_spread_out(points: Floats2, chosen: OutLongs1) -> None:
    start, nearest = np.empty(3), np.empty(points.shape[0])
    for a in range(3):
        start[a] = 0.0
    for i in range(points.shape[0]):
        nearest[i] = np.inf
        for a in range(3):
            start[a] += points[i, a] / points.shape[0]
    for k in range(chosen.shape[0]):
        for i in range(points.shape[0]):
            square = 0.0
            for a in range(3):
                square += (points[i, a] - start[a]) ** 2
            # Chosen points stay marked by -1; distances to the centroid are discarded after the first choice.
            nearest[i] = square if k < 2 and nearest[i] >= 0.0 else min(nearest[i], square)
        farthest = 0
        for i in range(points.shape[0]):
            if nearest[i] > nearest[farthest]:
                farthest = i
        chosen[k] = farthest
        nearest[farthest] = -1.0
        for a in range(3):
            start[a] = points[chosen[k], a]


@kernel
def choose(measured: Measured, library: Library, choice: Choice, phase: Floats1, chosen: Chosen) -> int:
    """Fills `MatchedPairs`; returns the number of pairs of contacts that are used. See `PairChoice`."""
    features, first, unit, _ = library
    ends, spins, begins, matches = chosen
    reach = choice.reach
    among = np.empty(min(choice.most_contacts, measured.p.shape[0]), dtype=np.intp)
    mark_spread_out(measured.p, among)
    most = among.shape[0] * (among.shape[0] - 1) // 2
    asked, turns = np.empty((most, 2), dtype=np.intp), np.empty(most, dtype=np.int64)
    feature, weight = np.empty((most, 4)), np.empty((most, 4))
    queries = _measure_pairs(measured, among, library.length, choice, Queries(asked, feature, weight, turns))
    guess, nothing = np.empty(queries), np.empty(0, dtype=np.int32)
    order, spare = np.empty(queries, dtype=np.int64), np.empty(queries, dtype=np.int64)
    for q in range(queries):
        for c in range(4):
            feature[q, c] /= unit[c]
            weight[q, c] *= unit[c]
        guess[q] = _GUESS_STEP * find_matches(features, first, feature[q], weight[q], reach, _GUESS_STEP, nothing)
        guess[q] *= turns[q]

    found = np.empty(_ROOM, dtype=np.int32)
    used, room, poses = 0, matches.shape[0], matches.shape[0]
    sort_stably(guess, order, spare)
    for place in range(queries):
        q = order[place]
        most = min(room, poses // 4) // turns[q]
        if most == 0 or used == ends.shape[0]:
            break
        # If there are too many matches, take every step-th block, which is even over the features.
        step = max(1, int(guess[q]) // (turns[q] * most))
        count = find_matches(features, first, feature[q], weight[q], reach, step, found)
        if count > found.shape[0]:
            found = np.empty(count, dtype=np.int32)
            find_matches(features, first, feature[q], weight[q], reach, step, found)
        kept = min(count, most)
        if kept == 0:
            continue
        for k in range(kept):
            matches[begins[used] + k] = found[k if count <= most else int((k + phase[used]) * (count / most))]
        ends[used, 0], ends[used, 1] = asked[q, 0], asked[q, 1]
        spins[used], begins[used + 1] = turns[q], begins[used] + kept
        used += 1
        room -= kept * turns[q]
    return used


@part
def _measure_pairs(measured: Measured, among: Longs1, length: float, choice: Choice, queries: Queries) -> int:
    """Fills the queries for pairs no farther apart than `length`, m, allows; returns their number."""
    p, n, sigma_p, sigma_n, has_normals = measured
    pairs, feature, weight, spins = queries
    offset, bend = choice.offset, choice.bend
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
            pairs[count, 0], pairs[count, 1], spins[count] = a, b, choice.open_spins
            for c in range(4):
                feature[count, c], weight[count, c] = 0.0, 0.0
            feature[count, 0], weight[count, 0] = distance, 1.0 / off
            if has_normals:
                cosines[0] = (n[a, 0] * x + n[a, 1] * y + n[a, 2] * z) / distance
                cosines[1] = (n[b, 0] * x + n[b, 1] * y + n[b, 2] * z) / distance
                cosines[2] = n[a, 0] * n[b, 0] + n[a, 1] * n[b, 1] + n[a, 2] * n[b, 2]
                for c in range(3):
                    feature[count, 1 + c] = np.arccos(min(1.0, max(-1.0, cosines[c])))
                turn_a, turn_b = sigma_n[a] ** 2 + bend**2, sigma_n[b] ** 2 + bend**2
                tilt = 2.0 * (off / distance) ** 2
                turned = turn_a + sigma_n[b] ** 2
                weight[count, 1] = 1.0 / np.sqrt(turn_a + tilt)
                weight[count, 2] = 1.0 / np.sqrt(turn_b + tilt)
                weight[count, 3] = 1.0 / np.sqrt(turned)
                # The spin is determined if the normals' components across the line exceed their errors.
                across = np.sin(feature[count, 1]) ** 2 + np.sin(feature[count, 2]) ** 2
                if across > 4.0 * turned:
                    spins[count] = 1
            count += 1
    return count
