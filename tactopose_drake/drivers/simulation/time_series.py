"""What a simulated device feels, read from a file."""

import dataclasses
from pathlib import Path

import numpy as np

from tactopose_drake.core.validation import FloatArray
from tactopose_drake.drivers.simulation.csv_tables import read_csv_table


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
        InvalidFileError: if the file cannot be read, or has no header, other columns, or times that do not rise.
    """
    _, table = read_csv_table(path, 1 + columns)
    return TimeSeries(table[:, 0], table[:, 1:], start)
