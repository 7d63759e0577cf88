"""Simulated devices on a real bus or one of python-can's virtual buses, in real time."""

import collections
import heapq
import itertools
import threading
from collections.abc import Sequence
from typing import Self

import can
from can.interfaces.udp_multicast import UdpMulticastBus

from tactopose_drake.drivers.clock import HOST_CLOCK
from tactopose_drake.drivers.reconnecting_bus import receive
from tactopose_drake.drivers.simulation.simulated_device import SimulatedDevice

_LONGEST_WAIT = 0.02  # for a frame, s; closing may take as long


class DeviceServer:
    """Runs simulated devices in its own thread; a context manager."""

    def __init__(self, bus: can.BusABC, devices: Sequence[SimulatedDevice]) -> None:
        """Keeps its arguments.

        Args:
            bus: an open bus that nothing else uses; the server shuts it down at its end.
            devices: the devices on that bus.
        """
        self._bus, self._devices = bus, devices
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._serve, name=f"simulated devices on {bus}", daemon=True)
        self._waiting: list[tuple[float, int, can.Message]] = []
        self._count = itertools.count()
        # A multicast bus returns sent frames; a device that took its own answer for a request would never stop.
        self._echoes = isinstance(bus, UdpMulticastBus)
        self._sent: collections.Counter[tuple[int, bytes]] = collections.Counter()

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()
        self._bus.shutdown()

    def _serve(self) -> None:
        while not self._stop.is_set():
            wait = self._waiting[0][0] - HOST_CLOCK.time() if self._waiting else _LONGEST_WAIT
            frame = receive(self._bus, min(max(wait, 0.0), _LONGEST_WAIT))
            now = HOST_CLOCK.time()
            if frame is not None and not self._is_echo(frame):
                for device in self._devices:
                    for reply in device.handle(frame, now):
                        heapq.heappush(self._waiting, (now + reply.delay, next(self._count), reply.frame))
            while self._waiting and self._waiting[0][0] <= now:
                self._send(heapq.heappop(self._waiting)[2])

    def _send(self, frame: can.Message) -> None:
        if self._echoes:
            self._sent[frame.arbitration_id, bytes(frame.data)] += 1
        self._bus.send(frame)

    def _is_echo(self, frame: can.Message) -> bool:
        key = frame.arbitration_id, bytes(frame.data)
        if not self._sent[key]:
            return False
        self._sent[key] -= 1
        return True
