import re
from pathlib import Path

import pytest

from tests.examples.scripts import load_script


def test_each_world_is_tried_with_a_prior_and_without(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    arguments = ["world_not_as_told.py", "--trials", "15", "--objects", "cube", "bust", "mug", "--out", str(tmp_path)]
    monkeypatch.setattr("sys.argv", arguments)
    script = load_script("world_not_as_told.py")
    script.main()
    printed = capsys.readouterr().out
    unexplained = [int(count) for count in re.findall(r"(\d+) no_solution", printed)]
    assert len(unexplained) == 2 * len(script.WORLDS)
    assert max(unexplained[0], unexplained[7]) <= 1
    held = [float(share) for share in re.findall(r"set holds the truth +([0-9.]+)%", printed)]
    assert len(held) == 2 * len(script.WORLDS)
    assert min(held[0], held[7]) > 80.0
    assert min(held) > 50.0
    shares = [float(share) for share in re.findall(r"right +([0-9.]+)%", printed)]
    assert min(shares[0], shares[7]) > 60.0
    assert len((tmp_path / "world_not_as_told.txt").read_text(encoding="utf-8").splitlines()) == 16
