"""Encoding and decoding of LCM messages: big-endian numbers and strings, after a fingerprint of the type.

Source: [H10] A. Huang, E. Olson, D. Moore, LCM: Lightweight Communications and Marshalling, 2010, section III.
"""

import struct
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from tactopose_drake.core.validation import FloatArray, shown
from tactopose_drake.errors import ProtocolError


class LcmWriter:
    """Encodes a message."""

    def __init__(self, fingerprint: bytes) -> None:
        """Writes the type's fingerprint, 8 bytes."""
        self._parts = [fingerprint]

    def integers(self, *values: int) -> None:
        """Writes int64_t values."""
        self._parts.append(struct.pack(f">{len(values)}q", *values))

    def counts(self, *values: int) -> None:
        """Writes int32_t values."""
        self._parts.append(struct.pack(f">{len(values)}i", *values))

    def texts(self, *values: str) -> None:
        """Writes strings, each with its length and a terminating zero."""
        for value in values:
            data = value.encode() + b"\0"
            self._parts.append(struct.pack(">i", len(data)) + data)

    def numbers(self, values: ArrayLike) -> None:
        """Writes the doubles of an array of any shape, row by row."""
        self._parts.append(np.asarray(values, dtype=">f8").tobytes())

    def message(self) -> bytes:
        """The encoded message."""
        return b"".join(self._parts)


class LcmReader:
    """Decodes a message; raises ProtocolError if it is too short or invalid."""

    def __init__(self, data: bytes, fingerprint: bytes, kind: str) -> None:
        """Checks the fingerprint.

        Args:
            data: the message.
            fingerprint: the type's fingerprint, 8 bytes.
            kind: the type's name, for error messages.

        Raises:
            ProtocolError: if the message is of another type.
        """
        self._data, self._place, self._kind = data, 0, kind
        if self._take(8) != fingerprint:
            raise ProtocolError(f"LCM message must be a {kind} of this version, but has another fingerprint.")

    def integers(self, count: int) -> tuple[int, ...]:
        """Reads int64_t values."""
        return struct.unpack(f">{count}q", self._take(8 * count))

    def counts(self, count: int) -> tuple[int, ...]:
        """Reads int32_t values, which must not be negative."""
        values = struct.unpack(f">{count}i", self._take(4 * count))
        if min(values, default=0) < 0:
            raise ProtocolError(f"LCM message: a {self._kind} must have lengths >= 0, not {min(values)}.")
        return values

    def texts(self, count: int) -> list[str]:
        """Reads strings; bytes that are not UTF-8 are replaced."""
        return [self._take(self.counts(1)[0])[:-1].decode(errors="replace") for _ in range(count)]

    def names(self, count: int) -> list[str]:
        """Reads strings, which must be unique, so that each names one value."""
        names = self.texts(count)
        double = next((name for name in names if names.count(name) > 1), None)
        if double is not None:
            raise ProtocolError(f"LCM message: a {self._kind} must name {shown(double)} once, not twice.")
        return names

    def numbers(self, shape: Sequence[int]) -> FloatArray:
        """Reads doubles as an array of a shape."""
        data = self._take(8 * int(np.prod(shape, dtype=np.int64)))
        return np.frombuffer(data, dtype=">f8").astype(np.float64).reshape(tuple(shape))

    def end(self) -> None:
        """Raises ProtocolError if there is unread data."""
        if self._place < len(self._data):
            rest = len(self._data) - self._place
            raise ProtocolError(f"LCM message: a {self._kind} must end after {self._place} bytes, not {rest} later.")

    def _take(self, size: int) -> bytes:
        if size > len(self._data) - self._place:
            raise ProtocolError(
                f"LCM message: a {self._kind} must be whole, not cut off after {len(self._data)} bytes."
            )
        self._place += size
        return self._data[self._place - size : self._place]
