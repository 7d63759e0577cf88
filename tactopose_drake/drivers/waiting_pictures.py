"""A queue of vision messages that are newer than the senses, until the senses catch up."""

from collections import deque
from typing import Generic, TypeVar

_AHEAD = 500_000  # maximum lead of a picture that is kept, microseconds; a larger one means that two clocks differ
_MOST = 128  # maximum number of kept pictures; the oldest are dropped

Picture = TypeVar("Picture")


class WaitingPictures(Generic[Picture]):
    """Messages of vision with their times, in the order of arrival."""

    def __init__(self) -> None:
        self._waiting: deque[tuple[int, Picture]] = deque(maxlen=_MOST)

    def add(self, utime: int, picture: Picture) -> None:
        """Adds a picture with its time, microseconds."""
        self._waiting.append((utime, picture))

    def take(self, utime: int) -> Picture | None:
        """Takes the latest arrival that is not newer than senses of this time, microseconds, and drops earlier ones.

        Pictures up to half a second newer are kept; those with a larger lead are taken like old ones.
        """
        ready, still = list[Picture](), deque[tuple[int, Picture]](maxlen=_MOST)
        for of_picture, picture in self._waiting:
            if utime < of_picture <= utime + _AHEAD:
                still.append((of_picture, picture))
            else:
                ready.append(picture)
        self._waiting = still
        return ready[-1] if ready else None
