"""The poses that lay two contacts on two surface samples, judged by all contacts.

Two points fix a pose but for its spin about the line between them. Normals fix the spin too: the best one in the least
squares sense turns the samples' normals, seen along the line, onto the contacts' [K76]. Where there are no normals, or
both lie along the line, the spin is free, and turns of a full circle are tried.

Source: [K76] W. Kabsch, A solution for the best rotation to relate two sets of vectors, Acta Cryst. A32, 1976.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.compilation import read_only
from tactopose_drake.core.searches.pairs.image_kernels import Images
from tactopose_drake.core.searches.pairs.pair_lane_kernels import Field, Samples
from tactopose_drake.core.searches.pairs.pair_pose_kernels import Best, Matched, keep_best
from tactopose_drake.core.shape.coarse_field import CoarseField
from tactopose_drake.core.shape.pair_features import PairFeatures
from tactopose_drake.core.validation import FloatArray

# Coarse costs of so much for each contact, and less, are alike: where a face lies in the coarse field's cells makes
# half of that, and all faces of a flat object that explain a touch are to be kept.
_ALIKE = 1.0


@dataclass(frozen=True, eq=False)
class MatchedPairs:
    """Pairs of contacts, and the surface samples that they may lie on.

    Attributes:
        ends: the contacts' indices, shape (q, 2).
        spins: how many turns about the line between the contacts each match stands for, shape (q,); 1: the one that
            fits the normals best.
        begins: the number of matches before each pair, and of all, shape (q + 1,).
        matches: indices of pairs of samples; what is behind the last pair's counts for nothing.
    """

    ends: NDArray[np.intp]
    spins: NDArray[np.int64]
    begins: NDArray[np.intp]
    matches: NDArray[np.int32]


def kernel_field(field: CoarseField) -> Field:
    """The coarse field as kernels read it."""
    values, origin = read_only(field.values.view(np.int32).reshape(-1)), read_only(field.origin)
    return Field(values, field.shape, origin, 1.0 / field.spacing, field.spacing / field.step)


class BestPoses(NamedTuple):
    """The best poses (n, 3, 4), and their coarse costs (n,), rising; chance numbers where these tell nothing."""

    X_PO: FloatArray
    cost: NDArray[np.float32]


def best_poses(
    pairs: MatchedPairs,
    features: PairFeatures,
    field: CoarseField,
    table: FloatArray,
    counts: tuple[int, int],
    center: FloatArray,
    reach: tuple[float, float],
    turns: FloatArray,
) -> tuple[BestPoses, BestPoses]:
    """Of the poses of all pairs those within reach that cost least, by all contacts, and by all but one.

    The one is that which a pose suits least, for it may be false. Costs of up to one for each contact tell nothing:
    samples, voxels and sensors err as much. Such poses are taken by chance; else those would come first that happen to
    lie well in the voxels, all on one face of a box that is touched by one.

    A pose is in reach when one of its images is, which the object's symmetries make: of those only one is looked up.

    Args:
        pairs: contacts and their matches.
        features: the object's pairs of samples.
        field: the object's coarse field.
        table: all contacts, from `contact_tables.contact_table`.
        counts: so many of each, at the most.
        center: the middle of the poses that count, shape (3, 4).
        reach: the largest rotation from there, rad, and the largest translation, m.
        turns: the object's symmetries as poses X_OO', shape (g, 3, 4).

    Returns:
        Those by all contacts, and those by all but one.
    """
    room = 2, max(counts)
    best = Best(np.empty((*room, 3, 4)), np.empty(room, dtype=np.float32), np.array(counts))
    images = Images(
        read_only(center[:, :3] @ np.swapaxes(turns[:, :, :3], 1, 2)),
        read_only(turns[:, :, 3]),
        read_only(center[:, 3]),
        float(1.0 + 2.0 * np.cos(reach[0]) if reach[0] < np.pi else -np.inf),
        float(reach[1] ** 2),
    )
    keep_best(
        Samples(*map(read_only, (features.points, features.normals, features.pairs))),
        Matched(*map(read_only, (pairs.matches, pairs.begins, pairs.ends, pairs.spins))),
        kernel_field(field),
        table,
        images,
        _ALIKE,
        best,
    )
    by_all, but_for_one = best.counts.tolist()
    return BestPoses(best.X[0, :by_all], best.cost[0, :by_all]), BestPoses(
        best.X[1, :but_for_one], best.cost[1, :but_for_one]
    )
