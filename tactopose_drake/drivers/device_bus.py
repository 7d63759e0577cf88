"""A CAN bus and the devices on it.

One thread does all the work: it receives, passes each frame to its device, and lets the devices send when they are due.
So no two threads use the bus, and a device needs no locks. (python-can's `Notifier` only receives: polling would need a
second thread, and a lock around every send.) Without the thread, the caller that waits for a sample does the same work;
this is how logs are replayed and tests run in virtual time.
"""

import contextlib
import math
import threading
from collections.abc import Callable
from typing import Any, Self, TypeVar

import can

from tactopose_drake.core.validation import positive_number
from tactopose_drake.drivers.clock import FIRST_EPOCH_STAMP, HOST_CLOCK, Clock
from tactopose_drake.drivers.frame_dispatch import BusUser, FrameDispatch, Listener
from tactopose_drake.drivers.reconnecting_bus import ReconnectingBus
from tactopose_drake.errors import BusError, DriverError, EndOfLogError, UnknownNameError

Found = TypeVar("Found")

_LONGEST_WAIT = 0.02  # for a frame, s; closing may take as long
_MOST_FRAMES = 64  # maximum number of frames that are passed on in one turn


class DeviceBus:
    """A CAN bus that devices share; a context manager.

    A bus that fails is reopened, with growing pauses, and its devices are restarted.

    Attributes:
        name: its name in messages; "bus", unless `open` or the caller sets it.
        clock: the clock of time stamps and waits.
        follows_log: whether the bus replays a log.
        origin: the time to which `keep_up` is relative, s since the epoch; by default the time of opening.
        quiet_until: only one device may send before this time, s since the epoch.
    """

    def __init__(
        self,
        open_bus: Callable[[], can.BusABC],
        *,
        clock: Clock = HOST_CLOCK,
        threaded: bool = True,
        follows_log: bool = False,
    ) -> None:
        """Prepares a bus; `__enter__` opens it.

        Args:
            open_bus: creates the bus, also again after a failure.
            clock: the bus's clock; by default the host's.
            threaded: whether a thread does the work. Otherwise it is done in `Device.read` and `pump`.
            follows_log: whether the bus gives recorded frames, both received and sent. The devices then follow the
                recorded requests, and neither send nor use the clock.
        """
        self.name = "bus"
        self.clock, self.follows_log = clock, follows_log
        self.origin = 0.0
        self.quiet_until = 0.0
        self._speaker: BusUser | None = None
        self._line, self._threaded = ReconnectingBus(open_bus, clock), threaded
        self._dispatch = FrameDispatch()
        self._changed = threading.Condition(threading.RLock())
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None
        self._end: BaseException | None = None  # why the work has ended

    @classmethod
    def open(cls, interface: str, channel: str | int, **options: Any) -> Self:
        """A bus of one of python-can's interfaces.

        Args:
            interface: its name, such as "socketcan", "pcan", "kvaser", "virtual", "udp_multicast".
            channel: the channel, such as "can0"; its form depends on the interface.
            options: options of the interface, such as `bitrate`.

        Raises:
            UnknownNameError: if python-can has no such interface.
        """
        if interface not in can.VALID_INTERFACES:
            raise UnknownNameError("interface", interface, sorted(can.VALID_INTERFACES))
        bus = cls(lambda: can.Bus(interface=interface, channel=channel, ignore_config=True, **options))
        bus.name = f"bus {channel!r} of {interface}"
        return bus

    def __enter__(self) -> Self:
        """Opens the bus.

        Raises:
            BusError: if it cannot be opened.
        """
        if not self._line.open():
            raise BusError(f"{self.name} {self._line.failure}")
        self._end = None
        self.origin = self.clock.time()
        self._stop.clear()
        if self._threaded:
            self._thread = threading.Thread(target=self._work, name=f"devices on {self._line.bus}", daemon=True)
            self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        if self._thread is not None:
            self._thread.join()
            self._thread = None
        self._line.close()
        with self._changed:
            self._end = self._end or BusError(f"{self.name} is closed.")
            self._changed.notify_all()

    @property
    def problem(self) -> str:
        """Why the bus gives no frames; empty if it works."""
        if isinstance(self._end, DriverError):
            return str(self._end)
        if self._end is not None:
            return f"{self.name}: its thread ended with {self._end!r}"
        if self._line.failure:
            return f"{self.name} {self._line.failure}"
        return f"{self.name} is off after too many errors" if self._dispatch.is_bus_off else ""

    @property
    def error_frames(self) -> int:
        """Number of error frames that the controller has reported."""
        return self._dispatch.error_frames

    @property
    def log_end(self) -> EndOfLogError | None:
        """How the replayed log ended; None before its end, and for a real bus."""
        return self._end if isinstance(self._end, EndOfLogError) else None

    def attach(self, device: BusUser) -> None:
        """Adds a device to the bus.

        Raises:
            InvalidInputError: if another device on the bus uses one of its identifiers.
        """
        with self._changed:
            self._dispatch.attach(device)

    def detach(self, device: BusUser) -> None:
        """Removes a device from the bus."""
        with self._changed:
            self._dispatch.detach(device)

    def listen(self, listener: Listener) -> None:
        """Passes every frame that is received (`is_rx`) or sent from now on to `listener`, too, with its time stamp."""
        with self._changed:
            self._dispatch.listen(listener)

    def ignore(self, listener: Listener) -> None:
        """Removes a listener."""
        with self._changed:
            self._dispatch.ignore(listener)

    def wait_for(self, find: Callable[[], Found | None], timeout: float) -> Found | None:
        """Calls `find` after each frame until it returns something.

        Args:
            find: function that is called with the bus's lock held.
            timeout: maximum wait, s.

        Returns:
            The result of `find`; None after the timeout.

        Raises:
            BusError: if the bus has been closed, or its thread has died.
            EndOfLogError: if the bus replays a log that is at its end.
            InvalidInputError: if `timeout` is not a finite number >= 0.
        """
        timeout = positive_number("timeout", timeout, allow_zero=True)
        # The bus's own clock is used only without a thread, since then the caller advances it.
        clock: Clock = HOST_CLOCK if self._threaded else self.clock
        deadline = clock.time() + timeout
        with self._changed:
            while (found := find()) is None:
                if self._end is not None:
                    raise self._end if isinstance(self._end, DriverError) else BusError(self.problem) from self._end
                left = deadline - clock.time()
                if left <= 0:
                    return None
                if self._threaded:
                    self._changed.wait(left)
                else:
                    self.pump(left)
            return found

    def run_until(self, time: float) -> None:
        """Does the bus's work until its clock shows `time`, s since the epoch; only for a bus without a thread.

        Raises:
            EndOfLogError: if the bus replays a log that ends before.
        """
        while (left := time - self.clock.time()) > 0:
            if self._end is not None:
                raise self._end
            self.pump(left)

    def keep_up(self, elapsed: float) -> float:
        """Does the bus's work up to `elapsed` s after the origin, unless its thread does it.

        For callers with their own clock, such as a simulator that replays a log. After the log's end, only the time
        advances.

        Returns:
            That time, s since the epoch. If the caller's clock has gone back, the bus's clock is ahead of it.
        """
        if self._threaded:
            return self.clock.time()
        now = self.origin + elapsed
        with contextlib.suppress(EndOfLogError):
            self.run_until(now)
        self.clock.sleep(max(0.0, now - self.clock.time()))
        return now

    def pump(self, timeout: float) -> None:
        """One turn of the bus's work: waits for a frame, passes it on, and lets the devices send when they are due.

        The frames that have arrived are passed on before, so that a delay of this program makes no answer late.

        Args:
            timeout: maximum wait, s.
        """
        if self._line.bus is None:
            if self._line.reopen(timeout):
                with self._changed:
                    self._dispatch.renew()
            return
        frame = self._receive(max(0.0, min(timeout, self._due() - self.clock.time())))
        with self._changed:
            self._dispatch.start(self.clock)
            count = 0
            while frame is not None:
                self._hand_on(frame)
                count += 1
                frame = self._receive(0.0) if count < _MOST_FRAMES else None
            if not self.follows_log:
                self._dispatch.poll(self.clock.time())
            self._changed.notify_all()

    # The following methods are called by devices, from methods that the bus calls.

    def send(self, frame: can.Message, time: float) -> None:
        """Sends a frame. A failure raises nothing, because the bus is then reopened and its devices are restarted.

        Args:
            frame: the frame.
            time: time of the device's decision to send, s since the epoch; it becomes the frame's time stamp in a log.
        """
        if self._line.send(frame):
            frame.timestamp = time
            self._dispatch.tell(frame)

    def hush(self, speaker: BusUser, until: float) -> None:
        """Lets only one device send before a time, s since the epoch."""
        self.quiet_until, self._speaker = until, speaker

    def is_hushed(self, device: BusUser, now: float) -> bool:
        """Whether a device has to wait until `quiet_until`."""
        return now < self.quiet_until and device is not self._speaker

    def _work(self) -> None:
        try:
            while not self._stop.is_set() and self._end is None:
                self.pump(_LONGEST_WAIT)
        except BaseException as error:
            with self._changed:
                self._end = error
                self._changed.notify_all()

    def _due(self) -> float:
        with self._changed:
            return self._dispatch.due(self.follows_log)

    def _receive(self, timeout: float) -> can.Message | None:
        try:
            return self._line.recv(timeout)
        except EndOfLogError as end:
            self._end = end
            return None

    def _hand_on(self, frame: can.Message) -> None:
        now = self.clock.time()
        is_of_day = FIRST_EPOCH_STAMP <= frame.timestamp < math.inf
        frame.timestamp = self.clock.of_stamp(frame.timestamp) if is_of_day else now
        if self.follows_log and not frame.is_rx:
            self._dispatch.follow(frame)
            return
        frame.is_rx = True  # Some backends set False for frames from another program on this machine.
        # In a replay, devices use the recorded times, so that the result depends on the log alone.
        self._dispatch.hand_on(frame, frame.timestamp if self.follows_log else now)
