"""A bus that is reopened after a failure."""

import contextlib
from collections.abc import Callable

import can

from tactopose_drake.drivers.clock import Clock

# What python-can's interfaces raise if a bus cannot be opened: their own errors and the operating system's; ValueError
# and TypeError for an invalid channel or option; ImportError and NotImplementedError if a vendor's library is missing
# or incomplete. Other exceptions are errors of the program, not states of a bus.
_CANNOT_OPEN = (can.CanError, OSError, ValueError, TypeError, ImportError, NotImplementedError)
_BACKOFF = (0.1, 2.0)  # pauses between attempts to reopen a bus, s: doubled from the first to the last


class ReconnectingBus:
    """One of python-can's buses, which is replaced when it fails. Its errors are stored instead of raised.

    Attributes:
        bus: the present bus; None if there is none.
        failure: the failure since it was last opened; empty if there is none.
    """

    def __init__(self, open_bus: Callable[[], can.BusABC], clock: Clock) -> None:
        """Keeps its arguments.

        Args:
            open_bus: creates a bus.
            clock: clock of the pauses between attempts.
        """
        self._open_bus, self._clock = open_bus, clock
        self.bus: can.BusABC | None = None
        self.failure = ""
        self._retry_at, self._pause = 0.0, 0.0

    def open(self) -> bool:
        """Opens the bus; returns whether that succeeded."""
        try:
            self.bus = self._open_bus()
        except _CANNOT_OPEN as error:
            self.failure = f"cannot be opened ({error})."
            return False
        self.failure = ""
        return True

    def close(self) -> None:
        """Shuts the bus down."""
        bus, self.bus = self.bus, None
        if bus is not None:
            bus.shutdown()

    def recv(self, timeout: float) -> can.Message | None:
        """The next frame; None after `timeout` s, or if the bus fails."""
        try:
            return None if self.bus is None else receive(self.bus, timeout)
        except (can.CanError, OSError) as error:
            self._lose(error)
            return None

    def send(self, frame: can.Message) -> bool:
        """Sends a frame; returns whether that succeeded."""
        if self.bus is None:
            return False
        try:
            self.bus.send(frame)
        except (can.CanError, OSError) as error:
            self._lose(error)
            return False
        return True

    def reopen(self, timeout: float) -> bool:
        """Waits for the next attempt for at most `timeout` s, or makes it; returns whether the bus is open again."""
        wait = self._retry_at - self._clock.time()
        if wait > 0:
            self._clock.sleep(min(wait, timeout))
            return False
        self._pause = min(2 * self._pause, _BACKOFF[1])
        self._retry_at = self._clock.time() + self._pause
        return self.open()

    def _lose(self, error: Exception) -> None:
        with contextlib.suppress(can.CanError, OSError):
            self.close()
        self.failure = f"failed ({error})."
        self._pause = _BACKOFF[0]
        self._retry_at = self._clock.time() + self._pause


def receive(bus: can.BusABC, timeout: float) -> can.Message | None:
    """The next frame on a bus; None after `timeout` s, or sooner if the bus's filters reject a received frame.

    python-can's own `recv` uses the system clock: if that is set back, it waits for as much longer.
    """
    if type(bus).recv is not can.BusABC.recv:
        return bus.recv(timeout)
    frame, is_filtered = bus._recv_internal(timeout)
    return frame if frame is None or is_filtered or bus._matches_filters(frame) else None
