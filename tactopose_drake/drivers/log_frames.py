"""Reading the CAN logs of `can_recorder.py`, and of other programs in these formats, up to the first damage."""

import io
import math
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

import can
from can.io.blf import OBJ_HEADER_BASE_STRUCT, BLFParseError

from tactopose_drake.errors import EndOfLogError, InvalidFileError

_LONGEST_GAP = 600.0  # maximum time between two frames, s; the devices are polled, so a larger one is an error
_MOST_BYTES = 8  # maximum size of a frame of classic CAN, whatever its length field
_LARGEST_STEP_BACK = 1.0  # s; frames of several channels need not be sorted
_TOLD = 3  # maximum number of omitted frames that the message lists


def log_frames(path: Path) -> Iterator[can.Message]:
    """The frames of a log in order, both received (`is_rx`) and sent. It always ends with an EndOfLogError.

    A single frame whose time stamp is far from those of its neighbours is omitted if the neighbours' fit each other.

    Args:
        path: a `.blf` or `.asc` file.

    Raises:
        InvalidFileError: at the first frame, if the file cannot be read or is not such a log.
        EndOfLogError: after the last complete frame; the message says whether the log was cut off, and lists the
            omitted frames.
    """
    try:
        file = path.open("rb")
    except OSError as error:
        raise InvalidFileError(f"{path} cannot be read ({error.strerror or error}).") from error
    number, count, last, strays = 0, 0, 0.0, list[str]()
    with file:
        reader, whole = _reader(path, file)
        frames = iter(reader)
        frame, is_sound = _next_of(frames)
        while frame is not None:
            number += 1
            following, is_sound = _next_of(frames)
            if count and following is not None and _is_stray(frame.timestamp, last, following.timestamp):
                strays.append(f"frame {number} at {frame.timestamp:.6f} s")
            elif _follows(frame.timestamp, last if count else None):
                count, last = count + 1, frame.timestamp
                yield frame
            else:
                is_sound = False
                break
            frame = following
        whole = whole and is_sound
        if isinstance(reader, can.ASCReader):
            whole = whole and _ends_properly(path)
    end = (
        f"ended after {count} frames."
        if whole
        else f"is cut off or damaged after {count} whole frames, at {last:.6f} s."
    )
    if strays:
        more = f" and {len(strays) - _TOLD} more" if len(strays) > _TOLD else ""
        end = f"{end} Left out, for time stamps far from their neighbours': {', '.join(strays[:_TOLD])}{more}."
    raise EndOfLogError(f"{path} {end}", whole=whole and not strays)


def _next_of(frames: Iterator[can.Message]) -> tuple[can.Message | None, bool]:
    """The next frame, if it is complete, and whether the log is undamaged up to there."""
    try:
        frame = next(frames, None)
    except Exception:  # python-can's readers raise whatever their parsing runs into
        return None, False
    return (frame, True) if frame is None or _has_all(frame) else (None, False)


def _has_all(frame: can.Message) -> bool:
    """Whether a frame has all its bytes, since a truncated line may still parse. Lengths 9 to 15 mean 8 bytes."""
    length = frame.dlc if frame.is_fd else min(frame.dlc, _MOST_BYTES)
    return frame.is_remote_frame or len(frame.data) == length


def _follows(time: float, last: float | None) -> bool:
    """Whether this time is plausible after the last frame's; a replay would wait for it."""
    if last is None:
        return math.isfinite(time) and time >= 0.0
    return last - _LARGEST_STEP_BACK <= time <= last + _LONGEST_GAP


def _is_stray(time: float, last: float, following: float) -> bool:
    """Whether only this frame's time stamp is wrong, so that its neighbours' fit each other."""
    return _follows(following, last) and not (_follows(time, last) and _follows(following, time))


def _reader(path: Path, file: BinaryIO) -> tuple[can.BLFReader | can.ASCReader, bool]:
    """A reader, and whether the log is complete as far as its header shows."""
    suffix = path.suffix.lower()
    try:
        if suffix == ".blf":
            blf = _SteadyReader(file)
            # The writer stores the size in the header when it closes the file.
            return blf, blf.file_size == path.stat().st_size
        if suffix == ".asc":
            return can.ASCReader(_WholeLines(file, encoding="utf-8"), relative_timestamp=False), True
    except Exception as error:  # as in `_next_of`
        why = repr(error) if path.stat().st_size else "it is empty"
        raise InvalidFileError(f"{path} must be a log of CAN frames ({why}).") from error
    raise InvalidFileError(f"{path} must end in .blf or .asc, not {suffix!r}.")


class _SteadyReader(can.BLFReader):
    """Stops at an object without a length, at which python-can's reader would loop forever."""

    def _parse_data(self, data: bytes) -> Iterator[can.Message]:
        start = 0
        while (start := data.find(b"LOBJ", start, start + 8)) >= 0 and start + OBJ_HEADER_BASE_STRUCT.size <= len(data):
            size = OBJ_HEADER_BASE_STRUCT.unpack_from(data, start)[3]
            if size < OBJ_HEADER_BASE_STRUCT.size:
                yield from super()._parse_data(data[:start])
                raise BLFParseError(f"an object has {size} bytes")
            start += size
        yield from super()._parse_data(data)


class _WholeLines(io.TextIOWrapper):
    """The lines of a file that end in a line feed; another may be truncated within a number."""

    def __next__(self) -> str:  # type: ignore[override]  # as io.TextIOWrapper itself
        line = super().__next__()
        if not line.endswith("\n"):
            raise StopIteration
        return line


def _ends_properly(path: Path) -> bool:
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - 80))
        return file.read().strip().lower().endswith(b"end triggerblock")
