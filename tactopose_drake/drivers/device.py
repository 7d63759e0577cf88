"""The base class of all drivers: a conversation with the device, and its samples.

A driver is one generator, its conversation: it yields an `Exchange` (frames to send, and a callback for the replies) or
a `Pause`, and is resumed when that is over. It uses no threads, sockets or real time, so that the same code runs on a
bus, on a recorded log and in virtual time. The `DeviceBus` runs it. The driver of a device that sends by itself yields
exchanges without frames.
"""

import collections
import dataclasses
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Generator
from typing import Generic, Protocol, Self, TypeVar

import can

from tactopose_drake.drivers.device_bus import DeviceBus
from tactopose_drake.errors import DeviceError, DeviceTimeoutError, ProtocolError

NO_SAMPLE = "no sample yet"
OK = "ok"
_UNREAD = 1024  # maximum number of unread samples; the oldest are dropped


@dataclasses.dataclass(frozen=True, eq=False)
class Exchange:
    """Frames to send, and the answers to wait for. The generator is resumed with True, or with False after a timeout.

    Attributes:
        frames: frames to send, in this order.
        collect: takes a received frame of the device, and returns whether the answer is complete. It may raise
            `ProtocolError`, which is then raised in the generator.
        timeout: maximum wait for the answer, s.
    """

    frames: tuple[can.Message, ...]
    collect: Callable[[can.Message], bool]
    timeout: float


@dataclasses.dataclass(frozen=True)
class Pause:
    """Waits; frames that are received in the meantime are dropped. The generator is resumed with False.

    Attributes:
        duration: duration, s.
    """

    duration: float


Conversation = Generator[Exchange | Pause, bool, None]


class Sampled(Protocol):
    """The attributes of every sample.

    Attributes:
        time: arrival of its last frame, s since the epoch.
        status: "ok", or what is wrong with it.
    """

    @property
    def time(self) -> float: ...

    @property
    def status(self) -> str: ...


Sample = TypeVar("Sample", bound=Sampled)


class Device(ABC, Generic[Sample]):
    """A sensor on a bus, which it uses while it is entered as a context manager.

    Entering it does not wait. A device that does not answer is asked again with growing pauses, and the error of `read`
    gives the reason.
    """

    # Pauses between attempts to talk to a device that does not answer, s: doubled from the first to the last.
    backoff = (0.02, 1.0)

    def __init__(self, bus: DeviceBus, name: str, *, requests: frozenset[int], replies: frozenset[int]) -> None:
        """Keeps its arguments.

        Args:
            bus: the bus that the device is on.
            name: the device's name in messages.
            requests: identifiers of the frames that the driver sends; empty if it only listens.
            replies: identifiers of the frames that the device sends.
        """
        self.bus, self.name, self.requests, self.replies = bus, name, requests, replies
        self.samples = 0  # number of samples so far
        self.due = 0.0  # time of the next call of `poll`, s since the epoch
        self._now = 0.0
        self._state = NO_SAMPLE
        self._newest: Sample | None = None
        self._unread: collections.deque[Sample] = collections.deque(maxlen=_UNREAD)
        self._conversation: Conversation | None = None
        self._step: Exchange | Pause = Pause(0.0)
        self._begun = False
        self._sent = 0  # in a replay, number of frames of the present step that the log has had
        self._failures = 0

    def __enter__(self) -> Self:
        self.bus.attach(self)
        return self

    def __exit__(self, *_: object) -> None:
        self.bus.detach(self)
        if self._conversation is not None:
            self._conversation.close()

    def read(self, timeout: float = 1.0) -> Sample:
        """Returns the oldest unread sample, and waits for one if there is none. At most 1024 unread samples are kept.

        Args:
            timeout: maximum wait, s, finite.

        Raises:
            InvalidInputError: if `timeout` is not a finite number >= 0.
            DeviceTimeoutError: if there is no sample in time; the message has the device's state.
            BusError: if the bus has been closed.
            EndOfLogError: if the bus replays a log that is at its end.
        """
        sample = self.bus.wait_for(self._next_unread, timeout)
        if sample is None:
            raise DeviceTimeoutError(f"{self.name} gave no sample within {timeout:g} s; its state: {self.status}.")
        return sample

    def observe(self, max_age: float, now: float | None = None) -> tuple[Sample | None, float, str]:
        """Returns the newest sample without waiting.

        Args:
            max_age: maximum age of a sample, s; older ones are stale.
            now: time at which the age is taken, s since the epoch, as returned by `DeviceBus.keep_up`; by default the
                time of the bus's clock.

        Returns:
            The newest sample (None if there is none, or it is stale), its age in s (infinite before the first), and the
            sample's status, or else why there is none.
        """
        sample = self._newest
        if sample is None:
            return None, math.inf, self.status
        age = (self.bus.clock.time() if now is None else now) - sample.time
        # A time stamp in the future means that two clocks differ, so that the age is unknown.
        if abs(age) > max_age:
            return None, age, stale(age, max_age) + ("" if self.status == OK else f"; {self.status}")
        return sample, age, sample.status

    @property
    def newest(self) -> Sample | None:
        """The newest sample, whether it has been read or not; None before the first."""
        return self._newest

    @property
    def status(self) -> str:
        """The newest sample's status, or why there are no new samples, without a full stop at the end."""
        return (self.bus.problem or self._state).removesuffix(".")

    # The following methods are called by the bus, from one thread at a time.

    def restart(self, time: float) -> None:
        """Begins the conversation anew, as after a power-up."""
        self._now = time
        if self._conversation is not None:
            self._conversation.close()
        self._conversation = self._repeat()
        self._take(next(self._conversation))

    def handle(self, frame: can.Message, time: float) -> None:
        """Takes a frame of the device that was received at `time`, whatever its time stamp."""
        if self.bus.follows_log and not self.requests:
            self._end_waits(time)
        self._now = time
        if self._begun and isinstance(self._step, Exchange):
            assert self._conversation is not None
            try:
                complete = self._step.collect(frame)
            except ProtocolError as error:
                self._take(self._conversation.throw(error))
            else:
                if complete:
                    self._take(self._conversation.send(True))

    def poll(self, time: float) -> None:
        """Continues the conversation if its wait is over; to be called from `due` on."""
        self._now = time
        if not self._begun:
            self._take(self._step)
        elif time >= self.due:
            assert self._conversation is not None
            self._take(self._conversation.send(False))

    def follow(self, request: can.Message, time: float) -> None:
        """Takes a request that was sent when the log was recorded, which ends all waits before it.

        A request that the driver does not send by itself, such as a command, is ignored.
        """
        self._now = time
        assert self._conversation is not None
        while self._begun and not self._shows_next(request):
            self._take(self._conversation.send(False))
        self._begun = self._begun or self._shows_next(request)

    def _end_waits(self, time: float) -> None:
        """In a replay, ends the waits of a driver that only listens until `time`: no request in the log ends them."""
        assert self._conversation is not None
        while self.due < time:
            self._now = self.due
            self._take(self._conversation.send(False))

    def _shows_next(self, request: can.Message) -> bool:
        """Whether a recorded request is the next one of the present step."""
        if isinstance(self._step, Pause) or self._sent == len(self._step.frames):
            return False
        mine = self._step.frames[self._sent]
        same = mine.arbitration_id == request.arbitration_id and mine.data == request.data
        self._sent += same
        return same

    def _take(self, step: Exchange | Pause) -> None:
        """Begins a step, or postpones it until the device may send."""
        self._step, self._begun, self._sent = step, False, 0
        if isinstance(step, Pause):
            self._begun, self.due = True, self._now + step.duration
        elif self.bus.follows_log:
            self._begun, self.due = not step.frames, self._now + step.timeout
        elif self.bus.is_hushed(self, self._now):
            self.due = self.bus.quiet_until
        else:
            self._begun, self.due = True, self._now + step.timeout
            for frame in step.frames:
                self.bus.send(frame, self._now)

    def _repeat(self) -> Conversation:
        """Repeats the conversation, with growing pauses while it fails."""
        while True:
            try:
                yield from self._converse()
            except (DeviceTimeoutError, DeviceError, ProtocolError) as error:
                self._state = str(error)
            first, last = self.backoff
            yield Pause(min(first * 2.0**self._failures, last))
            self._failures = min(self._failures + 1, 16)

    @abstractmethod
    def _converse(self) -> Conversation:
        """Sets the device up and samples it; returns or raises if it must be set up again."""

    def _publish(self, sample: Sample) -> None:
        self._failures = 0
        self._state = sample.status
        self._newest = sample
        self._unread.append(sample)
        self.samples += 1

    def _next_unread(self) -> Sample | None:
        return self._unread.popleft() if self._unread else None


def stale(age: float, max_age: float) -> str:
    """The status of a reading whose age, s, is farther from 0 than `max_age`; a negative age is of the future."""
    if age < 0.0:
        return f"stale: {-age:.2f} s in the future, and may be at most {max_age:g} s"
    return f"stale: {age:.2f} s old"
