"""The poses that lay two contacts on two surface samples, and the best of them on the coarse field."""

from typing import NamedTuple

import numpy as np

from tactopose_drake.core.compilation import inlined, kernel, part
from tactopose_drake.core.kernel_types import (
    Floats2,
    Ints1,
    Longs1,
    Longs2,
    OutFloats3,
    OutLongs2,
    OutSingles1,
    Singles2,
)
from tactopose_drake.core.kernels.matrix_kernels import orthonormalize
from tactopose_drake.core.kernels.sorting_kernels import select, sort_stably
from tactopose_drake.core.searches.pairs.image_kernels import Images, is_near, may_be_near
from tactopose_drake.core.searches.pairs.pair_lane_kernels import (
    AXES,
    COSINE,
    COST,
    DEAREST,
    LANES,
    MIDDLE,
    SINE,
    SIZE,
    TOTAL,
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


class _Block(NamedTuple):
    """As many poses as there are lanes, of one pair of contacts, and their rows of lanes.

    Attributes:
        samples: where the pair's contacts lie, shape (LANES, 2).
        match: the places of these in `Matched.matches`, and the numbers of spins, shape (LANES, 2).
        w: the rows.
    """

    samples: OutLongs2
    match: OutLongs2
    w: OutSingles1


@inlined
def _lay_out(table, first, second, order, inverse_spacing, frame, contacts):
    """The contacts' frame, and the contacts in it.

    The frame (4, 3) is the point between two of them, and axes, x from the first to the second. Contacts (k, 8), in
    this order, are points, in voxels from there, and normals along the axes, and the weights of `contact_table`.
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
    """The axes (3, 3) of the contacts' frame in O, rows, where a lane says."""
    for a in range(3):
        for b in range(3):
            axes[a, b] = w[AXES + np.uintp(LANES * (3 * a + b)) + lane]


@inlined
def _fill_pose(frame, axes, w, lane, X):
    """The pose X (3, 4) at which the contacts' frame has these axes, and its origin where a lane says."""
    for a in range(3):
        X[a, 3] = frame[0, a]
        for b in range(3):
            X[a, b] = frame[1, a] * axes[0, b] + frame[2, a] * axes[1, b] + frame[3, a] * axes[2, b]
            X[a, 3] -= X[a, b] * w[MIDDLE + np.uintp(LANES * b) + lane]


@part
def _place_lanes(samples: Samples, contacts: Singles2, spins: int, lanes: int, block: _Block) -> None:
    """Where matches and spins lay the contacts' frame in O. The pair's own contacts are the last two of `contacts`."""
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
    samples: Samples,
    matched: Matched,
    field: Field,
    table: Floats2,
    images: Images,
    alike: float,
    spared: int,
    X_best: OutFloats3,
    cost: OutSingles1,
) -> int:
    """Fills the poses and costs, and returns their number. What is worse than so many already is left as it is.

    Costs below `alike` tell nothing: which of such poses counts as the better one is left to chance. Where one contact
    is spared (0 or 1 are) a pose costs what all but its dearest one do.
    """
    matches, begins, ends, spins = matched
    X, axes, frames = np.empty((3, 4)), np.empty((3, 3)), np.empty((spins.shape[0], 4, 3))
    contacts = np.empty((spins.shape[0], table.shape[0], table.shape[1]), dtype=np.float32)
    count, used, limit = cost.shape[0], 0, np.inf
    # A pose is kept as its pair, its match and its spin. There may be twice as many as are wanted, then half are left:
    # soon most poses cost more than is worth adding up.
    room = 2 * count + LANES
    kept, kept_cost = np.empty((room, 3), dtype=np.int32), np.empty(room, dtype=np.float32)
    spare = np.empty(room, dtype=np.float32)
    order = np.empty(table.shape[0], dtype=np.intp)
    block = _Block(
        np.empty((LANES, 2), dtype=np.int64),
        np.empty((LANES, 2), dtype=np.int64),
        np.empty(SIZE, dtype=np.float32),
    )
    for q in range(spins.shape[0]):
        _put_last(ends[q, 0], ends[q, 1], order)
        frame, laid = frames[q], contacts[q]
        _lay_out(table, ends[q, 0], ends[q, 1], order, field.inverse_spacing, frame, laid)
        row, spin = begins[q], 0
        while row < begins[q + 1]:
            lanes, row, spin = _take(samples, matched, q, frame, images, (row, spin), block)
            _place_lanes(samples, laid, spins[q], lanes, block)
            for lane in range(np.uintp(lanes)):
                block.w[COST + lane], block.w[DEAREST + lane] = 0.0, 0.0
                if images.farthest < np.inf:
                    _fill_axes(block.w, lane, axes)
                    _fill_pose(frame, axes, block.w, lane, X)
                    block.w[COST + lane] = 0.0 if is_near(X, images) else np.inf
            _add_costs(field, laid, max(limit, alike), spared, lanes, block.w)
            for lane in range(np.uintp(lanes)):
                total, match, turns = float(block.w[TOTAL + lane]), block.match[lane, 0], block.match[lane, 1]
                if total < alike:
                    total = alike * _chance(match, turns)
                if total <= limit and total < np.inf:
                    kept[used, 0], kept[used, 1], kept[used, 2] = q, match, turns
                    kept_cost[used] = total
                    used += 1
            if used >= 2 * count:
                limit, used = _drop_worse(count, used, kept, kept_cost, spare)
    if used > count:
        limit, used = _drop_worse(count, used, kept, kept_cost, spare)
    rising, places = np.empty(used), np.empty((2, used), dtype=np.int64)
    for k in range(used):
        rising[k] = kept_cost[k]
    sort_stably(rising, places[0], places[1])
    for k in range(used):
        q, row, spin = kept[places[0, k], 0], kept[places[0, k], 1], kept[places[0, k], 2]
        _note(samples, matches[row], row, spin, 0, block)
        _place_lanes(samples, contacts[q], spins[q], 1, block)
        _fill_axes(block.w, np.uintp(0), axes)
        orthonormalize(axes, 3)  # They are singles.
        _fill_pose(frames[q], axes, block.w, np.uintp(0), X_best[k])
        cost[k] = kept_cost[places[0, k]]
    return used


@inlined
def _take(samples, matched, q, frame, images, begun, block):
    """Takes the next poses of a pair of contacts that may be near enough, as many as there are lanes.

    Returns how many these are, and the match and spin that the next one has.
    """
    (row, spin), lanes, is_anywhere = begun, 0, images.farthest == np.inf
    while lanes < LANES and row < matched.begins[q + 1]:
        match = matched.matches[row]
        i, j = samples.pairs[match, 0], samples.pairs[match, 1]
        is_worth = is_anywhere or spin > 0 or may_be_near(samples.points, i, j, frame, images)
        if is_worth:
            _note(samples, match, row, spin, lanes, block)
            lanes, spin = lanes + 1, spin + 1
        if not is_worth or spin == matched.spins[q]:
            row, spin = row + 1, 0
    return lanes, row, spin


@inlined
def _note(samples, match, row, spin, lane, block):
    """Writes down what a lane's pose is made of."""
    block.samples[lane, 0], block.samples[lane, 1] = samples.pairs[match, 0], samples.pairs[match, 1]
    block.match[lane, 0], block.match[lane, 1] = row, spin


@part
def _add_costs(field: Field, contacts: Singles2, bound: float, spared: int, lanes: int, w: OutSingles1) -> None:
    """Adds what contacts (k, 8) cost, but for so many (0 or 1), until all lanes cost more than the bound."""
    dearest = np.float32(spared)
    for m in range(contacts.shape[0]):
        add_cost(field, contacts[m], lanes, w)
        good = 0
        for lane in range(np.uintp(lanes)):
            w[TOTAL + lane] = w[COST + lane] - dearest * w[DEAREST + lane]
            good += 1 if w[TOTAL + lane] <= np.float32(bound) else 0
        if good == 0:
            break


@inlined
def _chance(row, spin):
    """A number from 0 to 1, as good as random, of a match and spin [multiplicative hashing, Knuth]."""
    return float(((row * 2654435761 + spin * 2246822519) ^ (row >> 3)) & 0xFFFFFF) / 0x1000000


@inlined
def _put_last(a, b, order):
    """The order of contacts with a pair last: it fits by construction, the others say sooner that a pose is bad."""
    row = 0
    for m in range(order.shape[0]):
        if m != a and m != b:
            order[row] = m
            row += 1
    order[row], order[row + 1] = a, b


@inlined
def _drop_worse(count, used, kept, cost, spare):
    """Keeps of the first `used`, which are more than `count`, those that cost least; the largest cost, and `count`."""
    for k in range(used):
        spare[k] = cost[k]
    limit, now = select(spare, used, count - 1), 0
    for k in range(used):
        if cost[k] <= limit and now < count:
            kept[now, 0], kept[now, 1], kept[now, 2] = kept[k, 0], kept[k, 1], kept[k, 2]
            cost[now] = cost[k]
            now += 1
    return limit, now
