"""The best of poses that are laid lane by lane, kept while more of them come."""

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
    """The best so far, in two rows like `Best`'s; there may be twice as many as are wanted, then half are left.

    Attributes:
        pose: each as its pair, its match and its spin, shape (2, r, 3).
        cost: shape (2, r).
        used: how many there are, shape (2,).
        limit: what costs more is none of the best, shape (2,).
    """

    pose: OutInts3
    cost: OutSingles2
    used: OutLongs1
    limit: OutFloats1


class Block(NamedTuple):
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
def make_block():
    """Room for one."""
    return Block(
        np.empty((LANES, 2), dtype=np.int64),
        np.empty((LANES, 2), dtype=np.int64),
        np.empty(SIZE, dtype=np.float32),
    )


@inlined
def note(samples, match, row, spin, lane, block):
    """Writes down what a lane's pose is made of."""
    block.samples[lane, 0], block.samples[lane, 1] = samples.pairs[match, 0], samples.pairs[match, 1]
    block.match[lane, 0], block.match[lane, 1] = row, spin


@part
def make_room(count: Longs1) -> Kept:
    """For twice so many (2,), and for a block of lanes more."""
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
    """Keeps those of the lanes' poses, of a pair of so many contacts, that are among the best."""
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
    """A number from 0 to 1, as good as random, of a match and spin [multiplicative hashing, Knuth]."""
    return float(((row * 2654435761 + spin * 2246822519) ^ (row >> 3)) & 0xFFFFFF) / 0x1000000


@part
def drop_worse(count: int, spared: int, kept: Kept) -> int:
    """Keeps so many of a row, those that cost least; how many there are now."""
    used, pose, cost = kept.used[spared], kept.pose[spared], kept.cost[spared]
    if used <= count:
        return used
    spare = np.empty(used, dtype=np.float32)
    for k in range(used):
        spare[k] = cost[k]
    limit, now = select(spare, used, count - 1), 0
    for k in range(used):
        if cost[k] <= limit and now < count:
            pose[now, 0], pose[now, 1], pose[now, 2], cost[now] = pose[k, 0], pose[k, 1], pose[k, 2], cost[k]
            now += 1
    kept.limit[spared], kept.used[spared] = limit, now
    return now
