"""Stores the numbers of trials in a file as they are computed, so that an interrupted study of hours can continue.

Each line is a JSON object: the names and values that identify the trial, and its results under "numbers". An incomplete
last line, as an ended process leaves it, is dropped; any other line that does not have this form is an error.
"""

import json
import math
from collections.abc import Mapping
from pathlib import Path

from tactopose_drake.errors import InvalidInputError

Key = Mapping[str, str | int]
Numbers = tuple[float, ...]


class TrialJournal:
    """The numbers of trials, by the names and values that identify a trial."""

    def __init__(self, path: Path | None = None) -> None:
        """Reads the existing file.

        Args:
            path: the file; it is created with the first trial. None keeps the numbers in memory only.

        Raises:
            InvalidInputError: if a line is not a trial.
        """
        self._path = path
        self._numbers: dict[tuple[tuple[str, str | int], ...], Numbers] = {}
        if path is not None and path.exists():
            self._read(path)

    def __len__(self) -> int:
        return len(self._numbers)

    def __contains__(self, key: Key) -> bool:
        return _tuple(key) in self._numbers

    def __getitem__(self, key: Key) -> Numbers:
        return self._numbers[_tuple(key)]

    def add(self, key: Key, numbers: Numbers) -> None:
        """Stores the numbers of one more trial; NaN is null in the file."""
        self._numbers[_tuple(key)] = numbers
        if self._path is not None:
            finite = [None if math.isnan(number) else number for number in numbers]
            with self._path.open("a", encoding="utf-8") as file:
                file.write(json.dumps({**key, "numbers": finite}, ensure_ascii=False, allow_nan=False) + "\n")

    def _read(self, path: Path) -> None:
        lines = path.read_bytes().split(b"\n")
        if lines[-1]:
            with path.open("r+b") as file:
                file.truncate(path.stat().st_size - len(lines[-1]))
        for number, line in enumerate(lines[:-1], start=1):
            try:
                key = json.loads(line)
                numbers = tuple(math.nan if value is None else float(value) for value in key.pop("numbers"))
                self._numbers[_tuple(key)] = numbers
            except (ValueError, TypeError, AttributeError, KeyError) as error:
                raise InvalidInputError(f"{path}: line {number} must be a trial as this program writes it.") from error


def _tuple(key: Key) -> tuple[tuple[str, str | int], ...]:
    return tuple(sorted(key.items()))
