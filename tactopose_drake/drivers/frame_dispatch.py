"""To whom the frames of a bus belong: the devices that take part, by their identifiers, and those who only listen."""

from collections.abc import Callable
from typing import Protocol

import can

from tactopose_drake.drivers.clock import Clock
from tactopose_drake.drivers.frames import ERROR_BUS_OFF, is_ordinary
from tactopose_drake.errors import InvalidInputError

Listener = Callable[[can.Message], None]


class BusUser(Protocol):
    """What the bus knows of a device; `Device` says what the methods do."""

    name: str
    requests: frozenset[int]
    replies: frozenset[int]
    due: float

    def restart(self, time: float) -> None: ...

    def handle(self, frame: can.Message, time: float) -> None: ...

    def poll(self, time: float) -> None: ...

    def follow(self, request: can.Message, time: float) -> None: ...


class FrameDispatch:
    """Hands frames on, and has devices start and send when it is time; needs no bus, and no lock of its own.

    Attributes:
        error_frames: how many the controller has reported.
        is_bus_off: whether the last that was heard of the controller is that it has switched itself off.
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
        """Lets a device take part.

        Raises:
            InvalidInputError: if another device has the same identifiers.
        """
        for other in self._devices:
            for identifier in sorted((device.requests | device.replies) & (other.requests | other.replies)):
                raise InvalidInputError(
                    f"{device.name}: has the identifier {identifier:#x}, which {other.name} on the same bus has too."
                )
        self._devices += (device,)
        self._askers.update(dict.fromkeys(device.requests, device))
        self._owners.update(dict.fromkeys(device.replies, device))
        self._to_start.append(device)  # by whoever does the work

    def detach(self, device: BusUser) -> None:
        """Ends a device's part."""
        self._devices = tuple(other for other in self._devices if other is not device)
        self._to_start = [other for other in self._to_start if other is not device]
        self._askers = {identifier: other for identifier, other in self._askers.items() if other is not device}
        self._owners = {identifier: other for identifier, other in self._owners.items() if other is not device}

    def listen(self, listener: Listener) -> None:
        """Has every frame from now on told to `listener` too."""
        self._listeners.append(listener)

    def ignore(self, listener: Listener) -> None:
        """Ends what `listen` began."""
        self._listeners.remove(listener)

    def renew(self) -> None:
        """Has all devices start anew."""
        self._to_start = list(self._devices)

    def start(self, clock: Clock) -> None:
        """Starts the devices that wait for it."""
        for device in self._to_start:
            device.restart(clock.time())
        self._to_start.clear()

    def due(self, follows_log: bool) -> float:
        """When the first device wants to go on, s since the epoch; where a log is followed none does by itself."""
        if self._to_start:
            return 0.0
        return min((device.due for device in self._devices if not follows_log), default=float("inf"))

    def poll(self, now: float) -> None:
        """Lets the devices go on that are due."""
        for device in self._devices:
            if now >= device.due:
                device.poll(now)

    def follow(self, request: can.Message) -> None:
        """Gives a frame that was sent when a log was recorded to the device that asks so."""
        asker = self._askers.get(request.arbitration_id)
        if asker is not None:
            asker.follow(request, request.timestamp)

    def hand_on(self, frame: can.Message, now: float) -> None:
        """Gives a received frame to the listeners, and to the device that it belongs to.

        Args:
            frame: as received; its stamp says how old it is, and is not believed for more.
            now: by which the device paces itself, s since the epoch.
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
        """Gives a frame to the listeners."""
        for listener in self._listeners:
            listener(frame)
