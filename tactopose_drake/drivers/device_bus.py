"""A CAN bus and the devices on it.

One thread does all: it receives, gives each frame to the device that it belongs to, and lets the devices send what is
due. So no two threads ever use the bus, and a device needs no locks. (python-can's `Notifier` only receives: polling
would need a second thread, and a lock around every send.) Without the thread, whoever waits for a sample does the same
work; that is how logs are replayed and how tests run in virtual time.
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

_LONGEST_WAIT = 0.02  # for a frame, s; how long closing may take
_MOST_FRAMES = 64  # that are handed on in one turn


class DeviceBus:
    """A CAN bus that devices share; a context manager.

    A bus that fails is opened again, with growing pauses, and its devices are started anew.

    Attributes:
        name: what messages call it; "bus", and where it is, unless set.
        clock: what time stamps are compared with, and waits are made on.
        follows_log: whether the bus replays what was recorded.
        origin: the time at which `keep_up` begins to count, s since the epoch: when the bus was opened, unless set.
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
            open_bus: makes the bus, and makes it again after a failure.
            clock: the host's, unless the bus has its own.
            threaded: whether a thread does the work. Otherwise it is done inside `Device.read` and `pump`.
            follows_log: whether the bus gives recorded frames, sent ones too. The devices then do what they did when
                those were sent; they neither send, nor look at the clock.
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
        self._end: BaseException | None = None  # what ended the thread

    @classmethod
    def open(cls, interface: str, channel: str | int, **options: Any) -> Self:
        """A bus by the name of python-can's interface.

        Args:
            interface: such as "socketcan", "pcan", "kvaser", "virtual", "udp_multicast".
            channel: such as "can0"; what it may be depends on the interface.
            options: the interface's own, such as `bitrate`.

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
            raise BusError(f"{self.name}: {self._line.failure}")
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
            self._end = self._end or BusError(f"{self.name}: is closed.")
            self._changed.notify_all()

    @property
    def problem(self) -> str:
        """Why nothing can come from the bus; empty where all is well."""
        if isinstance(self._end, DriverError):
            return str(self._end)
        if self._end is not None:
            return f"{self.name}: its thread ended with {self._end!r}"
        if self._line.failure:
            return f"{self.name}: {self._line.failure}"
        return f"{self.name}: is off after too many errors" if self._dispatch.is_bus_off else ""

    @property
    def error_frames(self) -> int:
        """How many error frames the controller has reported."""
        return self._dispatch.error_frames

    @property
    def log_end(self) -> EndOfLogError | None:
        """How the log that is replayed ended; None while it goes on, and of a real bus."""
        return self._end if isinstance(self._end, EndOfLogError) else None

    def attach(self, device: BusUser) -> None:
        """Lets a device take part.

        Raises:
            InvalidInputError: if another device on the bus has the same identifiers.
        """
        with self._changed:
            self._dispatch.attach(device)

    def detach(self, device: BusUser) -> None:
        """Ends a device's part."""
        with self._changed:
            self._dispatch.detach(device)

    def listen(self, listener: Listener) -> None:
        """Has every frame that is received (`is_rx`) or sent from now on given to `listener` too, with its time."""
        with self._changed:
            self._dispatch.listen(listener)

    def ignore(self, listener: Listener) -> None:
        """Ends what `listen` began."""
        with self._changed:
            self._dispatch.ignore(listener)

    def wait_for(self, find: Callable[[], Found | None], timeout: float) -> Found | None:
        """Calls `find` after each frame until it finds something.

        Args:
            find: called with the bus's lock held.
            timeout: s.

        Returns:
            What was found; None after the timeout.

        Raises:
            BusError: if the bus was closed, or its thread has died.
            EndOfLogError: if the bus replays a log that is at its end.
            InvalidInputError: if `timeout` is no finite number >= 0.
        """
        timeout = positive_number("timeout", timeout, allow_zero=True)
        # On the bus's own clock only where the caller lets it run.
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
        """Does the bus's work until its clock shows `time`, s since the epoch; not for a bus with a thread of its own.

        Raises:
            EndOfLogError: if the bus replays a log that ends before.
        """
        while (left := time - self.clock.time()) > 0:
            if self._end is not None:
                raise self._end
            self.pump(left)

    def keep_up(self, elapsed: float) -> float:
        """Does the bus's work up to `elapsed` s after the origin, unless its thread does it.

        For who has a clock of his own, such as a simulator that replays a log. After the log's end only time goes on.

        Returns:
            What time that is, s since the epoch. Where the caller's clock has gone back, the bus's is ahead of it.
        """
        if self._threaded:
            return self.clock.time()
        now = self.origin + elapsed
        with contextlib.suppress(EndOfLogError):
            self.run_until(now)
        self.clock.sleep(max(0.0, now - self.clock.time()))
        return now

    def pump(self, timeout: float) -> None:
        """One turn of the bus's work: waits for a frame, hands it on, lets the devices send what is due.

        All frames that are there are handed on before: an answer is not late because this program was.

        Args:
            timeout: longest wait, s.
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

    # For devices, whose methods the bus calls.

    def send(self, frame: can.Message, time: float) -> None:
        """Sends a frame. A bus that fails is opened again; its devices then start anew, so nothing is raised.

        Args:
            frame: to be sent.
            time: when the device decided to, s since the epoch; a log will have it.
        """
        if self._line.send(frame):
            frame.timestamp = time
            self._dispatch.tell(frame)

    def hush(self, speaker: BusUser, until: float) -> None:
        """Has nothing sent before a time, s since the epoch, except by one device."""
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
        frame.is_rx = True  # Some backends say otherwise of what another program on this machine has sent.
        # What devices do in a replay hangs on the log alone, and not on when its frames are played.
        self._dispatch.hand_on(frame, frame.timestamp if self.follows_log else now)
