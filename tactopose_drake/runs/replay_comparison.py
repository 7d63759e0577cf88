"""Whether a replay gives what the run gave that was recorded, and if not, from when on and why."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from tactopose_drake.runs.estimate_writer import estimates_now
from tactopose_drake.runs.stepping import RunView

_SAME = 1e-6  # m: another processor may round otherwise


class ReplayComparison:
    """Compares the estimates of a replay with those in the recording.

    Attributes:
        difference: in a sentence; empty where all estimates so far were the run's.
    """

    def __init__(self, path: Path, *, is_live: bool) -> None:
        """Reads the run's estimates.

        Args:
            path: of the recording's `estimates.jsonl`.
            is_live: whether the run was on devices.
        """
        self.difference = ""
        self._is_live = is_live
        self._count = 0
        try:
            self._lines = path.read_text(encoding="utf-8").splitlines()
        except (OSError, UnicodeDecodeError):
            self._lines = []

    def compare(self, view: RunView) -> None:
        """Compares the present estimate, if the run has one of this number."""
        if self.difference or self._count >= len(self._lines):
            return
        given = estimates_now(view.diagram, view.context)
        try:
            recorded = json.loads(self._lines[self._count])
            same = _is_same(given, recorded)
        except (ArithmeticError, LookupError, RecursionError, TypeError, ValueError):
            self.difference = f"The recorded estimates cannot be read from line {self._count + 1} on."
            return
        self._count += 1
        if not same:
            because = "."
            if self._is_live:
                because = (
                    ": a live run works with what has arrived when its computer comes to it, a replay with what had "
                    "been sent. All replays give the same."
                )
            self.difference = f"From {given['time']:.2f} s on, the estimates are not those of the run{because}"


def _is_same(given: dict[str, Any], recorded: dict[str, Any]) -> bool:
    """Whether two lines of estimates agree in when, whether and where the object is."""
    if abs(given["time"] - recorded["time"]) > 1e-9 or given["fingers_in_contact"] != recorded["fingers_in_contact"]:
        return False
    ours, theirs = given["hypotheses"], recorded["hypotheses"]
    if ours is None or theirs is None:
        return ours is theirs
    places = [np.array([hypothesis["translation"] for hypothesis in each], dtype=np.float64) for each in (ours, theirs)]
    return places[0].shape == places[1].shape and bool(np.abs(places[0] - places[1]).max() < _SAME)
