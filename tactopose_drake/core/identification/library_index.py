"""An index over a library of objects that tells which of them two contacts may lie on: pair features in one table.

Two oriented points have four features that do not depend on the object's pose [D10]; see `pair_features`. The pairs of
every object's surface samples are counted in bins that all objects share. The table is sorted by bin, so that a query
reads only objects that have such pairs [LW88].

The share of an object's pairs near the feature of two contacts is the density of measuring it if the object is touched
at random. The logarithms for all pairs of contacts are added as if they were independent [V11]: this composite
likelihood ranks objects in some microseconds each, without estimating poses.

Sources: [D10] B. Drost, M. Ulrich, N. Navab, S. Ilic, Model globally, match locally, CVPR 2010; [LW88] Y. Lamdan,
H. Wolfson, Geometric hashing, ICCV 1988; [V11] C. Varin, N. Reid, D. Firth, An overview of composite likelihood
methods, Statistica Sinica 21, 2011.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.evidence.patch_contacts import tell_normals
from tactopose_drake.core.identification.index_kernels import (
    ANGLE,
    ANGLE_BINS,
    DISTANCE,
    DISTANCE_BINS,
    add_densities,
    count_features,
)
from tactopose_drake.core.searches.pairs.contact_pairs import spread_out
from tactopose_drake.core.shape.model_arrays import have_layout
from tactopose_drake.core.shape.model_cache import Arrays
from tactopose_drake.core.shape.pair_features import pair_feature
from tactopose_drake.core.shape.surface_samples import SurfaceSamples
from tactopose_drake.core.validation import FloatArray

SAMPLES = 512
"""Number of each object's surface samples that are paired; counts stored on disk depend on it."""

LEAST_DENSITY = 1e-6
"""A floor on the density, as samples may miss what is there."""

_BINS = DISTANCE_BINS * ANGLE_BINS**3
_REACH = 2.5  # standard deviations within which bins count
_MOST_CONTACTS = 8  # most contacts that are paired, those farthest apart
_LEAST_LENGTH = 3.0  # of a pair of contacts, in its standard deviations, so that its direction is known


@dataclass(frozen=True, eq=False)
class PairCounts:
    """A sparse histogram of the pair features of an object's surface samples.

    Attributes:
        bins: the bins that are not empty, ascending, shape (n,).
        counts: their counts, shape (n,).
    """

    bins: NDArray[np.int32]
    counts: NDArray[np.uint16]

    @classmethod
    def from_arrays(cls, arrays: Arrays) -> PairCounts | None:
        """Counts from the arrays of a file; None if these are invalid."""
        if not have_layout(arrays, {"bins": (np.int32, (None,)), "counts": (np.uint16, (None,))}):
            return None
        bins, counts = arrays["bins"], arrays["counts"]
        rising = len(bins) == len(counts) > 0 and np.all(np.diff(bins) > 0)
        return cls(bins, counts) if rising and bins[0] >= 0 and bins[-1] < _BINS else None


def count_pairs(samples: SurfaceSamples) -> PairCounts:
    """Counts the ordered pairs of `SAMPLES` of the samples, which must be at least as many."""
    some, counts = samples.thinned(SAMPLES), np.zeros(_BINS, dtype=np.int64)
    count_features(some.points, some.normals, counts)
    bins = np.flatnonzero(counts)
    return PairCounts(bins.astype(np.int32), np.minimum(counts[bins], 2**16 - 1).astype(np.uint16))


@dataclass(frozen=True, eq=False)
class LibraryIndex:
    """The pair features of many objects, sorted by bin.

    Attributes:
        size: number of objects.
        first: number of entries in the bins before each, shape (bins + 1,).
        objects: index of each entry's object, shape (entries,).
        counts: number of pairs of that object in the bin, shape (entries,).
    """

    size: int
    first: NDArray[np.int64]
    objects: NDArray[np.int32]
    counts: NDArray[np.uint16]

    @classmethod
    def join(cls, objects: Sequence[PairCounts]) -> LibraryIndex:
        """Joins objects' counts to an index; objects are numbered in this order."""
        first = np.zeros(_BINS + 1, dtype=np.int64)
        for pairs in objects:
            first[pairs.bins + 1] += 1
        np.cumsum(first, out=first)
        owners, counts = np.empty(first[-1], dtype=np.int32), np.empty(first[-1], dtype=np.uint16)
        place = first[:-1].copy()
        for i, pairs in enumerate(objects):
            owners[place[pairs.bins]], counts[place[pairs.bins]] = i, pairs.counts
            place[pairs.bins] += 1
        return cls(len(objects), first, owners, counts)

    def scores(self, contacts: Contacts) -> FloatArray:
        """How well each object's pairs agree with those of the contacts, shape (objects,); higher is better."""
        chosen = spread_out(contacts.p_PC, _MOST_CONTACTS)
        sigma_position = np.asarray(contacts.sigma_position)
        # Arbitrary normals count as missing: a very broad Gaussian would fall below `LEAST_DENSITY`.
        sigma_normal = np.where(tell_normals(contacts), contacts.sigma_normal, np.inf)
        scores, density = np.zeros(self.size), np.empty(self.size)
        for a, b in itertools.combinations(chosen.tolist(), 2):
            length = float(np.linalg.norm(contacts.p_PC[b] - contacts.p_PC[a]))
            sigma_length = float(np.hypot(sigma_position[a], sigma_position[b]))
            if length < _LEAST_LENGTH * sigma_length:
                continue
            if contacts.n_PC is None:
                feature, sigma = np.array([length, 0.0, 0.0, 0.0]), np.array([sigma_length, np.inf, np.inf, np.inf])
            else:
                feature = pair_feature(contacts.p_PC[a], contacts.n_PC[a], contacts.p_PC[b], contacts.n_PC[b])
                tilt = sigma_length / length
                turns = [sigma_normal[a], sigma_normal[b]]
                sigma = np.array([sigma_length, *np.hypot(turns, tilt), np.hypot(*turns)])
            density[:] = 0.0
            add_densities(self.first, self.objects, self.counts, *_weights(feature, sigma), density)
            scores += np.log(density / (SAMPLES * (SAMPLES - 1)) + LEAST_DENSITY)
        return scores


def _weights(feature: FloatArray, sigma: FloatArray) -> tuple[NDArray[np.int64], FloatArray]:
    """The lowest bins (4,) about a feature, and the weights of these and the following bins, shape (4, bins).

    Weights are those of a Gaussian widened by a bin's variance, because a sample may lie anywhere in its bin.
    """
    width = np.array([DISTANCE, ANGLE, ANGLE, ANGLE])
    bins = np.array([DISTANCE_BINS, *np.full(3, ANGLE_BINS)])
    middle, spread = feature / width + np.array([0.0, 0.5, 0.5, 0.5]), np.sqrt((sigma / width) ** 2 + 1.0 / 6.0)
    middle[0] = min(middle[0], DISTANCE_BINS - 0.5)
    low = np.clip(np.floor(middle - _REACH * spread), 0, bins - 1).astype(np.int64)
    high = np.clip(np.floor(middle + _REACH * spread), 0, bins - 1).astype(np.int64)
    weights = np.zeros((4, int((high - low).max()) + 1))
    for a in range(4):
        steps = np.arange(low[a], high[a] + 1) + 0.5 - middle[a]
        if np.isfinite(spread[a]):
            weights[a, : len(steps)] = np.exp(-0.5 * (steps / spread[a]) ** 2) / (np.sqrt(2.0 * np.pi) * spread[a])
        else:
            weights[a, : len(steps)] = 1.0
    return low, weights
