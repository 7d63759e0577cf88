"""Compares the estimates of a replay with those of the recorded run."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from tactopose_drake.core.times import TIME_ROUNDING
from tactopose_drake.core.validation import FloatArray
from tactopose_drake.runs.estimate_writer import estimates_now, read_estimate
from tactopose_drake.runs.stepping import RunView

_SAME = 1e-6  # m, as another processor may round differently
_CLOSE = 0.005  # m by which the best pose of one touch may move from one sample to the next


class _Instant(NamedTuple):
    """The part of a line of estimates that is compared.

    Attributes:
        time: time, s.
        fingers: fingers in contact.
        places: p_PO of the hypotheses, shape (n, 3), m; None if there are none.
        turns: their quaternions wxyz, shape (n, 4).
    """

    time: float
    fingers: frozenset[str]
    places: FloatArray | None
    turns: FloatArray


class ReplayComparison:
    """Compares the estimates of a replay with those in the recording."""

    def __init__(self, path: Path, *, is_live: bool) -> None:
        """Reads the run's estimates.

        Args:
            path: of the recording's `estimates.jsonl`.
            is_live: whether the run was on devices.
        """
        self._is_live, self._damage = is_live, ""
        self._replayed: list[_Instant] = []
        self._recorded: list[_Instant] = []
        self._path = path
        try:
            self._lines = path.read_text(encoding="utf-8", errors="surrogateescape").splitlines()
        except OSError:
            self._lines = []

    def compare(self, view: RunView) -> None:
        """Compares the current estimate with the run's next one, if there is one."""
        count = len(self._recorded)
        if not self._lines:
            self._damage = f"{self._path} holds no estimates, so that the replay is not compared with the run."
        if self._damage or count >= len(self._lines):
            return
        recorded = read_estimate(self._lines[count])
        if recorded is None:
            self._damage = f"The recorded estimates cannot be read from line {count + 1} on."
            return
        self._recorded.append(_instant(recorded))
        self._replayed.append(_instant(estimates_now(view.diagram, view.context)))

    @property
    def difference(self) -> str:
        """A sentence on from when and how much the estimates differ from the run's; empty if they do not."""
        pairs = list(zip(self._replayed, self._recorded, strict=True))
        different = [row for row, pair in enumerate(pairs) if not _is_same(*pair)]
        if not different:
            return self._damage
        text = f"From {self._replayed[different[0]].time:.2f} s on, the estimates are not those of the run"
        if self._is_live and all(self._may_be_timing(row) for row in different):
            return (
                f"{text}: a live run uses the samples that have arrived in time, a replay those that had been sent. "
                "All replays give the same."
            )
        moves = np.array([_distance(*pairs[row]) for row in different])
        unlike, said = int(np.isinf(moves).sum()), []
        if unlike < len(moves):
            turn = max(_turn(*pairs[row]) for row, move in zip(different, moves, strict=True) if np.isfinite(move))
            turned = f" and {np.degrees(turn):.3g} degrees" if turn > _SAME else ""
            said.append(f"the best poses are up to {1e3 * moves[np.isfinite(moves)].max():.3g} mm{turned} apart")
        if unlike:
            said.append(f"at {unlike} of {len(pairs)} times, other fingers touch or one of the two has no pose")
        return f"{text}: {'; '.join(said)}."

    def _may_be_timing(self, row: int) -> bool:
        """Whether samples that arrive up to a period earlier or later can explain the difference in a line."""
        ours, theirs = self._replayed, self._recorded
        around = slice(max(row - 1, 0), row + 2)
        is_at_once = abs(ours[row].time - theirs[row].time) < TIME_ROUNDING
        return is_at_once and _is_between(ours[row], theirs[around]) and _is_between(theirs[row], ours[around])


def _instant(line: dict[str, Any]) -> _Instant:
    """Converts a line of `EstimateWriter`."""
    hypotheses = line["hypotheses"]
    places = None if hypotheses is None else np.array([each["translation"] for each in hypotheses], dtype=np.float64)
    turns = np.array([each["quaternion_wxyz"] for each in hypotheses or ()], dtype=np.float64).reshape(-1, 4)
    return _Instant(float(line["time"]), frozenset(line["fingers_in_contact"]), places, turns)


def _is_same(ours: _Instant, theirs: _Instant) -> bool:
    """Whether two instants agree in time, fingers, positions and orientations."""
    if abs(ours.time - theirs.time) > TIME_ROUNDING or ours.fingers != theirs.fingers:
        return False
    if ours.places is None or theirs.places is None:
        return ours.places is theirs.places
    if ours.places.shape != theirs.places.shape or np.abs(ours.places - theirs.places).max() >= _SAME:
        return False
    # A quaternion and its negative are the same rotation.
    apart = np.minimum(np.abs(ours.turns - theirs.turns), np.abs(ours.turns + theirs.turns))
    return bool(np.abs(apart).max(axis=1).max() < _SAME)


def _distance(ours: _Instant, theirs: _Instant) -> float:
    """Distance of the best poses, m; infinite if the fingers in contact differ, or only one has a pose."""
    if ours.fingers != theirs.fingers or (ours.places is None) != (theirs.places is None):
        return np.inf
    return 0.0 if ours.places is None or theirs.places is None else _gap(ours.places[0], theirs.places[0])


def _turn(ours: _Instant, theirs: _Instant) -> float:
    """Angle between the best poses, rad; 0 if there are none."""
    if not len(ours.turns) or not len(theirs.turns):
        return 0.0
    return 2.0 * float(np.arccos(min(1.0, abs(float(ours.turns[0] @ theirs.turns[0])))))


def _gap(p: FloatArray, q: FloatArray) -> float:
    return float(np.linalg.norm(p - q))


def _is_between(instant: _Instant, others: Sequence[_Instant]) -> bool:
    """Whether an instant's fingers are between those of successive others, and its pose is near one of theirs."""
    fingers = [other.fingers for other in others]
    if not frozenset.intersection(*fingers) <= instant.fingers <= frozenset.union(*fingers):
        return False
    known = [other.places for other in others if other.places is not None]
    if instant.places is None:
        return len(known) < len(others)
    return any(_gap(instant.places[0], place) < _CLOSE for places in known for place in places)
