from types import ModuleType

import numpy as np
import pytest

from tests.examples.scripts import load_script


@pytest.fixture(scope="module")
def script() -> ModuleType:
    return load_script("table_6_1.py")


def test_a_column_is_ticked_by_what_succeeded(script: ModuleType) -> None:
    works = script.Experiment("works", ("6-DOF", "moving object"), 0.8, "1.0/2.0", 0.002)
    fails = script.Experiment("fails", ("6-DOF", "identification"), 0.7, "-/-", 0.1)
    text = script.markdown([works, fails], 10, 3)
    assert "10 trials of each experiment, seed 3" in text
    rows = {
        line.split(" | ")[0].strip("| "): line.split(" | ")[1:7] for line in text.splitlines() if line.count("|") == 10
    }
    assert rows["here, works"] == ["✓", "×", "×", "×", "×", "✓"]
    assert rows["here, fails"] == ["×"] * 6
    assert rows["here, all"] == ["✓", "×", "×", "×", "×", "✓"]


def test_ten_works_of_the_literature_stand_beside_ours(script: ModuleType) -> None:
    assert len(script.LITERATURE) == 10
    works = script.Experiment("works", tuple(script.COLUMNS), 0.8, "1.0/2.0", 0.002)
    text = script.markdown([works], 10, 3)
    rows = [line for line in text.splitlines() if line.count("|") == 10]
    honda = next(line for line in rows if "Honda [124]" in line)
    assert honda.endswith("| ✓ | × | × | ✓ | × | ✓ | 0.5/2 | 0.033 |")
    ticks = {name: np.sum(done) for name, (done, _, _) in (script.LITERATURE | script.THESIS).items()}
    assert max(ticks.values()) == 5  # [B16]: "none of the reviewed articles completely fulfills the stated abilities"
    assert "6 of the 6 columns are ticked here; at most 5 by another row" in text


def test_a_pose_that_is_found_counts_and_a_turned_one_does_not(script: ModuleType) -> None:
    trial = script.find_pose(0, 1, True)
    assert trial.translation < 0.05
    model = script.load("bust")
    X_PO = script.random_pose(np.random.default_rng(0))
    assert script.judge_pose(model, X_PO, X_PO, 0.0).succeeded
    assert not script.judge_pose(model, script.retract(X_PO, np.array([0.5, 0, 0, 0, 0, 0])), X_PO, 0.0).succeeded


def test_a_carried_object_is_followed(script: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(script, "STEPS", 10)
    trial = script.follow(0, 0)
    assert trial.seconds > 0.0
    assert trial.translation < 0.1
