import importlib
import re
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
import yaml
from click.testing import CliRunner

FOLDER = Path(__file__).parents[2] / "examples"


@pytest.fixture(scope="module")
def script() -> ModuleType:
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(FOLDER))
        return importlib.import_module("identification_study")


@pytest.fixture(scope="module")
def families() -> ModuleType:
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(FOLDER))
        return importlib.import_module("object_families")


@pytest.fixture(autouse=True)
def _cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TACTOPOSE_CACHE_DIR", str(tmp_path / "cache"))


def test_every_family_makes_closed_objects_that_a_hand_can_hold(families: ModuleType) -> None:
    for index in range(2 * len(families.FAMILIES)):
        name, mesh = families.make_object(index, 3)
        assert mesh.is_watertight, name
        assert mesh.volume > 0.0
        assert 0.02 < np.ptp(mesh.vertices, axis=0).max() < 0.3
        again = families.make_object(index, 3)[1]
        np.testing.assert_array_equal(again.vertices, mesh.vertices)
        other = families.make_object(index, 4)[1]
        assert other.volume != mesh.volume


def test_the_twenty_objects_are_a_manifest(script: ModuleType, tmp_path: Path) -> None:
    path = script.write_library(tmp_path)
    manifest = yaml.safe_load(path.read_text())
    assert len(manifest) == 20
    assert script.COPIED in manifest
    assert all((tmp_path / entry["mesh"]).is_file() for entry in manifest.values())


def test_the_study_counts_ranks(script: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def few(folder: Path) -> Path:
        folder.mkdir(parents=True)
        script.write_objects(folder, 3, 0)
        return folder

    monkeypatch.setattr(script, "write_library", few)
    result = CliRunner().invoke(script.main, ["--trials", "6", "--out", str(tmp_path / "out")])
    assert result.exit_code == 0, result.output
    rows = [line.split() for line in result.output.splitlines() if line.split()[:1] in (["evidence"], ["inverse_cost"])]
    assert [row[0] for row in rows] == ["evidence", "inverse_cost"]
    assert float(rows[0][1]) >= 50.0
    assert rows[0][2] == "100.0"


def test_the_growth_is_drawn(script: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(script, "SIZES", (2, 4, 1000))
    monkeypatch.setattr(script, "ProcessPoolExecutor", lambda **options: ThreadPoolExecutor(1))
    out = tmp_path / "out"
    result = CliRunner().invoke(script.main, ["--growth", "--trials", "2", "--largest", "4", "--out", str(out)])
    assert result.exit_code == 0, result.output
    assert re.findall(r"(\d+) objects: \d+\.\d\d s; the right one first in", result.output) == ["2", "4"]
    assert (out / "growth.png").stat().st_size > 1000
    assert len(list((out / "4").glob("*.stl"))) == 4
