from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from click.testing import CliRunner

from tests.examples.scripts import load_script


@pytest.fixture
def script(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    module = load_script("cost_growth.py")
    few = {"CONTACTS": (3, 5), "PADS": ((4, 3),), "SUBDIVISIONS": (2,), "OBJECTS": (1, 2), "PARTICLES": (500, 2000)}
    for name, values in few.items():
        monkeypatch.setattr(module, name, values)
    return module


def test_each_study_has_a_table_and_a_curve(script: ModuleType, tmp_path: Path) -> None:
    result = CliRunner().invoke(script.main, ["--trials", "2", "--seed", "5", "--out", str(tmp_path)])
    assert result.exit_code == 0, result.output
    assert (tmp_path / "cost_growth.png").read_bytes().startswith(b"\x89PNG")
    text = (tmp_path / "cost_growth.md").read_text(encoding="utf-8")
    assert "seed 5" in text
    rows = [line.strip("| ").split(" | ") for line in text.splitlines() if line.startswith("| ") and line[2].isdigit()]
    numbers = np.concatenate([np.array(row, dtype=float) for row in rows])
    assert np.all(numbers > 0.0)
    assert [int(row[0]) for row in rows] == [3, 5, 12, 320, 1, 2, 500, 2000]


def test_more_particles_reach_a_lower_cost(script: ModuleType) -> None:
    curve = script.over_particles(6, 1)
    assert list(curve.lines) == [
        f"{x}, {how}" for x in ("cost", "ms") for how in ("one at a time", "in batches of 100")
    ]
    for name, line in curve.lines.items():
        if name.startswith("cost"):
            assert line[1] < line[0]
