"""Dispatch of a bus's frames to devices, by their identifiers, and to listeners."""

from collections.abc import Callable
from typing import Protocol

import can

from tactopose_drake.drivers.clock import Clock
from tactopose_drake.drivers.frames import ERROR_BUS_OFF, is_ordinary
from tactopose_drake.errors import InvalidInputError

Listener = Callable[[can.Message], None]


class BusUser(Protocol):
    """The interface of a device to the bus; `Device` documents the methods."""

    name: str
    requests: frozenset[int]
    replies: frozenset[int]
    due: float

    def restart(self, time: float) -> None: ...

    def handle(self, frame: can.Message, time: float) -> None: ...

    def poll(self, time: float) -> None: ...

    def follow(self, request: can.Message, time: float) -> None: ...


class FrameDispatch:
    """Passes frames on, and starts and polls devices when they are due; without a bus and without locks.

    Attributes:
        error_frames: number of error frames that the controller has reported.
        is_bus_off: whether the controller has reported bus-off, and only error frames were received since.
    """

    def __init__(self) -> None:
        self.error_frames = 0
        self.is_bus_off = False
        self._devices: tuple[BusUser, ...] = ()
        self._to_start: list[BusUser] = []
        self._askers: dict[int, BusUser] = {}  # by the identifiers of their requests
        self._owners: dict[int, BusUser] = {}  # by those of their replies
        self._listeners: list[Listener] = []

    def attach(self, device: BusUser) -> None:
        """Adds a device.

        Raises:
            InvalidInputError: if another device uses one of its identifiers.
        """
        for other in self._devices:
            for identifier in sorted((device.requests | device.replies) & (other.requests | other.replies)):
                raise InvalidInputError(
                    f"{device.name} must have other identifiers than {other.name} on the same bus, but both have "
                    f"{identifier:#x}."
                )
        self._devices += (device,)
        self._askers.update(dict.fromkeys(device.requests, device))
        self._owners.update(dict.fromkeys(device.replies, device))
        self._to_start.append(device)  # started by `start`, in the thread that does the work

    def detach(self, device: BusUser) -> None:
        """Removes a device."""
        self._devices = tuple(other for other in self._devices if other is not device)
        self._to_start = [other for other in self._to_start if other is not device]
        self._askers = {identifier: other for identifier, other in self._askers.items() if other is not device}
        self._owners = {identifier: other for identifier, other in self._owners.items() if other is not device}

    def listen(self, listener: Listener) -> None:
        """Passes every frame from now on to `listener`, too."""
        self._listeners.append(listener)

    def ignore(self, listener: Listener) -> None:
        """Removes a listener."""
        self._listeners.remove(listener)

    def renew(self) -> None:
        """Marks all devices to be restarted."""
        self._to_start = list(self._devices)

    def start(self, clock: Clock) -> None:
        """Starts the devices that are marked."""
        for device in self._to_start:
            device.restart(clock.time())
        self._to_start.clear()

    def due(self, follows_log: bool) -> float:
        """When a device is due next, s since the epoch: 0 if one must be started; infinity for a log otherwise."""
        if self._to_start:
            return 0.0
        return min((device.due for device in self._devices if not follows_log), default=float("inf"))

    def poll(self, now: float) -> None:
        """Polls the devices that are due."""
        for device in self._devices:
            if now >= device.due:
                device.poll(now)

    def follow(self, request: can.Message) -> None:
        """Passes a request that was sent when a log was recorded to the device whose request it is."""
        asker = self._askers.get(request.arbitration_id)
        if asker is not None:
            asker.follow(request, request.timestamp)

    def hand_on(self, frame: can.Message, now: float) -> None:
        """Passes a received frame to the listeners, and to its device.

        Args:
            frame: the frame; its time stamp is used only for its age.
            now: the time for the device's waits, s since the epoch.
        """
        self.tell(frame)
        if frame.is_error_frame:
            self.error_frames += 1
            self.is_bus_off = self.is_bus_off or bool(frame.arbitration_id & ERROR_BUS_OFF)
            return
        self.is_bus_off = False
        device = self._owners.get(frame.arbitration_id)
        if device is not None and is_ordinary(frame):
            device.handle(frame, now)

    def tell(self, frame: can.Message) -> None:
        """Passes a frame to the listeners."""
        for listener in self._listeners:
            listener(frame)
