"""A bus that is opened again after a failure."""

import contextlib
from collections.abc import Callable

import can

from tactopose_drake.drivers.clock import Clock

# What python-can's interfaces raise where a bus cannot be opened: their own errors and the operating system's;
# ValueError and TypeError for a channel or an option that they cannot take; ImportError and NotImplementedError where a
# vendor's library is missing or lacks what is asked for. Anything else is a fault of the program, no state of a bus.
_CANNOT_OPEN = (can.CanError, OSError, ValueError, TypeError, ImportError, NotImplementedError)
_BACKOFF = (0.1, 2.0)  # s between two attempts to open a bus again: doubles from the first to the last


class ReconnectingBus:
    """One of python-can's buses, and the way to another when it fails. Its errors become a state.

    Attributes:
        bus: the present one; None where there is none.
        failure: what has gone wrong since it was last opened; empty where all is well.
    """

    def __init__(self, open_bus: Callable[[], can.BusABC], clock: Clock) -> None:
        """Keeps its arguments.

        Args:
            open_bus: makes a bus.
            clock: on which the pauses between two attempts are.
        """
        self._open_bus, self._clock = open_bus, clock
        self.bus: can.BusABC | None = None
        self.failure = ""
        self._retry_at, self._pause = 0.0, 0.0

    def open(self) -> bool:
        """Opens it; whether that worked."""
        try:
            self.bus = self._open_bus()
        except _CANNOT_OPEN as error:
            self.failure = f"cannot be opened ({error})."
            return False
        self.failure = ""
        return True

    def close(self) -> None:
        """Shuts it down."""
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
        """Sends a frame; whether that worked."""
        if self.bus is None:
            return False
        try:
            self.bus.send(frame)
        except (can.CanError, OSError) as error:
            self._lose(error)
            return False
        return True

    def reopen(self, timeout: float) -> bool:
        """Waits for the next attempt, for at most `timeout` s; whether the bus is open again."""
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
    """The next frame on a bus; None after `timeout` s, or sooner where a frame came that the bus's filters reject.

    python-can's own `recv` looks at the clock of day: if that was set back, it would wait until it has caught up.
    """
    if type(bus).recv is not can.BusABC.recv:
        return bus.recv(timeout)
    frame, is_filtered = bus._recv_internal(timeout)
    return frame if frame is None or is_filtered or bus._matches_filters(frame) else None
