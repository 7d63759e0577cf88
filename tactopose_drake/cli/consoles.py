"""The consoles of the command line, which interpret neither markup nor control characters in names."""

import contextlib
import logging
import warnings
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import click
from rich.console import Console
from rich.progress import Progress, ProgressColumn
from rich.status import Status
from rich.table import Table
from rich.text import Text

from tactopose_drake.resources import complaint_kind


class PlainConsole(Console):
    """A console that prints text literally, with unprintable characters escaped as in Python."""

    def render_str(self, text: str, **options: Any) -> Text:
        """Renders text without interpreting markup, emoji codes and control characters."""
        return super().render_str(printable(text), **options | {"markup": False, "emoji": False})

    def status(self, status: Any, **options: Any) -> "PlainStatus":
        """A spinner with a message that is printed literally, too."""
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
    """The text with control characters, and characters that cannot be encoded, escaped as in Python."""
    return "".join(
        letter if letter.isprintable() or letter == "\n" else letter.encode("unicode_escape").decode()
        for letter in text
    )


class OnceFilter(logging.Filter):
    """Passes only the first log message of each kind.

    Models are read more than once, and Drake mostly repeats a warning for many of their lines.
    """

    def __init__(self) -> None:
        """Starts without any message seen."""
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


def tell_warnings(*kinds: type[Warning]) -> None:
    """Lets the command that runs print warnings of these kinds, each once, and without a line of the code."""
    click.get_current_context().with_resource(_telling(kinds))


@contextlib.contextmanager
def _telling(kinds: tuple[type[Warning], ...]) -> Iterator[None]:
    told: set[str] = set()
    with warnings.catch_warnings():
        for kind in kinds:
            warnings.simplefilter("always", kind)
        usual = warnings.showwarning

        def tell(message: Warning | str, category: type[Warning], *place: Any, **options: Any) -> None:
            if not issubclass(category, kinds):
                usual(message, category, *place, **options)
            elif str(message) not in told:
                told.add(str(message))
                ERRORS.print(f"warning: {message}", style="yellow", markup=False, soft_wrap=True)

        warnings.showwarning = tell
        yield


@contextlib.contextmanager
def reporting(files: Iterable[Path | None], *found: Table | str) -> Iterator[None]:
    """Prints what was found, after its files are written, or could not be, and which files were written and replaced.

    It is printed last because a reader that goes away ends the command.
    """
    written = [path for path in files if path is not None]
    earlier = [path for path in written if path.is_file()]
    try:
        yield
    finally:
        for part in found:
            OUT.print(part, soft_wrap=isinstance(part, str))
    print_written(written, earlier)


def print_written(paths: Sequence[Path], earlier: Sequence[Path]) -> None:
    """Prints which files were written, and which of them were replaced."""
    written = [path for path in paths if path not in earlier], [path for path in paths if path in earlier]
    for done, which in zip(("Written", "Replaced"), written, strict=True):
        if which:
            OUT.print(f"{done}: {', '.join(map(str, which))}", soft_wrap=True)


def progress_bar(*columns: ProgressColumn) -> Progress:
    """A progress bar that is removed at the end; without a terminal, nothing is printed."""
    return Progress(*columns, console=ERRORS, transient=True, disable=not ERRORS.is_interactive)
