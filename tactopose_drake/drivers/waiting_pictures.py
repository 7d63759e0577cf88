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
        ready = [not utime < of_picture <= utime + _AHEAD for of_picture, _ in self._waiting]
        if not any(ready):
            return None
        taken = [picture for (_, picture), is_ready in zip(self._waiting, ready, strict=True) if is_ready][-1]
        still = [entry for entry, is_ready in zip(self._waiting, ready, strict=True) if not is_ready]
        self._waiting = deque(still, maxlen=_MOST)
        return taken
