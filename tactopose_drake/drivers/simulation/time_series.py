"""What a simulated device feels, read from a file."""

import dataclasses
import warnings
from pathlib import Path

import numpy as np

from tactopose_drake.core.validation import FloatArray, finite_array
from tactopose_drake.errors import InvalidFileError


@dataclasses.dataclass(frozen=True, eq=False)
class TimeSeries:
    """Values over time; called with a time it gives the row that held then.

    Attributes:
        times: rising, shape (n,), s; the first row holds before the first time too, and the last for ever.
        rows: shape (n, k).
        start: when, in s since the epoch, the file's time 0 is.
    """

    times: FloatArray
    rows: FloatArray
    start: float = 0.0

    def __call__(self, time: float) -> FloatArray:
        row: FloatArray = self.rows[max(0, int(np.searchsorted(self.times, time - self.start, side="right")) - 1)]
        return row


def load_time_series(path: Path, columns: int, start: float = 0.0) -> TimeSeries:
    """Reads a CSV file: one line of names, then rows of a time in s and `columns` numbers.

    Args:
        path: the file.
        columns: 6 for a wrench [m_x, m_y, m_z, f_x, f_y, f_z]; 106 for `HandState.from_row`.
        start: when, in s since the epoch, the file's time 0 is.

    Raises:
        InvalidFileError: if the file cannot be read, or has other columns, or times that do not rise.
    """
    try:
        with warnings.catch_warnings(action="ignore"):  # that there are no rows
            rows = np.loadtxt(path, delimiter=",", skiprows=1, ndmin=2)
        table = finite_array("rows", rows, (None, columns + 1))
    except (OSError, ValueError) as error:
        raise InvalidFileError(f"{path}: {' '.join(str(error).split())}") from error
    if len(table) == 0 or not np.all(np.diff(table[:, 0]) > 0):
        raise InvalidFileError(f"{path}: its times, the first column, must rise, and there must be one at least.")
    return TimeSeries(table[:, 0], table[:, 1:], start)
