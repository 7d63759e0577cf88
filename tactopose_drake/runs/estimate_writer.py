"""Writes the estimates of a run as JSON lines, one for each period."""

import json
from pathlib import Path
from typing import Any, Self

from pydrake.systems.framework import Context, Diagram

from tactopose_drake.estimation.files import hypotheses_data
from tactopose_drake.systems.line_file import LineFile

TEXTS = ("status", "contact_status", "patch_status", "sense_status", "tracked_status")


class EstimateWriter:
    """Writes a station's estimates; a context manager.

    A line has `time` (s), the station's status ports, `fingers_in_contact`, and `hypotheses` as in result.json (null
    before the first); with tracking, also `tracked_status` and `tracked_hypotheses`. The lines depend only on the
    measurements: the search's duration is left out.

    Attributes:
        file: the file, with the reason if it could not be written.
    """

    def __init__(self, path: Path) -> None:
        """Creates the file; an existing one is replaced.

        Raises:
            InvalidFileError: if it cannot be written.
        """
        self.file = LineFile(path)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.file.close()

    def write(self, diagram: Diagram, context: Context) -> None:
        """Adds a line with the current values of a station's ports."""
        self.file.write(json.dumps(estimates_now(diagram, context), allow_nan=False))


def estimates_now(diagram: Diagram, context: Context) -> dict[str, Any]:
    """A line of `EstimateWriter` with the current values of a station's ports."""
    line: dict[str, Any] = {"time": context.get_time()}
    line |= {name: diagram.GetOutputPort(name).Eval(context) for name in TEXTS if diagram.HasOutputPort(name)}
    line["fingers_in_contact"] = list(diagram.GetOutputPort("fingers_in_contact").Eval(context))
    for name in ("hypotheses", "tracked_hypotheses"):
        if diagram.HasOutputPort(name):
            estimate = diagram.GetOutputPort(name).Eval(context)
            line[name] = None if estimate is None else hypotheses_data(estimate)
    return line
