import re
from pathlib import Path

import pytest

from tests.examples.scripts import load_script


def test_a_few_grips_are_counted(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    # With one object the first twelve grips have no contacts beside the pads.
    arguments = ["--trials", "16", "--objects", "tea_box", "--out", str(tmp_path)]
    monkeypatch.setattr("sys.argv", ["patch_calibration.py", *arguments])
    load_script("patch_calibration.py").main()
    printed = capsys.readouterr().out
    lines = printed.splitlines()
    assert [re.match(r"[a-z ]+: (\d+) grips", line)[1] for line in lines[:3]] == ["16", "12", "4"]  # type: ignore[index]
    held, complete = re.search(r"holds 95 %: ([0-9.]+)%.*hypotheses ([0-9.]+)%", lines[0]).groups()  # type: ignore[union-attr]
    assert float(held) > 75.0
    assert float(complete) > 90.0
    assert "true pads doubted 0" in lines[0]
    assert (tmp_path / "patch_calibration.txt").read_text(encoding="utf-8") == printed


def test_false_pads_are_noticed(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    arguments = ["--trials", "4", "--objects", "bust", "--false", "1", "--out", str(tmp_path)]
    monkeypatch.setattr("sys.argv", ["patch_calibration.py", *arguments])
    load_script("patch_calibration.py").main()
    missed = re.search(r"false ones not (\d+)", capsys.readouterr().out)
    assert missed is not None
    assert int(missed[1]) <= 1
