"""The files that describe tactile arrays: cells, limits, and period."""

import dataclasses
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.sensing.tactile_array import TactileModel
from tactopose_drake.core.sensing.tactile_layout import TactileLayout
from tactopose_drake.core.sensing.tactile_patterns import CapsulePattern, CornerPattern, PointPattern, RowPattern
from tactopose_drake.core.validation import FloatArray, positive_number, told_of
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.resources import load_typed_yaml, sensor_file

# Relative tolerance of the range, as readings are rounded.
_ROUNDING = 1e-3
_LONGEST, _FARTHEST = 0.1, 1.0  # largest edge of a cell and distance from T, m; larger ones must be in millimetres


@dataclasses.dataclass(kw_only=True, slots=True)
class TactilePadFile:
    """A tactile array's YAML file."""

    pattern: RowPattern | CapsulePattern | CornerPattern | PointPattern = dataclasses.field(default_factory=RowPattern)
    model: TactileModel = dataclasses.field(default_factory=TactileModel)
    period: float = 0.025  # between two readings, s


@dataclasses.dataclass(frozen=True, eq=False)
class TactilePad:
    """A tactile array.

    Attributes:
        layout: its cells, in the pad's frame T.
        model: its range, noise and other limits.
        period: time between two readings, s.
    """

    layout: TactileLayout
    model: TactileModel
    period: float

    def known_pressures(self, pressure: FloatArray) -> tuple[FloatArray, NDArray[np.bool_]]:
        """The usable pressures of a frame, and which cells read beyond the range.

        Args:
            pressure: the array's readings, shape (m,), Pa; NaN where there is none.

        Returns:
            The pressures, shape (m,), Pa, with NaN for cells that the file lists as dead and for readings beyond the
            range; and which cells read beyond the range, shape (m,).
        """
        live = np.ones(len(self.layout), dtype=np.bool_)
        live[self.model.dead_cells] = False
        beyond = live & (pressure > (1.0 + _ROUNDING) * self.model.range)
        known = np.where(live & ~beyond, np.minimum(pressure, self.model.range), np.nan)
        return known, beyond


def load_tactile_pad(name_or_path: str | Path) -> TactilePad:
    """Reads a tactile array: one of the package's sensors by name (`bh280_finger`), or any file by path.

    Raises:
        InvalidFileError: if the file cannot be read or does not fit `TactilePadFile`.
        InvalidInputError: if a value is out of its range; the message names the file.
    """
    path = sensor_file(name_or_path, "pattern")
    file = load_typed_yaml(TactilePadFile, path)
    with told_of(f"{path}: "):
        layout = file.pattern.make()
        _check_metres(layout)
        file.model.validate(len(layout))
        positive_number("period", file.period)
    return TactilePad(layout, file.model, file.period)


def _check_metres(layout: TactileLayout) -> None:
    """Raises InvalidInputError if a cell is evidently in millimetres."""
    edges = np.linalg.norm(np.roll(layout.corners, -1, axis=1) - layout.corners, axis=2).max(axis=1)
    distances = np.linalg.norm(layout.p_TC, axis=1)
    for lengths, most, what in (
        (edges, _LONGEST, "have edges of"),
        (distances, _FARTHEST, "be off its frame by"),
    ):
        if lengths.max() > most:
            raise InvalidInputError(
                f"pattern: cell {lengths.argmax()} must {what} at most {most:g} m, not {lengths.max():g} m. Multiply "
                "by 0.001 what is in millimetres."
            )
