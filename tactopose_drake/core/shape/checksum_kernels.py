"""A checksum at memory speed, which detects every flipped bit and every exchange of blocks.

Source: [C12] Y. Collet, xxHash (XXH64), 2012, of whole stripes of 32 bytes.
"""

from typing import Any

import numpy as np

from tactopose_drake.core.compilation import inlined, kernel
from tactopose_drake.core.kernel_types import Unsigned, UnsignedLongs1

# All numbers are unsigned: mixed with signed ones they would become floats.
_P1: Any = np.uint64(0x9E3779B185EBCA87)
_P2: Any = np.uint64(0xC2B2AE3D27D4EB4F)
_P3: Any = np.uint64(0x165667B19E3779F9)
_P4: Any = np.uint64(0x85EBCA77C2B2AE63)
_1, _7, _12, _18, _29, _31, _32, _33 = (np.uint64(n) for n in (1, 7, 12, 18, 29, 31, 32, 33))
_BYTES, _BITS = np.uint64(8), np.uint64(64)  # of a word
_NOTHING: Any = np.uint64(0)


@kernel
def checksum(words: UnsignedLongs1, seed: Unsigned) -> int:
    """The XXH64 hash of words (4 n,), n >= 1; different for each seed."""
    a, b, c, d = seed + _P1 + _P2, seed + _P2, seed + _NOTHING, seed - _P1
    for i in range(0, words.shape[0] - 3, 4):
        a, b = _add(a, words[i]), _add(b, words[i + 1])
        c, d = _add(c, words[i + 2]), _add(d, words[i + 3])
    total = _turn(a, _1) + _turn(b, _7) + _turn(c, _12) + _turn(d, _18)
    for lane in (a, b, c, d):
        total = (total ^ _add(_NOTHING, lane)) * _P1 + _P4
    total += np.uint64(words.shape[0]) * _BYTES
    total = (total ^ (total >> _33)) * _P2
    total = (total ^ (total >> _29)) * _P3
    return total ^ (total >> _32)


@inlined
def _add(lane, word):
    return _turn(lane + word * _P2, _31) * _P1


@inlined
def _turn(number, bits):
    return (number << bits) | (number >> (_BITS - bits))
