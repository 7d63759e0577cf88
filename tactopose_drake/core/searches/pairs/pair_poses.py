"""Poses that put two contacts on two surface samples, ranked by all contacts.

Two points determine a pose up to its spin about the line between them. Normals determine the spin too: the best one in
the least-squares sense rotates the contacts' normals, projected along the line, onto the samples' [K76]. Without
normals, or if both lie along the line, the spin is free, and a full circle of spins is tried.

Source: [K76] W. Kabsch, A solution for the best rotation to relate two sets of vectors, Acta Cryst. A32, 1976.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.compilation import read_only
from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.searches.pairs.image_kernels import Images
from tactopose_drake.core.searches.pairs.pair_lane_kernels import Field, Samples
from tactopose_drake.core.searches.pairs.pair_pose_kernels import Best, Matched, keep_best
from tactopose_drake.core.shape.coarse_field import CoarseField
from tactopose_drake.core.shape.pair_features import PairFeatures
from tactopose_drake.core.validation import FloatArray

# Coarse costs per contact up to this are not significant: the position of a face in the cells of the coarse field makes
# half of it, and all faces of a flat object that explain a touch are to be kept.
_ALIKE = 1.0


@dataclass(frozen=True, eq=False)
class MatchedPairs:
    """Pairs of contacts, and the pairs of surface samples that they match.

    Attributes:
        ends: the contacts' indices, shape (q, 2).
        spins: number of spins about the line between the contacts that each match stands for, shape (q,); 1: the one
            that fits the normals best.
        begins: offsets of each pair's matches, and the number of all, shape (q + 1,).
        matches: indices of pairs of samples; entries after the last pair's are unused.
    """

    ends: NDArray[np.intp]
    spins: NDArray[np.int64]
    begins: NDArray[np.intp]
    matches: NDArray[np.int32]


def kernel_field(field: CoarseField) -> Field:
    """The coarse field in the form that kernels read."""
    values, origin = read_only(field.values.view(np.int32).reshape(-1)), read_only(field.origin)
    return Field(values, field.shape, origin, 1.0 / field.spacing, field.spacing / field.step)


def contact_table(field: CoarseField, contacts: Contacts, sigma_position: float, sigma_normal: float) -> FloatArray:
    """What `pair_lane_kernels.add_cost` reads of each contact to rank poses, shape (k, 8): point, normal, two weights.

    The weights are those of the squared distance and the squared difference of normals. The given standard deviations
    are the errors of the poses to be ranked; those of the sensors and of the voxels are added.
    """
    table = np.zeros((len(contacts), 8))
    table[:, :3] = contacts.p_PC
    variance = np.asarray(contacts.sigma_position) ** 2 + sigma_position**2 + field.spacing**2 / 12.0
    table[:, 6] = field.step**2 / variance
    if contacts.n_PC is not None:
        table[:, 3:6] = contacts.n_PC
        table[:, 7] = 1.0 / (np.asarray(contacts.sigma_normal) ** 2 + sigma_normal**2)
    return table


class BestPoses(NamedTuple):
    """The best poses (n, 3, 4), and their coarse costs (n,), ascending; random where these are not significant."""

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
    """Returns the poses of all pairs within reach that cost least, by all contacts, and by all but one.

    The one left out is that which a pose fits worst, as it may be an outlier. Costs up to one for each contact are not
    significant, as samples, voxels and sensors err as much. Such poses are ranked at random; otherwise those would come
    first that happen to lie well in the voxels, such as all on one face of a box with one contact.

    A pose is within reach if any of its symmetric images is, as the features contain only one of these.

    Args:
        pairs: contacts and their matches.
        features: the object's pairs of samples.
        field: the object's coarse field.
        table: all contacts, from `contact_table`.
        counts: most poses of each kind.
        center: the pose from which the reach is measured, shape (3, 4).
        reach: the largest rotation from there, rad, and the largest translation, m.
        turns: the object's symmetries as poses X_OO', shape (g, 3, 4).

    Returns:
        The poses by all contacts, and those by all but one.
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
