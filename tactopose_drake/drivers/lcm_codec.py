"""How LCM writes numbers and texts: big-endian, one after the other, behind a fingerprint of the type.

Source: [H10] A. Huang, E. Olson, D. Moore, LCM: Lightweight Communications and Marshalling, 2010, section III.
"""

import struct
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from tactopose_drake.core.validation import FloatArray, shown
from tactopose_drake.errors import ProtocolError


class LcmWriter:
    """Builds the bytes of a message."""

    def __init__(self, fingerprint: bytes) -> None:
        """Begins with the type's fingerprint, 8 bytes."""
        self._parts = [fingerprint]

    def integers(self, *values: int) -> None:
        """int64_t each."""
        self._parts.append(struct.pack(f">{len(values)}q", *values))

    def counts(self, *values: int) -> None:
        """int32_t each."""
        self._parts.append(struct.pack(f">{len(values)}i", *values))

    def texts(self, *values: str) -> None:
        """Strings, each with its length and a zero at its end."""
        for value in values:
            data = value.encode() + b"\0"
            self._parts.append(struct.pack(">i", len(data)) + data)

    def numbers(self, values: ArrayLike) -> None:
        """Doubles, of an array of any shape row by row."""
        self._parts.append(np.asarray(values, dtype=">f8").tobytes())

    def message(self) -> bytes:
        """All of it."""
        return b"".join(self._parts)


class LcmReader:
    """Takes the bytes of a message apart; what is too short, or no such message, is a ProtocolError."""

    def __init__(self, data: bytes, fingerprint: bytes, kind: str) -> None:
        """Checks the fingerprint.

        Args:
            data: the message.
            fingerprint: of the type, 8 bytes.
            kind: the type's name, for messages.

        Raises:
            ProtocolError: if the message is of another type.
        """
        self._data, self._place, self._kind = data, 0, kind
        if self._take(8) != fingerprint:
            raise ProtocolError(f"LCM message: is no {kind} of this version; its fingerprint is another.")

    def integers(self, count: int) -> tuple[int, ...]:
        """int64_t each."""
        return struct.unpack(f">{count}q", self._take(8 * count))

    def counts(self, count: int) -> tuple[int, ...]:
        """int32_t each, none of them negative."""
        values = struct.unpack(f">{count}i", self._take(4 * count))
        if min(values, default=0) < 0:
            raise ProtocolError(f"LCM message: a {self._kind} has a length of {min(values)}; allowed are 0 and more.")
        return values

    def texts(self, count: int) -> list[str]:
        """Strings; letters that are none are replaced."""
        return [self._take(self.counts(1)[0])[:-1].decode(errors="replace") for _ in range(count)]

    def names(self, count: int) -> list[str]:
        """Strings, no two of them the same: of two values by one name nobody knows which counts."""
        names = self.texts(count)
        double = next((name for name in names if names.count(name) > 1), None)
        if double is not None:
            raise ProtocolError(f"LCM message: a {self._kind} names {shown(double)} twice.")
        return names

    def numbers(self, shape: Sequence[int]) -> FloatArray:
        """Doubles, as an array of a shape."""
        data = self._take(8 * int(np.prod(shape, dtype=np.int64)))
        return np.frombuffer(data, dtype=">f8").astype(np.float64).reshape(tuple(shape))

    def end(self) -> None:
        """Raises ProtocolError if there is more than was read."""
        if self._place < len(self._data):
            raise ProtocolError(f"LCM message: a {self._kind} has {len(self._data) - self._place} bytes too many.")

    def _take(self, size: int) -> bytes:
        if size > len(self._data) - self._place:
            raise ProtocolError(f"LCM message: a {self._kind} is cut off after {len(self._data)} bytes.")
        self._place += size
        return self._data[self._place - size : self._place]
