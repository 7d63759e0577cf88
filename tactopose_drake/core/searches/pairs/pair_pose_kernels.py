"""Poses that put two contacts on two surface samples, and the best of them on the coarse field, compiled."""

from typing import NamedTuple

import numpy as np

from tactopose_drake.core.compilation import inlined, kernel, part
from tactopose_drake.core.kernel_types import (
    Floats1,
    Floats2,
    Ints1,
    Longs1,
    Longs2,
    OutFloats4,
    OutLongs1,
    OutSingles1,
    OutSingles2,
    Singles2,
)
from tactopose_drake.core.kernels.matrix_kernels import orthonormalize
from tactopose_drake.core.kernels.sorting_kernels import sort_stably
from tactopose_drake.core.searches.pairs.image_kernels import Images, is_near, may_be_near
from tactopose_drake.core.searches.pairs.kept_pose_kernels import Block, drop_worse, keep, make_block, make_room, note
from tactopose_drake.core.searches.pairs.pair_lane_kernels import (
    AXES,
    COSINE,
    COST,
    DEAREST,
    LANES,
    MIDDLE,
    SINE,
    Field,
    Samples,
    add_cost,
    axes_along,
    fit_spins,
    place,
    turn,
)


class Matched(NamedTuple):
    """The fields of `MatchedPairs`; read-only."""

    matches: Ints1
    begins: Longs1
    ends: Longs2
    spins: Longs1


class Best(NamedTuple):
    """Output of `keep_best`: poses that fit all contacts, and, in the second row, all but the one that fits each worst.

    Attributes:
        X: poses, shape (2, n, 3, 4).
        cost: their costs, ascending, shape (2, n).
        counts: on entry the number of poses wanted, on return the number found, shape (2,).
    """

    X: OutFloats4
    cost: OutSingles2
    counts: OutLongs1


@inlined
def _lay_out(table, first, second, order, inverse_spacing, frame, contacts):
    """Fills the frame of a pair of contacts, and all contacts expressed in it.

    The frame (4, 3) consists of the midpoint of the two contacts and the axes, x from the first to the second. The
    contacts (k, 8), in this order, are points in the frame, in voxels, normals, and the weights of `contact_table`.
    """
    x, y, z = axes_along(
        table[second, 0] - table[first, 0], table[second, 1] - table[first, 1], table[second, 2] - table[first, 2]
    )
    for c in range(3):
        frame[0, c] = 0.5 * (table[first, c] + table[second, c])
        frame[1, c], frame[2, c], frame[3, c] = x[c], y[c], z[c]
    for row in range(order.shape[0]):
        m = order[row]
        for c in range(3):
            along, normal = 0.0, 0.0
            for d in range(3):
                along += frame[1 + c, d] * (table[m, d] - frame[0, d])
                normal += frame[1 + c, d] * table[m, 3 + d]
            contacts[row, c], contacts[row, 3 + c] = along * inverse_spacing, normal
        contacts[row, 6], contacts[row, 7] = table[m, 6], table[m, 7]


@inlined
def _fill_axes(w, lane, axes):
    """Fills the axes (3, 3) of the contacts' frame in O, as rows, from a lane."""
    for a in range(3):
        for b in range(3):
            axes[a, b] = w[AXES + np.uintp(LANES * (3 * a + b)) + lane]


@inlined
def _fill_pose(frame, axes, w, lane, X):
    """Fills the pose X (3, 4) that puts the contacts' frame on these axes and on a lane's origin in O."""
    for a in range(3):
        X[a, 3] = frame[0, a]
        for b in range(3):
            X[a, b] = frame[1, a] * axes[0, b] + frame[2, a] * axes[1, b] + frame[3, a] * axes[2, b]
            X[a, 3] -= X[a, b] * w[MIDDLE + np.uintp(LANES * b) + lane]


@part
def _place_lanes(samples: Samples, contacts: Singles2, spins: int, lanes: int, block: Block) -> None:
    """Places the contacts' frame in O by matches and spins. The pair's own contacts are the last two of `contacts`."""
    w, last = block.w, contacts.shape[0] - 1
    place(samples, block.samples, lanes, w)
    if spins == 1:
        fit_spins(contacts[last - 1], contacts[last], lanes, w)
    else:
        for lane in range(np.uintp(lanes)):
            angle = 2.0 * np.pi * block.match[lane, 1] / spins
            w[COSINE + lane], w[SINE + lane] = np.cos(angle), np.sin(angle)
    turn(lanes, w)


@kernel
def keep_best(
    samples: Samples, matched: Matched, field: Field, table: Floats2, images: Images, alike: float, best: Best
) -> None:
    """Keeps the poses that best fit all contacts, and those that best fit all but one.

    Costs below `alike` per contact are not significant: poses below that are ranked at random.
    """
    spins = matched.spins
    X, axes, frames = np.empty((3, 4)), np.empty((3, 3)), np.empty((spins.shape[0], 4, 3))
    contacts = np.empty((spins.shape[0], table.shape[0], table.shape[1]), dtype=np.float32)
    order = np.empty(table.shape[0], dtype=np.intp)
    kept = make_room(best.counts)
    block = make_block()
    for q in range(spins.shape[0]):
        _put_last(matched.ends[q, 0], matched.ends[q, 1], order)
        frame, laid = frames[q], contacts[q]
        _lay_out(table, matched.ends[q, 0], matched.ends[q, 1], order, field.inverse_spacing, frame, laid)
        row, spin = matched.begins[q], 0
        while row < matched.begins[q + 1]:
            lanes, row, spin = _take(samples, matched, q, frame, images, (row, spin), block)
            _place_lanes(samples, laid, spins[q], lanes, block)
            for lane in range(np.uintp(lanes)):
                block.w[COST + lane], block.w[DEAREST + lane] = 0.0, 0.0
                if images.farthest < np.inf:
                    _fill_axes(block.w, lane, axes)
                    _fill_pose(frame, axes, block.w, lane, X)
                    block.w[COST + lane] = 0.0 if is_near(X, images) else np.inf
            _add_costs(field, laid, kept.limit, alike, lanes, block.w)
            keep(q, lanes, alike, laid.shape[0], block, best.counts, kept)
    for spared in range(2):
        used, cost = drop_worse(best.counts[spared], spared, kept), kept.cost[spared]
        rising, places = np.empty(used), np.empty((2, used), dtype=np.int64)
        for k in range(used):
            rising[k] = cost[k]
        sort_stably(rising, places[0], places[1])
        for k in range(used):
            place_of = places[0, k]
            q, row, spin = (
                kept.pose[spared, place_of, 0],
                kept.pose[spared, place_of, 1],
                kept.pose[spared, place_of, 2],
            )
            note(samples, matched.matches[row], row, spin, 0, block)
            _place_lanes(samples, contacts[q], spins[q], 1, block)
            _fill_axes(block.w, np.uintp(0), axes)
            orthonormalize(axes, 3)  # They are in single precision.
            _fill_pose(frames[q], axes, block.w, np.uintp(0), best.X[spared, k])
            best.cost[spared, k] = cost[place_of]
        best.counts[spared] = used


@inlined
def _take(samples, matched, q, frame, images, begun, block):
    """Takes the next poses of a pair of contacts that may be near enough, as many as there are lanes.

    Returns their number, and the match and spin of the next one.
    """
    (row, spin), lanes, is_anywhere = begun, 0, images.farthest == np.inf
    while lanes < LANES and row < matched.begins[q + 1]:
        match = matched.matches[row]
        i, j = samples.pairs[match, 0], samples.pairs[match, 1]
        is_worth = is_anywhere or spin > 0 or may_be_near(samples.points, i, j, frame, images)
        if is_worth:
            note(samples, match, row, spin, lanes, block)
            lanes, spin = lanes + 1, spin + 1
        if not is_worth or spin == matched.spins[q]:
            row, spin = row + 1, 0
    return lanes, row, spin


@part
def _add_costs(field: Field, contacts: Singles2, limit: Floats1, alike: float, lanes: int, w: OutSingles1) -> None:
    """Adds the costs of contacts (k, 8), until no lane can be among the best of either kind any more."""
    k = contacts.shape[0]
    # Poses with insignificant costs may still be chosen at random.
    most, most_but_for_one = np.float32(_bound(limit[0], alike * k)), np.float32(_bound(limit[1], alike * (k - 1)))
    for m in range(k):
        add_cost(field, contacts[m], lanes, w)
        good = 0
        for lane in range(np.uintp(lanes)):
            cost = w[COST + lane]
            good += 1 if (cost <= most) | (cost - w[DEAREST + lane] <= most_but_for_one) else 0
        if good == 0:
            break


@inlined
def _bound(limit, alike):
    """The limit up to which costs are computed; -inf if no poses are wanted."""
    return max(limit, alike) if limit > -np.inf else limit


@inlined
def _put_last(a, b, order):
    """The order of contacts with a pair last: it fits by construction, and the others reject a bad pose sooner."""
    row = 0
    for m in range(order.shape[0]):
        if m != a and m != b:
            order[row] = m
            row += 1
    order[row], order[row + 1] = a, b
