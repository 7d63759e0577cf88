import re
from pathlib import Path

import numpy as np
import pytest

from tests.examples.scripts import load_script


def test_a_few_motions_are_followed_and_drawn(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    arguments = ["in_hand_motions.py", "--motions", "4", "--steps", "40", "--out", str(tmp_path)]
    monkeypatch.setattr("sys.argv", arguments)
    load_script("in_hand_motions.py").main()
    printed = capsys.readouterr().out
    summary = re.search(
        r"all: 4 motions, 160 instants; a right mode in ([0-9.]+)%, the best is right in ([0-9.]+)%, "
        r'"ok" while wrong in ([0-9.]+)%; .* NEES there ([0-9.]+)',
        printed,
    )
    assert summary is not None
    assert float(summary[1]) > 75.0
    assert float(summary[2]) <= float(summary[1])
    assert float(summary[3]) < 10.0
    assert 1.0 < float(summary[4]) < 20.0
    assert (tmp_path / "in_hand_motions.txt").read_text(encoding="utf-8").strip() in printed
    assert (tmp_path / "in_hand_motions.png").read_bytes().startswith(b"\x89PNG")


def test_a_calibration_that_is_worse_than_told_leaves_the_belief_less_often_right() -> None:
    run_motion = load_script("motion_trial.py").run_motion
    right = {scale: np.mean([i.right for s in range(3) for i in run_motion("roll", s, 40, scale)]) for scale in (1, 24)}
    assert right[1] > 0.95
    assert right[24] < right[1]
