"""What the command line prints on: no name of a file or finger is taken for markup, or tells the terminal anything."""

import logging
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.status import Status
from rich.text import Text

from tactopose_drake.resources import complaint_kind


class PlainConsole(Console):
    """A console that prints text as it is, and letters that are none as Python writes them."""

    def render_str(self, text: str, **options: Any) -> Text:
        """Text without markup, emoji codes and control characters."""
        return super().render_str(printable(text), **options | {"markup": False, "emoji": False})

    def status(self, status: Any, **options: Any) -> "PlainStatus":
        """A spinner with a message, likewise."""
        return PlainStatus(status, console=self, **options)


class PlainStatus(Status):
    """A spinner whose messages are plain."""

    def __init__(self, status: str, **options: Any) -> None:
        """Keeps its arguments."""
        super().__init__(Text(printable(status)), **options)

    def update(self, status: Any = None, **options: Any) -> None:
        """Shows another message."""
        super().update(None if status is None else Text(printable(status)), **options)


def printable(text: str) -> str:
    """Text in which control characters, and what cannot be encoded, are written out as Python does."""
    return "".join(
        letter if letter.isprintable() or letter == "\n" else letter.encode("unicode_escape").decode()
        for letter in text
    )


class OnceFilter(logging.Filter):
    """Lets each kind of message of a log through once.

    Models are read more than once, and what Drake says of one of their lines it mostly says of many.
    """

    def __init__(self) -> None:
        """Has seen nothing."""
        super().__init__()
        self._seen: set[str] = set()

    def filter(self, record: logging.LogRecord) -> bool:
        """Whether the message is the first of its kind."""
        kind = complaint_kind(record.getMessage())
        is_new = kind not in self._seen
        self._seen.add(kind)
        return is_new


OUT = PlainConsole()
ERRORS = PlainConsole(stderr=True, soft_wrap=True, highlight=False)


def print_written(paths: Sequence[Path], earlier: Sequence[Path]) -> None:
    """Says which files have been written, and which of them were there before."""
    written = [path for path in paths if path not in earlier], [path for path in paths if path in earlier]
    for done, which in zip(("Written", "Replaced"), written, strict=True):
        if which:
            OUT.print(f"{done}: {', '.join(map(str, which))}", soft_wrap=True)
