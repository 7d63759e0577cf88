"""A file of lines that a run writes as it goes, and that a full disk does not end."""

from pathlib import Path
from typing import TextIO

from tactopose_drake.errors import InvalidFileError


class LineFile:
    """Lines in a new file, each of which is on disk when it is written.

    Attributes:
        count: of the lines that are written.
        problem: why there are no more, in a sentence; empty while all is well.
    """

    def __init__(self, path: Path) -> None:
        """Creates the file; an existing one is replaced.

        Raises:
            InvalidFileError: if it cannot be written.
        """
        self.count, self.problem = 0, ""
        self._path = path
        try:
            self._file: TextIO = path.open("w", encoding="utf-8", buffering=1)
        except OSError as error:
            raise InvalidFileError(f"{path}: cannot be written ({error.strerror}).") from None

    def write(self, line: str) -> None:
        """Adds a line, unless an earlier one could not be written."""
        if self.problem:
            return
        try:
            self._file.write(line + "\n")
        except OSError as error:
            self._fail(error)
        else:
            self.count += 1

    def close(self) -> None:
        """Closes the file."""
        try:
            self._file.close()
        except OSError as error:  # what could not be written before is tried once more
            self._fail(error)

    def _fail(self, error: OSError) -> None:
        self.problem = self.problem or f"{self._path}: ends after {self.count} lines ({error.strerror})."
