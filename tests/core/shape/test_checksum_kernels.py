"""The checksum is XXH64, and notices what happens to files."""

import numpy as np
import pytest

from tactopose_drake.core.shape.checksum_kernels import checksum

MASK = 2**64 - 1
P1, P2, P3, P4 = 0x9E3779B185EBCA87, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9, 0x85EBCA77C2B2AE63


def turn(number: int, bits: int) -> int:
    return ((number << bits) | (number >> (64 - bits))) & MASK


def add(lane: int, word: int) -> int:
    return turn((lane + word * P2) & MASK, 31) * P1 & MASK


def xxh64(words: np.ndarray, seed: int) -> int:
    """As its specification says it, of whole stripes, in numbers without a limit."""
    lanes = [(seed + P1 + P2) & MASK, (seed + P2) & MASK, seed, (seed - P1) & MASK]
    for i, word in enumerate(words):
        lanes[i % 4] = add(lanes[i % 4], int(word))
    total = sum(turn(lane, bits) for lane, bits in zip(lanes, (1, 7, 12, 18), strict=True)) & MASK
    for lane in lanes:
        total = ((total ^ add(0, lane)) * P1 + P4) & MASK
    total = (total + 8 * len(words)) & MASK
    total = (total ^ (total >> 33)) * P2 & MASK
    total = (total ^ (total >> 29)) * P3 & MASK
    return total ^ (total >> 32)


@pytest.mark.parametrize("count", [4, 8, 400])
@pytest.mark.parametrize("seed", [0, 7, 2**63 + 5, MASK])
def test_it_is_the_published_one(count: int, seed: int) -> None:
    words = np.random.default_rng(count).integers(0, 2**64, count, dtype=np.uint64)
    assert checksum(words, seed) == xxh64(words, seed)


def test_it_notices_flipped_bits_and_blocks_that_changed_places() -> None:
    words = np.random.default_rng(0).integers(0, 2**64, 64, dtype=np.uint64)
    sums = {checksum(words, 0)}
    for bit in range(64):
        changed = words.copy()
        changed[bit] ^= np.uint64(1 << bit)
        sums.add(checksum(changed, 0))
    for block in (1, 4, 8):
        changed = words.copy()
        changed[:block], changed[block : 2 * block] = words[block : 2 * block], words[:block]
        sums.add(checksum(changed, 0))
    assert len(sums) == 1 + 64 + 3
