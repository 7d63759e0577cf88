"""A bus in virtual time, with simulated devices at its other end.

It needs no real time and no thread: waiting for a frame sets the clock to its arrival.
"""

import copy
import heapq
import itertools
from collections.abc import Sequence

import can

from tactopose_drake.drivers.clock import VirtualClock
from tactopose_drake.drivers.simulation.simulated_device import SimulatedDevice


def bits_of(frame: can.Message) -> int:
    """The maximum number of bits of a classic frame with an 11-bit identifier, with all possible stuff bits."""
    size = 8 * len(frame.data)
    return 47 + size + (33 + size) // 4


class VirtualTimeBus(can.BusABC):
    """A CAN bus whose time advances only in `recv`; frames take as long as on a real bus.

    Attributes:
        unplugged: whether the bus fails when it is used, like an adapter that was unplugged.
    """

    def __init__(
        self, devices: Sequence[SimulatedDevice], clock: VirtualClock, bitrate: float = 1e6, unplugged: bool = False
    ) -> None:
        """Keeps its arguments.

        Args:
            devices: the devices on the bus.
            clock: the bus's clock.
            bitrate: bit rate, bit/s.
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
        """Sends a frame, which the devices answer."""
        self._check()
        sent_at = self._free_at = self._arrival(msg, self._clock.time())
        for device in self._devices:
            for reply in device.handle(msg, sent_at):
                ready = sent_at + reply.delay
                heapq.heappush(self._coming, (ready, next(self._count), copy.copy(reply.frame)))

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """Returns the next frame, with the clock at its arrival; None after `timeout` s of the clock's time."""
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
        """When the transmission of a frame that waits for the bus since `ready` is complete."""
        return max(ready, self._free_at) + bits_of(frame) / self._bitrate

    def _check(self) -> None:
        if self.unplugged:
            raise can.CanOperationError("the adapter is gone")
