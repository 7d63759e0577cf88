"""Chapter 5 with a hand that is off, on one of its grips."""

import dataclasses
import importlib
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from tactopose_drake.core.shape.model_cache import FOLDER_VARIABLE

FOLDER = Path(__file__).parents[2] / "examples" / "thesis"
BOTTLE = "f) thermal bottle, lying"


def load(name: str) -> ModuleType:
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(FOLDER))
        return importlib.import_module(name)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the script writes for one grip and two levels; beside it lies the cache."""
    script, corrections = load("chapter_5_inexact"), load("pad_corrections")
    folder = tmp_path_factory.mktemp("chapter_5_inexact") / "new"
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(FOLDER_VARIABLE, str(folder.parent / "cache"))
        patch.setattr(script, "GRIPS", {BOTTLE: script.GRIPS[BOTTLE]})
        patch.setattr(script, "LEVELS", (script.Level(0, 0), script.Level(2, 2)))
        patch.setattr(script, "SEARCH_LEVELS", (script.Level(2, 2),))
        patch.setattr(load("table_5_2"), "POSES", 300)
        patch.setattr(corrections, "DIRECT", dataclasses.replace(corrections.DIRECT, max_evaluations=200))
        options = ["--trials", "2", "--hands", "2", "--search-trials", "1", "--seed", "3", "--out", str(folder)]
        result = CliRunner().invoke(script.main, options)
    assert result.exit_code == 0, result.output
    return folder


@pytest.fixture
def grasp(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """The grip that the script left in the cache folder."""
    grasps = load("pad_grasps")
    monkeypatch.setenv(FOLDER_VARIABLE, str(folder.parent / "cache"))
    monkeypatch.delattr(grasps, "simulate_grasp")
    return grasps.load_pad_grasp(BOTTLE, grasps.GRIPS[BOTTLE])


def test_every_level_has_its_errors_and_a_verdict(folder: Path) -> None:
    text = (folder / "chapter_5_inexact.md").read_text(encoding="utf-8")
    rows = [line for line in text.splitlines() if line.startswith(("| 0 mm, 0 deg", "| 2 mm, 2 deg"))]
    assert len(rows) == 4  # two tables
    assert all(len(row.strip("|").split("|")) == 5 for row in rows)
    searches = [
        line for line in text.splitlines() if line.startswith(("| algorithm 5.2, 2 mm", "| algorithm 5.3, 2 mm"))
    ]
    costs = [float(cell) for line in searches for cell in line.strip("|").split("|")[1:]]
    assert len(costs) == 2 * 4
    assert min(costs) > 0.0
    assert "In deg the covariance match is better than the distance" in text
    assert "ours, told: below both of the thesis' objectives" in text
    assert (folder / "chapter_5_inexact.png").read_bytes().startswith(b"\x89PNG")


def test_a_hand_that_errs_in_nothing_feels_what_was_felt(grasp: Any) -> None:
    inexact = load("inexact_hand")
    patches = inexact.InexactHand().feel(grasp, inexact.Level(0, 0), np.random.default_rng(0))
    for patch, old in zip(patches, grasp.patches, strict=True):
        np.testing.assert_allclose(patch.p_PT, old.p_PT, atol=1e-12)
        np.testing.assert_allclose(patch.n_PT, old.n_PT, atol=1e-12)
        np.testing.assert_allclose(patch.misplacement, 0.0, atol=1e-15)
    assert all(patch.misplacement is None for patch in inexact.untold(patches))


def test_arrays_are_off_by_as_much_as_is_declared(grasp: Any) -> None:
    inexact = load("inexact_hand")
    hand, generator = inexact.InexactHand(), np.random.default_rng(1)
    drawn = [hand.feel(grasp, inexact.Level(1, 1), generator) for _ in range(300)]
    for pad, old in enumerate(grasp.patches):
        shifts = np.array([patches[pad].p_PT.mean(axis=0) for patches in drawn]) - old.p_PT.mean(axis=0)
        declared = np.mean([np.trace(patches[pad].misplacement[:3, :3]) for patches in drawn])
        assert np.sqrt(np.mean(np.sum(shifts**2, axis=1))) == pytest.approx(np.sqrt(declared), rel=0.15)
    # A finger's joints move its array besides; the palm's is where it is mounted.
    assert [np.trace(patch.misplacement[:3, :3]) > 3.5e-6 for patch in drawn[0]] == [True, True, True, False]
