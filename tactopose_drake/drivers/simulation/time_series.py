"""Inputs of a simulated device over time, read from a file."""

import dataclasses
from pathlib import Path

import numpy as np

from tactopose_drake.core.validation import FloatArray
from tactopose_drake.drivers.simulation.csv_tables import read_csv_table


@dataclasses.dataclass(frozen=True, eq=False)
class TimeSeries:
    """Piecewise constant values over time; a call with a time, s since the epoch, returns the row at that time.

    Attributes:
        times: increasing times from which each row holds, shape (n,), s; the first row also holds before.
        rows: the values, shape (n, k).
        start: the time 0 of the file, s since the epoch.
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
        start: the time 0 of the file, s since the epoch.

    Raises:
        InvalidFileError: if the file cannot be read, or has no header, another number of columns, or times that do not
            increase.
    """
    _, table = read_csv_table(path, 1 + columns)
    return TimeSeries(table[:, 0], table[:, 1:], start)
