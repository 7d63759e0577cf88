import re
from pathlib import Path

import pytest
import trimesh
from click.testing import CliRunner

from tests.examples.scripts import load_script


def test_names_and_reliability_are_counted_and_drawn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    script = load_script("unknown_objects.py")
    scans = tmp_path / "scans"
    scans.mkdir()
    for name, size in {"box": (0.1, 0.06, 0.04), "slab": (0.12, 0.1, 0.015), "bar": (0.2, 0.03, 0.03)}.items():
        trimesh.creation.box(size).export(scans / f"{name}.obj")
    monkeypatch.setattr(script, "model_path", lambda *parts: scans)
    monkeypatch.setattr(script, "GENERATED", 3)
    options = [
        "--trials",
        "12",
        "--known",
        "4",
        "--contacts",
        "8",
        "--scans",
        str(scans),
        "--out",
        str(tmp_path / "out"),
    ]
    result = CliRunner().invoke(script.main, options)
    assert result.exit_code == 0, result.output
    counts = re.search(r"12 touches, (\d+) of them of unknown objects", result.output)
    assert counts is not None
    assert 0 < int(counts[1]) < 12
    names = re.search(r"more than 95%\s+(\d+)\s+(\d+)\s+(\d+)", result.output)
    assert names is not None
    assert int(names[1]) > int(names[3])
    bins = re.findall(r"^\s*[0-9.]+ to [0-9.]+\s+(\d+)\s", result.output, re.MULTILINE)
    assert sum(map(int, bins)) == 12
    assert (tmp_path / "out" / "unknown.png").stat().st_size > 1000
