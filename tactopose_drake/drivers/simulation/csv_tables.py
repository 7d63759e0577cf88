"""Reading CSV files of time series; errors name the row and the allowed values."""

import csv
import math
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from tactopose_drake.core.validation import FloatArray, shown
from tactopose_drake.errors import InvalidFileError


def read_csv_table(path: Path, columns: int | None = None) -> tuple[list[str], FloatArray]:
    """Reads a file of a header and rows of finite numbers, the first of which, the time, increases.

    The text is UTF-8, with or without a byte order mark; cells may be in quotes. Empty lines are ignored.

    Args:
        path: the file.
        columns: number of columns, in which case the header is not checked; by default that of the header.

    Returns:
        Names of the columns, and the numbers, shape (n, k), n > 0.

    Raises:
        InvalidFileError: if the file cannot be read, has no header, no rows or an invalid row, or if `columns` is not
            given and the header has a name twice; the message is one line that names the file and the row.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
        lines = [(number, _cells(line)) for number, line in enumerate(text.splitlines(), 1) if line.strip()]
    except (OSError, ValueError, csv.Error) as error:
        raise InvalidFileError(f"{path} cannot be read ({' '.join(str(error).split())}).") from None
    if not lines:
        raise InvalidFileError(f"{path} must have a header and rows of numbers, but is empty.")
    (number, header), *rows = lines
    names = [name.strip() for name in header]
    if any(_number(name) is not None for name in names):
        raise InvalidFileError(f"{path}: row {number} must be a header, the columns' names, not numbers.")
    double = next((name for name in names if names.count(name) > 1), None)
    if columns is None and double is not None:
        raise InvalidFileError(f"{path}: row {number} must name {shown(double)} once, not twice.")
    if not rows:
        raise InvalidFileError(f"{path} must have at least one row below its header, not none.")
    labels = names if columns in (None, len(names)) else [f"column {k}" for k in range(1, 1 + (columns or 0))]
    return names, np.array(list(_numbers(path, labels, rows)))


def _numbers(path: Path, names: Sequence[str], rows: Sequence[tuple[int, list[str]]]) -> Iterator[list[float]]:
    """The rows' numbers; raises InvalidFileError at the first row that does not fit."""
    last = -math.inf
    for row, cells in rows:
        if len(cells) != len(names):
            raise InvalidFileError(f"{path}: row {row} must have {len(names)} columns, not {len(cells)}.")
        values = []
        for name, cell in zip(names, cells, strict=True):
            value = _number(cell)
            if value is None or not math.isfinite(value):
                raise InvalidFileError(f"{path}: row {row}: {name} must be a finite number, not {shown(cell.strip())}.")
            values.append(value)
        if values[0] <= last:
            raise InvalidFileError(
                f"{path}: row {row}: {names[0]} must rise, not be {values[0]:.15g} after {last:.15g}."
            )
        last = values[0]
        yield values


def _cells(line: str) -> list[str]:
    """The cells of a row; one in quotes may hold commas."""
    return next(csv.reader([line], skipinitialspace=True))


def _number(text: str) -> float | None:
    """The number in a text, or None; 1_0 and digits of other scripts, which Python accepts, are not numbers here."""
    try:
        return float(text) if text.isascii() and "_" not in text else None
    except ValueError:
        return None
