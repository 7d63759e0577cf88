"""Recording what happens on CAN buses, with python-can's own log formats."""

import copy
import struct
import threading
from pathlib import Path
from typing import Self

import can
from can.io.blf import timestamp_to_systemtime

from tactopose_drake.drivers.device_bus import DeviceBus
from tactopose_drake.errors import InvalidFileError, InvalidInputError

FORMATS = (".blf", ".asc")
# What has not filled a container is lost when the process dies: some 150 frames.
_BLF_CONTAINER = 8192  # bytes
_FLUSH_AFTER = 100  # frames, after which the file is brought up to date
_BLF_START = 40  # bytes from the beginning, where the header has the start of the log


class _TextWriter(can.ASCWriter):
    """Writes the milliseconds of the log's start with all three digits: python-can's 62 would be read as 0.62 s."""

    FORMAT_DATE = "%a %b %d %H:%M:%S.{:03d} %Y"


class CanRecorder:
    """A log of one or more buses, with every frame that was received or sent; a context manager.

    `.blf` keeps time stamps to their last bit. `.asc` is readable, but rounds them to a microsecond, moves all of them
    by the same part of a millisecond, and does not say what an error frame was about.

    Attributes:
        problem: why it records no more, in a sentence; empty while all is well.
    """

    def __init__(self, path: Path) -> None:
        """Creates the file.

        Args:
            path: ends in `.blf` or `.asc`; an existing file is replaced.

        Raises:
            InvalidInputError: for another ending.
            InvalidFileError: if the file cannot be written.
        """
        if path.suffix.lower() not in FORMATS:
            raise InvalidInputError(f"log: {path} ends in {path.suffix!r}; allowed are {' and '.join(FORMATS)}.")
        try:
            self._writer: can.BLFWriter | can.ASCWriter = (
                can.BLFWriter(path, max_container_size=_BLF_CONTAINER)
                if path.suffix.lower() == ".blf"
                else _TextWriter(path)
            )
        except OSError as error:
            raise InvalidFileError(f"{path}: {error}") from error
        self.problem = ""
        self._path = path
        self._lock = threading.Lock()
        self._first: float | None = None
        self._count = 0  # of frames
        self._recorded: list[tuple[DeviceBus, _Track]] = []

    def record(self, bus: DeviceBus, channel: int = 0) -> None:
        """Records a bus from now on.

        Args:
            bus: to be recorded; attach its devices afterwards, so that the log has how they begin.
            channel: its number in the log.
        """
        track = _Track(self, channel)
        self._recorded.append((bus, track))
        bus.listen(track)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        for bus, track in self._recorded:
            bus.ignore(track)
        with self._lock:
            try:
                self._writer.stop()
            except OSError as error:
                self._fail(error)

    def write(self, frame: can.Message, channel: int) -> None:
        """Adds a frame to the log; from any thread."""
        copied = copy.copy(frame)
        copied.channel = channel
        with self._lock:
            if self.problem:
                return
            # The formats count from the first frame, and know no time before it.
            self._first = copied.timestamp if self._first is None else self._first
            copied.timestamp = max(copied.timestamp, self._first)
            try:
                self._writer.on_message_received(copied)
                if isinstance(self._writer, can.BLFWriter) and self._count == 0:
                    self._date(self._writer)
                self._count += 1
                if self._count % _FLUSH_AFTER == 0:
                    self._writer.file.flush()
            except OSError as error:  # a full disk ends the log, and not the thread of the bus
                self._fail(error)

    def _fail(self, error: OSError) -> None:
        self.problem = self.problem or f"{self._path}: ends after about {self._count} frames ({error.strerror})."

    def _date(self, writer: can.BLFWriter) -> None:
        """Puts the start into the header, which python-can does at the end: a log that is cut off has its times too."""
        end = writer.file.tell()
        writer.file.seek(_BLF_START)
        writer.file.write(struct.pack("<8H", *timestamp_to_systemtime(writer.start_timestamp)))
        writer.file.seek(end)
        writer.file.flush()


class _Track:
    """One bus in a log."""

    def __init__(self, recorder: CanRecorder, channel: int) -> None:
        self._recorder, self._channel = recorder, channel

    def __call__(self, frame: can.Message) -> None:
        self._recorder.write(frame, self._channel)
