import re
import runpy
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[2] / "examples" / "calibration_study.py"


def test_a_hand_is_drawn_calibrated_and_tried(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    options = ["--grasps", "6", "--trials", "1", "--others", "bust"]
    monkeypatch.setattr("sys.argv", ["calibration_study.py", *options])
    runpy.run_path(str(SCRIPT), run_name="__main__")
    printed = " ".join(capsys.readouterr().out.split())
    assert "1 hands, 6 grasps of spray_bottle each" in printed
    medians = re.search(r"median ([0-9.]+) mm known, ([0-9.]+) mm calibrated, ([0-9.]+) mm as it is", printed)
    assert medians is not None
    known, calibrated, as_it_is = map(float, medians.groups())
    assert known < as_it_is
    assert calibrated < 50.0
    inside = re.search(r"([0-9.]+)% of 83 errors in their own 95 % intervals", printed)
    assert inside is not None
    assert float(inside[1]) > 60.0
