"""Replay of a log with the real drivers: a bus whose frames come from a file, and a clock that shows the log's time.

    with open_log(path) as bus, NetCanOemForceTorque(bus) as sensor:
        sample = sensor.read()

The drivers match the recorded answers to the recorded requests, so that the samples depend on the log alone. A bias
that was set on the host is not in the log: set it again.
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

_LEAD = 0.5  # time from the opening of the bus to the first frame in a paced replay, s


def open_log(path: Path, channel: int = 0, *, paced: bool = False) -> DeviceBus:
    """A bus that replays a log, once.

    Args:
        path: a `.blf` or `.asc` file.
        channel: the bus's number in the log.
        paced: whether it replays in real time in its own thread, starting half a second after the bus is opened. A
            device cannot recover frames that it misses at the beginning: enter all devices before, or even before the
            bus (`with sensor, bus:`). Otherwise, `Device.read` and `DeviceBus.run_until` advance the replay.

    Raises:
        InvalidFileError: if the file cannot be read, is not such a log, or holds no frame.
    """
    frames = log_frames(path)
    try:
        first = next(frames)
    except EndOfLogError as error:
        raise InvalidFileError(f"{path} must hold at least one frame.") from error
    clock = PacedClock(first.timestamp) if paced else VirtualClock(first.timestamp)

    def begin() -> ReplayBus:
        if isinstance(clock, PacedClock):
            clock.set(first.timestamp - _LEAD)
        return ReplayBus(itertools.chain([first], frames), channel, clock)

    return DeviceBus(begin, clock=clock, threaded=paced, follows_log=True)


class PacedClock:
    """A real-time clock with another origin."""

    def __init__(self, start: float) -> None:
        self.set(start)

    def set(self, now: float) -> None:
        """Sets the time, s since the epoch."""
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
        """The time stamp itself: the clock shows the log's time."""
        return stamp


class ReplayBus(can.BusABC):
    """A bus that gives recorded frames, both received and sent, when its clock shows their times."""

    def __init__(self, frames: Iterator[can.Message], channel: int, clock: VirtualClock | PacedClock) -> None:
        """Keeps its arguments.

        Args:
            frames: the recorded frames in order; raises `EndOfLogError` after the last.
            channel: the channel whose frames are given; others are ignored.
            clock: the clock, which shows the log's time.
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
        """Does nothing, since a log takes no requests."""

    def shutdown(self) -> None:
        """Closes the log."""
        super().shutdown()
        self._frames.close()
