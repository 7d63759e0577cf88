"""A bus in virtual time, with simulated devices on its other end.

Nothing here takes real time or a thread: waiting for a frame moves the clock to its arrival.
"""

import copy
import heapq
import itertools
from collections.abc import Sequence

import can

from tactopose_drake.drivers.clock import VirtualClock
from tactopose_drake.drivers.simulation.simulated_device import SimulatedDevice


def bits_of(frame: can.Message) -> int:
    """How many bits a classic frame with an 11-bit identifier takes at most: all possible stuff bits are counted."""
    size = 8 * len(frame.data)
    return 47 + size + (33 + size) // 4


class VirtualTimeBus(can.BusABC):
    """A CAN bus whose time passes in `recv` alone; frames take the time that they take on a wire.

    Attributes:
        unplugged: whether using the bus fails, as with an adapter that is gone.
    """

    def __init__(
        self, devices: Sequence[SimulatedDevice], clock: VirtualClock, bitrate: float = 1e6, unplugged: bool = False
    ) -> None:
        """Keeps its arguments.

        Args:
            devices: that hear what is sent.
            clock: the bus's time.
            bitrate: bit/s.
            unplugged: initial value of the attribute.
        """
        super().__init__(channel="virtual time")
        self.channel_info = "a bus in virtual time"
        self.unplugged = unplugged
        self._devices, self._clock, self._bitrate = devices, clock, bitrate
        self._coming: list[tuple[float, int, can.Message]] = []
        self._count = itertools.count()
        self._free_at = 0.0

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Sends a frame, and has the devices answer it."""
        self._check()
        sent_at = self._free_at = self._arrival(msg, self._clock.time())
        for device in self._devices:
            for reply in device.handle(msg, sent_at):
                ready = sent_at + reply.delay
                heapq.heappush(self._coming, (ready, next(self._count), copy.copy(reply.frame)))

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """The next frame, at once, and the clock at its arrival; None after `timeout` s of the clock's time."""
        self._check()
        if self._coming:
            ready, _, frame = self._coming[0]
            arrival = self._arrival(frame, ready)
            if timeout is None or arrival <= self._clock.time() + timeout:
                heapq.heappop(self._coming)
                frame.timestamp = self._free_at = arrival
                self._clock.sleep_until(arrival)
                return frame
        if timeout is not None:
            self._clock.sleep(timeout)
        return None

    def _arrival(self, frame: can.Message, ready: float) -> float:
        """When a frame that waits for the bus since `ready` has passed over it."""
        return max(ready, self._free_at) + bits_of(frame) / self._bitrate

    def _check(self) -> None:
        if self.unplugged:
            raise can.CanOperationError("the adapter is gone")
