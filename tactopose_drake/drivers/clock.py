"""Clocks: a monotonic one of the host, and a virtual one."""

import math
import time
from typing import Protocol

# Smaller time stamps are not relative to the epoch, but of a clock that a CAN adapter started at power-up.
FIRST_EPOCH_STAMP = 1.0e9

_LEAST_STEP = 5e-3  # smallest step of the system clock that is corrected for, s
_LONGEST_READ = 1e-3  # maximum time in which both clocks must be read to be compared, s


class Clock(Protocol):
    """A clock with a sleep function."""

    def time(self) -> float:
        """Seconds since the epoch."""
        ...

    def sleep(self, seconds: float, /) -> None:
        """Waits; `seconds` >= 0."""
        ...

    def of_stamp(self, stamp: float) -> float:
        """The time of this clock at the time stamp of a frame that has just been received, s since the epoch."""
        ...


class SteadyClock:
    """A monotonic clock with the system clock's time at its creation; later steps of the system clock do not change it.

    Frames are stamped by the system clock; its steps are subtracted from their time stamps.
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
        """The time of this clock when the system clock showed `stamp`, a recent time."""
        before, day, after = time.monotonic(), time.time(), time.monotonic()
        step = day - self._offset - before
        if after - before < _LONGEST_READ and abs(step - self._step) > _LEAST_STEP:
            self._step = step if abs(step) > _LEAST_STEP else 0.0
        return stamp - self._step


HOST_CLOCK = SteadyClock()
"""The clock of all buses without a clock of their own, so that times on different buses are comparable."""


class VirtualClock:
    """Virtual time: `sleep` advances it and returns immediately, so that everything is deterministic."""

    def __init__(self, start: float) -> None:
        self._now = start

    def time(self) -> float:
        """Seconds since the epoch."""
        return self._now

    def sleep(self, seconds: float) -> None:
        """Advances the time, by at least the smallest representable step if `seconds` > 0."""
        if seconds > 0:
            self._now = max(self._now + seconds, math.nextafter(self._now, math.inf))

    def sleep_until(self, time: float) -> None:
        """Advances the time to `time`; it never goes back."""
        self._now = max(self._now, time)

    def of_stamp(self, stamp: float) -> float:
        """The time stamp itself, which is of this clock."""
        return stamp
