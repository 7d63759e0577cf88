"""What time it is: a steady clock of the host's, or one that only its owner moves."""

import math
import time
from typing import Protocol

# Time stamps below this cannot count from the epoch: they are of a clock that a CAN adapter started at power-up.
FIRST_EPOCH_STAMP = 1.0e9

_LEAST_STEP = 5e-3  # s, by which the clock of day must have been set for that to be noticed
_LONGEST_READ = 1e-3  # s, in which two clocks are read at once


class Clock(Protocol):
    """A clock that can be waited on."""

    def time(self) -> float:
        """Seconds since the epoch."""
        ...

    def sleep(self, seconds: float, /) -> None:
        """Waits; `seconds` >= 0."""
        ...

    def of_stamp(self, stamp: float) -> float:
        """What this clock showed when a frame that has just come in was stamped, s since the epoch."""
        ...


class SteadyClock:
    """Seconds since the epoch as the host's clock of day had them at first; who sets that one later moves nothing.

    Frames are stamped by the clock of day. By how much it was set since, is subtracted from their stamps.
    """

    def __init__(self) -> None:
        self._offset = time.time() - time.monotonic()
        self._step = 0.0

    def time(self) -> float:
        """Seconds since the epoch."""
        return time.monotonic() + self._offset

    def sleep(self, seconds: float) -> None:
        """Waits; `seconds` >= 0."""
        time.sleep(seconds)

    def of_stamp(self, stamp: float) -> float:
        """What this clock showed when the clock of day showed `stamp`, lately."""
        before, day, after = time.monotonic(), time.time(), time.monotonic()
        step = day - self._offset - before
        if after - before < _LONGEST_READ and abs(step - self._step) > _LEAST_STEP:
            self._step = step if abs(step) > _LEAST_STEP else 0.0
        return stamp - self._step


HOST_CLOCK = SteadyClock()
"""The clock of all buses that have none of their own, so that what comes from several can be compared."""


class VirtualClock:
    """Virtual time: it passes when somebody waits, at once. Everything on it is deterministic and takes no time."""

    def __init__(self, start: float) -> None:
        self._now = start

    def time(self) -> float:
        """Seconds since the epoch."""
        return self._now

    def sleep(self, seconds: float) -> None:
        """Lets time pass; by the least step there is where `seconds` is too short for the clock's precision."""
        if seconds > 0:
            self._now = max(self._now + seconds, math.nextafter(self._now, math.inf))

    def sleep_until(self, time: float) -> None:
        """Lets time pass until `time`; it never goes back."""
        self._now = max(self._now, time)

    def of_stamp(self, stamp: float) -> float:
        """The stamp: what is on this clock is stamped by it."""
        return stamp
