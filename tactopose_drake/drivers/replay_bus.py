"""Playing a log through the real drivers: a bus whose frames come from a file, on a clock that shows the log's time.

    with open_log(path) as bus, NetCanOemForceTorque(bus) as sensor:
        sample = sensor.read()

The drivers find the recorded answers to the recorded requests, so what they make of a log depends on the log alone. A
bias that was taken on the host is not in it: set it as it was.
"""

import itertools
import time
from collections.abc import Iterator
from pathlib import Path

import can

from tactopose_drake.drivers.clock import VirtualClock
from tactopose_drake.drivers.device_bus import DeviceBus
from tactopose_drake.drivers.log_frames import log_frames
from tactopose_drake.errors import EndOfLogError, InvalidFileError

_LEAD = 0.5  # s, of a paced replay


def open_log(path: Path, channel: int = 0, *, paced: bool = False) -> DeviceBus:
    """A bus that plays a log, once.

    Args:
        path: of a `.blf` or `.asc` file.
        channel: the bus's number in the log.
        paced: whether it plays as fast as it was recorded, and in a thread of its own, from half a second after the bus
            is opened. What a device misses of the beginning it cannot make up for: let all take part by then, or even
            before (`with sensor, bus:`). Otherwise it plays as fast as it is asked to, by `Device.read` or
            `DeviceBus.run_until`.

    Raises:
        InvalidFileError: if it cannot be read, is no such log, or holds no frame.
    """
    frames = log_frames(path)
    try:
        first = next(frames)
    except EndOfLogError as error:
        raise InvalidFileError(f"{path}: holds no frame.") from error
    clock = PacedClock(first.timestamp) if paced else VirtualClock(first.timestamp)

    def begin() -> ReplayBus:
        if isinstance(clock, PacedClock):
            clock.set(first.timestamp - _LEAD)
        return ReplayBus(itertools.chain([first], frames), channel, clock)

    return DeviceBus(begin, clock=clock, threaded=paced, follows_log=True)


class PacedClock:
    """A clock that runs as fast as the real one, from another time on."""

    def __init__(self, start: float) -> None:
        self.set(start)

    def set(self, now: float) -> None:
        """Makes it this time, s since the epoch."""
        self._offset = now - time.monotonic()

    def time(self) -> float:
        """Seconds since the epoch."""
        return time.monotonic() + self._offset

    def sleep(self, seconds: float) -> None:
        """Waits; `seconds` >= 0."""
        time.sleep(seconds)

    def sleep_until(self, time: float) -> None:
        """Waits until the clock shows `time`."""
        self.sleep(max(0.0, time - self.time()))

    def of_stamp(self, stamp: float) -> float:
        """The stamp: it is of the log, as this clock is."""
        return stamp


class ReplayBus(can.BusABC):
    """A bus that gives recorded frames, received and sent ones, when its clock shows their times."""

    def __init__(self, frames: Iterator[can.Message], channel: int, clock: VirtualClock | PacedClock) -> None:
        """Keeps its arguments.

        Args:
            frames: in the order in which they are given; `EndOfLogError` after the last.
            channel: of the frames that are given; others are passed over.
            clock: shows the log's time.
        """
        super().__init__(channel=channel)
        self.channel_info = f"channel {channel} of a log"
        self._frames = (frame for frame in frames if frame.channel == channel)
        self._clock = clock
        self._ahead: can.Message | None = None

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """The next frame; None if the clock does not reach it within `timeout` s.

        Raises:
            EndOfLogError: after the last frame.
        """
        if self._ahead is None:
            self._ahead = next(self._frames)
        if timeout is not None and self._ahead.timestamp > self._clock.time() + timeout:
            self._clock.sleep(timeout)
            return None
        frame, self._ahead = self._ahead, None
        self._clock.sleep_until(frame.timestamp)
        return frame

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Does nothing: a log cannot be asked."""

    def shutdown(self) -> None:
        """Closes the log."""
        super().shutdown()
        self._frames.close()
