"""What time it is: the host's clock, or one that only its owner moves."""

import math
from typing import Protocol

# Time stamps below this cannot count from the epoch: they are of a clock that a CAN adapter started at power-up.
FIRST_EPOCH_STAMP = 1.0e9


class Clock(Protocol):
    """A clock that can be waited on; the module `time` is one."""

    def time(self) -> float:
        """Seconds since the epoch."""
        ...

    def sleep(self, seconds: float, /) -> None:
        """Waits; `seconds` >= 0."""
        ...


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
