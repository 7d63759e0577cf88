"""A text file of JSON that a run writes line by line; a full disk ends the file, but not the run."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, TextIO

from tactopose_drake.errors import InvalidFileError


class LineFile:
    """A new text file; each line is flushed as it is written.

    Attributes:
        count: number of lines written.
        error: why writing has stopped; None while there is no problem.
    """

    def __init__(self, path: Path) -> None:
        """Creates the file; an existing one is replaced.

        Raises:
            InvalidFileError: if it cannot be written.
        """
        self.count = 0
        self.error: OSError | None = None
        self._path = path
        try:
            self._file: TextIO = path.open("w", encoding="utf-8", buffering=1)
        except OSError as error:
            raise InvalidFileError(f"{path} cannot be written ({error.strerror}).") from None

    @property
    def problem(self) -> str:
        """Why writing has stopped, in a sentence; empty while there is no problem."""
        return f"{self._path} ends after {self.count} lines ({self.error.strerror})." if self.error else ""

    def write(self, line: str) -> None:
        """Adds a line; does nothing once an earlier line could not be written."""
        if self.error:
            return
        try:
            self._file.write(line + "\n")
        except OSError as error:
            self.error = error
        else:
            self.count += 1

    def close(self) -> None:
        """Closes the file."""
        try:
            self._file.close()
        except OSError as error:  # Closing tries once more to write what is still buffered.
            self.error = self.error or error


def lines_of(path: Path) -> Iterator[str]:
    """The lines of a file, with their line feeds; the last one has none if the file was cut off.

    Raises:
        InvalidFileError: if the file cannot be read.
    """
    try:
        with path.open(encoding="utf-8", newline="\n") as file:
            yield from file
    except (OSError, UnicodeDecodeError) as error:
        raise InvalidFileError(f"{path} cannot be read ({' '.join(str(error).split())}).") from None


def read_line(line: str) -> dict[str, Any]:
    """The mapping of a line of JSON; raises one of several built-in errors if it is none, or has NaN or a key twice."""
    entry = json.loads(line, object_pairs_hook=_unique, parse_constant=_refuse)
    if not isinstance(entry, dict):
        raise TypeError("it must be a mapping")
    return entry


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    entry = dict(pairs)
    if len(entry) < len(pairs):
        raise ValueError("a key is given twice")
    return entry


def _refuse(text: str) -> float:
    raise ValueError(f"{text} is not a number")
