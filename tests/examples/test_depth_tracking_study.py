"""What the study of a depth camera's pixels makes of its grasps, without simulating one."""

import importlib
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

import tactopose_drake as tp

FOLDER = Path(__file__).parents[2] / "examples"


@pytest.fixture(scope="module")
def example() -> ModuleType:
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(FOLDER))
        return importlib.import_module("depth_tracking_study")


@pytest.fixture(scope="module")
def summary(example: ModuleType) -> ModuleType:
    return importlib.import_module("depth_tracking_summary")


def test_a_turn_that_changes_nothing_is_no_error(example: ModuleType) -> None:
    box = tp.ObjectModel.from_box([0.06, 0.08, 0.1], cache=False)
    turned = np.column_stack([np.diag([-1.0, -1.0, 1.0]), [0.003, 0.0, 0.004]])
    off, angle = example.errors(box, turned, np.eye(3, 4))
    assert off == pytest.approx(5.0, abs=0.2)
    assert angle < 0.1


def test_the_table_counts_what_is_right_and_what_is_lost(summary: ModuleType, tmp_path: Path) -> None:
    good = summary.Outcome((1.0, 2.0), (3.0, 4.0), 1.5, 0.25, (0.5, 0.6), True, "ok")
    pulled = summary.Outcome((80.0, 90.0), (90.0, 100.0), 20.0, 0.2, (0.7, 0.8), True, "ok")
    lost = summary.Outcome((np.nan, np.nan), (np.nan, np.nan), np.nan, 1.0, (0.9, 1.0), False, "ambiguous")
    trials = [{summary.LEAVES_OUT: good, summary.TAKES: failing, summary.NOTHING: lost} for failing in (pulled, lost)]
    assert summary.row("mug", "x", [pulled, lost]) == (
        "| mug | x | 2 | 20.0 (20.0) | 80.0 (80.0) | 90.0 (90.0) | 90.0 (90.0) | 100.0 (100.0) | 0 of 1 | 0.8 (0.9) "
        "| 0.9 (1.0) | 1 of 2 |"
    )
    text = summary.verdict(trials)
    assert "is off by 80 mm on average" in text
    assert "the claim holds" in text
    assert "0 of the 1 grasps in which it has an answer" in text
    summary.save_plot({"mug": trials}, tmp_path / "plot.png")
    assert (tmp_path / "plot.png").stat().st_size > 10_000
