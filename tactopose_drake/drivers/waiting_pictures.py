"""Pictures that are newer than the senses: they wait until these are as new."""

from collections import deque
from typing import Generic, TypeVar

_AHEAD = 500_000  # microseconds, by which a picture that waits may be newer; beyond, two clocks differ
_MOST = 128  # that wait, of which the oldest go

Picture = TypeVar("Picture")


class WaitingPictures(Generic[Picture]):
    """What vision said, each with its time, in the order in which it came."""

    def __init__(self) -> None:
        self._waiting: deque[tuple[int, Picture]] = deque(maxlen=_MOST)

    def add(self, utime: int, picture: Picture) -> None:
        """Takes one in, of that time in microseconds."""
        self._waiting.append((utime, picture))

    def take(self, utime: int) -> Picture | None:
        """The last that came of those that need not wait for senses of that time, once; earlier ones are gone."""
        ready, still = list[Picture](), deque[tuple[int, Picture]](maxlen=_MOST)
        for of_picture, picture in self._waiting:
            if utime < of_picture <= utime + _AHEAD:
                still.append((of_picture, picture))
            else:
                ready.append(picture)
        self._waiting = still
        return ready[-1] if ready else None
