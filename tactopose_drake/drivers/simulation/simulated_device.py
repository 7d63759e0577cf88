"""The base class of simulated devices, which answer frames, subject to faults."""

import dataclasses
from abc import ABC, abstractmethod

import can

from tactopose_drake.drivers.frames import is_ordinary
from tactopose_drake.drivers.simulation.faults import Fault, Reply

_LATENCY = 2e-4  # s between the end of a request and the first frame of its answer


class SimulatedDevice(ABC):
    """A device at the other end of a bus. It only answers requests, and has no thread or clock of its own.

    Attributes:
        faults: the present faults of its answers, applied in this order; they may be changed at any time.
    """

    def __init__(self) -> None:
        """A device without faults."""
        self.faults: list[Fault] = []
        self._reboot_time = 0.0
        self._back_at = 0.0

    def reboot(self, duration: float = 0.2) -> None:
        """Restarts the device at the next received frame: it does not answer for a while, and loses its settings.

        Args:
            duration: duration of the restart, s.
        """
        self._reboot_time = duration

    def handle(self, frame: can.Message, time: float) -> list[Reply]:
        """The replies of the device to a frame; none if the frame is not meant for it.

        Args:
            frame: the received frame.
            time: time of its reception, s since the epoch.
        """
        if self._reboot_time > 0.0:
            self._back_at, self._reboot_time = time + self._reboot_time, 0.0
            self._forget()
        if time < self._back_at or not is_ordinary(frame):
            return []
        answers = self._answer(frame.arbitration_id, bytes(frame.data), time)
        if answers is None:
            return []
        replies = [Reply(_LATENCY, answer) for answer in answers]
        for fault in tuple(self.faults):
            replies = fault(frame, replies)
        return [dataclasses.replace(reply, delay=max(reply.delay, 0.0)) for reply in replies]

    @abstractmethod
    def _answer(self, arbitration_id: int, data: bytes, time: float) -> list[can.Message] | None:
        """The frames of the answer; None if the request is not meant for the device."""

    @abstractmethod
    def _forget(self) -> None:
        """Returns to the state after power-up."""
