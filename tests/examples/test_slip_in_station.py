import re
from pathlib import Path

import pytest

from tests.examples.scripts import load_script


def test_a_heavy_object_slides_and_is_followed(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    arguments = ["slip_in_station.py", "--objects", "bust", "--seconds", "0.3", "--rates", "20", "--out", str(tmp_path)]
    monkeypatch.setattr("sys.argv", arguments)
    load_script("slip_in_station.py").main()
    printed = capsys.readouterr().out
    found = re.search(r"error ([0-9.]+) mm before and ([0-9.]+) mm after", printed)
    assert found is not None
    assert float(found[1]) < 15.0
    slides = re.search(r"of 1 slides of 10 mm or more (\d) are called so within 50 ms", printed)
    assert slides is not None, printed
    assert slides[1] == "1"
    going = re.search(r"of (\d+) instants at which a slide goes on it says slipping at (\d+), ok at (\d+)", printed)
    assert going is not None, printed
    assert int(going[2]) > 0.5 * int(going[1]) > 0
    assert (tmp_path / "slip_in_station.txt").read_text(encoding="utf-8").strip() in printed
    assert (tmp_path / "slip_in_station.png").read_bytes().startswith(b"\x89PNG")


def test_a_slide_goes_on_where_the_object_has_slid_by_a_millimetre_lately() -> None:
    study = load_script("slip_in_station.py")
    ways = [0.0, 0.0005, 0.0012, 0.0015, 0.0018, 0.0021, 0.0024, 0.0024, 0.0024]
    rows = [study.Row(0.01 * i, 1.0, way, str(i), 0.0, 0.0, 0.0) for i, way in enumerate(ways)]
    assert study.while_sliding(rows) == ["2", "3", "4", "5", "6", "7"]
