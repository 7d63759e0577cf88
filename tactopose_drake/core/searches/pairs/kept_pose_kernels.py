"""Keeps the best poses of a stream of blocks of lanes."""

from typing import NamedTuple

import numpy as np

from tactopose_drake.core.compilation import inlined, part
from tactopose_drake.core.kernel_types import (
    Longs1,
    OutFloats1,
    OutInts3,
    OutLongs1,
    OutLongs2,
    OutSingles1,
    OutSingles2,
)
from tactopose_drake.core.kernels.sorting_kernels import select
from tactopose_drake.core.searches.pairs.pair_lane_kernels import COST, DEAREST, LANES, SIZE


class Kept(NamedTuple):
    """The best poses so far, in two rows like those of `Best`; pruned to the wanted number when twice as many.

    Attributes:
        pose: indices of the pair, its match and its spin, shape (2, r, 3).
        cost: shape (2, r).
        used: number of poses, shape (2,).
        limit: poses of higher cost are not among the best, shape (2,).
    """

    pose: OutInts3
    cost: OutSingles2
    used: OutLongs1
    limit: OutFloats1


class Block(NamedTuple):
    """As many poses of one pair of contacts as there are lanes, and their rows of lanes.

    Attributes:
        samples: indices of the samples that the two contacts lie on, shape (LANES, 2).
        match: index of the match in `Matched.matches`, and number of the spin, shape (LANES, 2).
        w: the rows.
    """

    samples: OutLongs2
    match: OutLongs2
    w: OutSingles1


@inlined
def make_block():
    """An uninitialised block."""
    return Block(
        np.empty((LANES, 2), dtype=np.int64),
        np.empty((LANES, 2), dtype=np.int64),
        np.empty(SIZE, dtype=np.float32),
    )


@inlined
def note(samples, match, row, spin, lane, block):
    """Records the match and spin of a lane's pose."""
    block.samples[lane, 0], block.samples[lane, 1] = samples.pairs[match, 0], samples.pairs[match, 1]
    block.match[lane, 0], block.match[lane, 1] = row, spin


@part
def make_room(count: Longs1) -> Kept:
    """Allocates room for twice the numbers of poses (2,), plus a block of lanes."""
    room = 2 * max(count[0], count[1]) + LANES
    kept = Kept(
        np.empty((2, room, 3), dtype=np.int32),
        np.empty((2, room), dtype=np.float32),
        np.zeros(2, dtype=np.int64),
        np.full(2, np.inf),
    )
    for spared in range(2):
        if count[spared] == 0:
            kept.limit[spared] = -np.inf
    return kept


@part
def keep(q: int, lanes: int, alike: float, contacts: int, block: Block, count: Longs1, kept: Kept) -> None:
    """Keeps those of the lanes' poses, for a pair of `contacts` contacts, that are among the best."""
    for spared in range(2):
        used, limit, tells = kept.used[spared], kept.limit[spared], alike * (contacts - spared)
        for lane in range(np.uintp(lanes)):
            total = float(block.w[COST + lane] - np.float32(spared) * block.w[DEAREST + lane])
            match, turns = block.match[lane, 0], block.match[lane, 1]
            if total < tells:
                total = tells * _chance(match, turns)
            if total <= limit and total < np.inf:
                kept.pose[spared, used, 0], kept.pose[spared, used, 1] = q, match
                kept.pose[spared, used, 2], kept.cost[spared, used] = turns, total
                used += 1
        kept.used[spared] = used
        if used >= 2 * count[spared]:
            drop_worse(count[spared], spared, kept)


@inlined
def _chance(row, spin):
    """A pseudo-random number in [0, 1) from a match and spin, by multiplicative hashing [Knuth]."""
    return float(((row * 2654435761 + spin * 2246822519) ^ (row >> 3)) & 0xFFFFFF) / 0x1000000


@part
def drop_worse(count: int, spared: int, kept: Kept) -> int:
    """Prunes a row to the `count` cheapest poses; returns their number."""
    used, pose, cost = kept.used[spared], kept.pose[spared], kept.cost[spared]
    if used <= count:
        return used
    spare = np.empty(used, dtype=np.float32)
    for k in range(used):
        spare[k] = cost[k]
    limit, now = select(spare, used, count - 1), 0
    # Without normals, many poses cost the same; those that cost just the limit fill the places that are left.
    as_dear = count
    for k in range(used):
        as_dear -= 1 if cost[k] < limit else 0
    for k in range(used):
        is_kept = cost[k] < limit
        if cost[k] == limit and as_dear > 0:
            is_kept, as_dear = True, as_dear - 1
        if is_kept:
            pose[now, 0], pose[now, 1], pose[now, 2], cost[now] = pose[k, 0], pose[k, 1], pose[k, 2], cost[k]
            now += 1
    kept.limit[spared], kept.used[spared] = limit, now
    return now
