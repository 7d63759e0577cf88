"""A text file that a run writes line by line; a full disk ends the file, but not the run."""

from pathlib import Path
from typing import TextIO

from tactopose_drake.errors import InvalidFileError


class LineFile:
    """A new text file; each line is flushed as it is written.

    Attributes:
        count: number of lines written.
        problem: why writing has stopped, in a sentence; empty while there is no problem.
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
            raise InvalidFileError(f"{path} cannot be written ({error.strerror}).") from None

    def write(self, line: str) -> None:
        """Adds a line; does nothing once an earlier line could not be written."""
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
        except OSError as error:  # Closing tries once more to write what is still buffered.
            self._fail(error)

    def _fail(self, error: OSError) -> None:
        self.problem = self.problem or f"{self._path} ends after {self.count} lines ({error.strerror})."
