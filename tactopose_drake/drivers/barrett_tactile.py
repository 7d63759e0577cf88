"""The tactile arrays of Barrett's BH8-280 hand: conversion of frames to pressures, and back.

An array has 24 cells. A full reading has five frames of five 12-bit cells; a short one has the ten highest cells in one
frame. Sources as in `barrett_protocol.py`; the full reading of raw values 1 to 24 begins with 0001002003004005.
"""

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.validation import FloatArray
from tactopose_drake.errors import ProtocolError

CELLS = 24
FRAMES = 5  # in a full reading
CELLS_IN_FRAME = 5
TOP_CELLS = 10
RAW_MAX, TOP_MAX = 4095, 15
PASCALS_PER_RAW = 1e4 / 256  # raw values are in 1/256 N/cm^2
PASCALS_PER_TOP = 1e4  # values of the short reading are in N/cm^2

RawCells = NDArray[np.int64]


def encode_full(raw: RawCells) -> list[bytes]:
    """The five frames of a full reading.

    Args:
        raw: shape (24,), 0 to 4095.
    """
    words = np.append(raw, 0).reshape(FRAMES, CELLS_IN_FRAME).tolist()
    return [_pack(sequence, cells) for sequence, cells in enumerate(words)]


def decode_full_frame(data: bytes) -> tuple[int, list[int]]:
    """The sequence number of one frame of a full reading, and its raw cells: five, or four in the last frame."""
    if len(data) != 8:
        raise ProtocolError(f"tactile frame must have 8 bytes, not {len(data)}.")
    word = int.from_bytes(data, "big")
    sequence = word >> 60
    if sequence >= FRAMES:
        raise ProtocolError(f"tactile frame must have a sequence number from 0 to {FRAMES - 1}, not {sequence}.")
    cells = [word >> shift & 0xFFF for shift in (48, 36, 24, 12, 0)]
    return sequence, cells[: CELLS - CELLS_IN_FRAME * sequence]


def encode_top(levels: dict[int, int]) -> bytes:
    """The frame of a short reading.

    Args:
        levels: pressures in N/cm^2, integers from 0 to 15, by cell, 0 to 23; at most ten.
    """
    mask = sum(1 << cell for cell in levels)
    nibbles = [levels[cell] for cell in sorted(levels)]
    word = mask
    for nibble in nibbles + [0] * (TOP_CELLS - len(nibbles)):
        word = word << 4 | nibble
    return word.to_bytes(8, "big")


def decode_top(data: bytes) -> dict[int, int]:
    """The pressures of a short reading in N/cm^2, integers from 0 to 15, by cell, 0 to 23."""
    if len(data) != 8:
        raise ProtocolError(f"tactile frame must have 8 bytes, not {len(data)}.")
    mask = int.from_bytes(data[:3], "big")
    cells = [cell for cell in range(CELLS) if mask >> cell & 1]
    if len(cells) > TOP_CELLS:
        raise ProtocolError(f"tactile frame must name at most {TOP_CELLS} cells, not {len(cells)}.")
    levels = int.from_bytes(data[3:], "big")
    return {cell: levels >> 4 * (TOP_CELLS - 1 - k) & 0xF for k, cell in enumerate(cells)}


def full_pressures(raw: list[int]) -> FloatArray:
    """Pressures of the 24 cells, Pa."""
    return PASCALS_PER_RAW * np.array(raw, dtype=np.float64)


def top_pressures(levels: dict[int, int]) -> FloatArray:
    """Pressures of the 24 cells, Pa; NaN for cells that the short reading does not have."""
    pressures = np.full(CELLS, np.nan)
    pressures[list(levels)] = PASCALS_PER_TOP * np.array(list(levels.values()), dtype=np.float64)
    return pressures


class FullReading:
    """Assembles a reading from its five frames; a frame out of order discards it."""

    def __init__(self) -> None:
        self._raw: list[int] = []

    def add(self, data: bytes) -> list[int] | None:
        """Takes one frame.

        Returns:
            The 24 raw cells if it is the fifth frame; else None.

        Raises:
            ProtocolError: if the frame is out of order; the frames before it are discarded.
        """
        gathered, self._raw = self._raw, []
        sequence, cells = decode_full_frame(data)
        expected = len(gathered) // CELLS_IN_FRAME
        if sequence in (0, expected):
            self._raw = gathered + cells if sequence == expected else cells
        if sequence != expected:
            raise ProtocolError(f"tactile frame must have the sequence number {expected}, not {sequence}.")
        if len(self._raw) < CELLS:
            return None
        raw, self._raw = self._raw, []
        return raw


def _pack(sequence: int, cells: list[int]) -> bytes:
    word = sequence
    for cell in cells:
        word = word << 12 | cell
    return word.to_bytes(8, "big")
