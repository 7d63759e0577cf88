"""Recording of the traffic on CAN buses, in python-can's log formats."""

import copy
import struct
import threading
from pathlib import Path
from typing import Self

import can
from can.io.blf import timestamp_to_systemtime

from tactopose_drake.core.validation import either
from tactopose_drake.drivers.device_bus import DeviceBus
from tactopose_drake.errors import InvalidFileError, InvalidInputError

FORMATS = (".blf", ".asc")
# The frames of an unfinished container, about 150, are lost if the process dies.
_BLF_CONTAINER = 8192  # bytes
_FLUSH_AFTER = 100  # number of frames between two flushes of the file
_BLF_START = 40  # offset of the log's start time in the header, bytes


class _TextWriter(can.ASCWriter):
    """Writes the milliseconds of the log's start with three digits; python-can writes 62, which is read as 0.62 s."""

    FORMAT_DATE = "%a %b %d %H:%M:%S.{:03d} %Y"


class CanRecorder:
    """A log of every frame that is received or sent on one or more buses; a context manager.

    `.blf` stores time stamps exactly. `.asc` is human-readable, but rounds them to a microsecond, shifts all of them by
    the same fraction of a millisecond, and does not store the kind of an error frame.

    Attributes:
        problem: why the recording has stopped, as a sentence; empty if it has not.
    """

    def __init__(self, path: Path) -> None:
        """Creates the file.

        Args:
            path: ends in `.blf` or `.asc`; an existing file is replaced.

        Raises:
            InvalidInputError: if the path has another suffix.
            InvalidFileError: if the file cannot be written.
        """
        if path.suffix.lower() not in FORMATS:
            raise InvalidInputError(f"log must be a path that ends in {either(FORMATS)}, not {path}.")
        try:
            self._writer: can.BLFWriter | can.ASCWriter = (
                can.BLFWriter(path, max_container_size=_BLF_CONTAINER)
                if path.suffix.lower() == ".blf"
                else _TextWriter(path)
            )
        except OSError as error:
            raise InvalidFileError(f"{path} cannot be written ({error.strerror or error}).") from error
        self.problem = ""
        self._path = path
        self._lock = threading.Lock()
        self._first: float | None = None
        self._count = 0  # of frames
        self._recorded: list[tuple[DeviceBus, _Track]] = []

    def record(self, bus: DeviceBus, channel: int = 0) -> None:
        """Records a bus from now on.

        Args:
            bus: the bus; attach its devices afterwards, so that the log has their first frames.
            channel: the bus's number in the log.
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
            # The formats store times relative to the first frame, which cannot be negative.
            self._first = copied.timestamp if self._first is None else self._first
            copied.timestamp = max(copied.timestamp, self._first)
            try:
                self._writer.on_message_received(copied)
                if isinstance(self._writer, can.BLFWriter) and self._count == 0:
                    self._date(self._writer)
                self._count += 1
                if self._count % _FLUSH_AFTER == 0:
                    self._writer.file.flush()
            except OSError as error:  # such as a full disk, which ends the log, but not the thread of the bus
                self._fail(error)

    def _fail(self, error: OSError) -> None:
        self.problem = self.problem or f"{self._path} ends after about {self._count} frames ({error.strerror})."

    def _date(self, writer: can.BLFWriter) -> None:
        """Writes the start time into the header, which python-can does only at the end, for logs that are cut off."""
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
