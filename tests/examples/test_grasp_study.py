import re
import runpy
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[2] / "examples" / "grasp_study.py"


def test_one_grasp_is_studied_and_summed_up(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["--perfect", "--objects", "tea_box", "--first-seed", "5", "--seeds", "1"]
    monkeypatch.setattr("sys.argv", ["grasp_study.py", *arguments])
    runpy.run_path(str(SCRIPT), run_name="__main__")
    printed = " ".join(capsys.readouterr().out.split())
    assert "1 grasps in" in printed
    assert "0 failed to hold" in printed
    contact_error = re.search(r"Contact points or centroids: median error ([0-9.]+) mm of [3-5]\.", printed)
    assert contact_error is not None
    assert float(contact_error[1]) < 0.5
    assert "Both errors fell in 100%" in printed
