"""The estimates of a run as JSON lines, one for each period: their writer, and how they are read."""

import json
from pathlib import Path
from typing import Any, Self

import numpy as np
from pydrake.systems.framework import Context, Diagram

from tactopose_drake.core.validation import (
    LATEST,
    check_count,
    finite_array,
    limited,
    positive_number,
    positive_numbers,
)
from tactopose_drake.estimation.files import hypotheses_data
from tactopose_drake.systems.line_file import LineFile, lines_of, read_line

TEXTS = ("status", "contact_status", "patch_status", "sense_status", "tracked_status")
_UNIT = 1e-3  # largest error of a quaternion's length


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


def read_estimates(path: Path) -> tuple[tuple[dict[str, Any], ...], list[str]]:
    """The lines in order of time, up to the first damaged one, and messages on problems.

    Raises:
        InvalidFileError: if the file cannot be read.
    """
    if not path.is_file():
        return (), [f"{path} is missing, so there are no estimates."]
    lines: list[dict[str, Any]] = []
    for text in lines_of(path):
        line = read_estimate(text)
        if line is None or (lines and line["time"] < lines[-1]["time"]):
            return tuple(lines), [f"{path} cannot be read from line {len(lines) + 1} on."]
        lines.append(line)
    return tuple(lines), []


def read_estimate(text: str) -> dict[str, Any] | None:
    """A line of estimates; None if it is damaged, or one of its numbers is impossible."""
    try:
        line = read_line(text)
        _check(line)
    except (ArithmeticError, AttributeError, LookupError, RecursionError, TypeError, ValueError):
        return None
    return line


def _check(line: dict[str, Any]) -> None:
    """Raises one of several built-in errors if a line is no estimate."""
    limited("time", line["time"], (), most=LATEST)
    for text in (*(line[name] for name in TEXTS if name in line), *line["fingers_in_contact"]):
        text.encode()
    for hypotheses in (line["hypotheses"], line.get("tracked_hypotheses")):
        if hypotheses is not None:
            check_count("hypotheses", len(hypotheses), "poses")
            for hypothesis in hypotheses:
                _check_hypothesis(hypothesis)


def _check_hypothesis(hypothesis: dict[str, Any]) -> None:
    """Likewise for one of its hypotheses."""
    finite_array("translation", hypothesis["translation"], (3,))
    length = float(np.linalg.norm(finite_array("quaternion_wxyz", hypothesis["quaternion_wxyz"], (4,))))
    positive_number("quaternion_wxyz", length, least=1.0 - _UNIT, most=1.0 + _UNIT)
    covariance = finite_array("covariance", hypothesis["covariance"], (6, 6))
    positive_numbers("covariance", np.diag(covariance), (6,), allow_zero=True)
    positive_number("probability", hypothesis["probability"], allow_zero=True)
