"""Whether a replay gives what the run gave."""

import json
import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tactopose_drake.runs import replay_comparison
from tactopose_drake.runs.replay_comparison import ReplayComparison


def line(quaternion: list[float]) -> dict[str, Any]:
    hypothesis = {
        "translation": [0.0, 0.0, 0.1],
        "quaternion_wxyz": quaternion,
        "covariance": np.eye(6).tolist(),
        "probability": 1.0,
    }
    return {"time": 0.5, "fingers_in_contact": ["thumb"], "hypotheses": [hypothesis]}


@pytest.mark.parametrize(
    ("quaternion", "said"),
    [
        ([1.0, 0.0, 0.0, 0.0], ""),
        ([-1.0, 0.0, 0.0, 0.0], ""),
        ([float(np.cos(0.5)), float(np.sin(0.5)), 0.0, 0.0], "the best poses are up to 0 mm and 57.3 degrees apart."),
    ],
)
def test_a_turn_is_a_difference(
    quaternion: list[float], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "estimates.jsonl"
    path.write_text(json.dumps(line([1.0, 0.0, 0.0, 0.0])) + "\n")
    comparison = ReplayComparison(path, is_live=False)
    monkeypatch.setattr(replay_comparison, "estimates_now", lambda diagram, context: line(quaternion))
    comparison.compare(SimpleNamespace(diagram=None, context=None))  # type: ignore[arg-type]
    assert comparison.difference.endswith(said)
    assert bool(comparison.difference) == bool(said)


@pytest.mark.parametrize("change", [{"time": math.nan}, {"hypotheses": []}, {"fingers_in_contact": None}])
def test_what_was_not_recorded_well_is_not_taken_for_the_same(
    change: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "estimates.jsonl"
    path.write_text(json.dumps(line([1.0, 0.0, 0.0, 0.0]) | change) + "\n")
    comparison = ReplayComparison(path, is_live=False)
    monkeypatch.setattr(replay_comparison, "estimates_now", lambda diagram, context: line([1.0, 0.0, 0.0, 0.0]))
    comparison.compare(SimpleNamespace(diagram=None, context=None))  # type: ignore[arg-type]
    assert comparison.difference == "The recorded estimates cannot be read from line 1 on."


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (None, "holds no estimates, so that the replay is not compared with the run."),
        (b"", "holds no estimates, so that the replay is not compared with the run."),
        (json.dumps(line([1.0, 0.0, 0.0, 0.0])).encode().replace(b"thumb", b"th\xffmb") + b"\n", "from line 1 on."),
    ],
)
def test_estimates_that_are_missing_or_no_text_are_not_taken_for_the_same(
    content: bytes | None, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "estimates.jsonl"
    if content is not None:
        path.write_bytes(content)
    comparison = ReplayComparison(path, is_live=False)
    monkeypatch.setattr(replay_comparison, "estimates_now", lambda diagram, context: line([1.0, 0.0, 0.0, 0.0]))
    comparison.compare(SimpleNamespace(diagram=None, context=None))  # type: ignore[arg-type]
    assert comparison.difference.endswith(said)
