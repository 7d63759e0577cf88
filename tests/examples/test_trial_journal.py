import json
import math
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

import tactopose_drake as tp
from tactopose_drake.core.synthetic.synthetic_touch import touch_surface
from tactopose_drake.errors import InvalidInputError
from tests.examples.scripts import EXAMPLES, share_script

FIRST, SECOND = ({"experiment": "global", "grasp": i, "noise": "0.9 mm, 5°"} for i in (0, 1))


@pytest.fixture(scope="module")
def journals() -> ModuleType:
    return share_script("thesis/trial_journal.py")


@pytest.fixture(scope="module")
def runs() -> ModuleType:
    return share_script("thesis/experiment_runs.py")


@pytest.fixture(scope="module")
def bench(runs: ModuleType) -> Any:
    """Touches of the whole surface of the bust in place of simulated grasps."""
    library, experiments = share_script("thesis/grasp_library.py"), share_script("thesis/pose_experiments.py")
    model = tp.ObjectModel.from_mesh(library.make_scenario("bust").object_mesh())
    grasps = []
    for seed in range(2):
        touch = touch_surface(model, np.eye(3, 4), 5, np.random.default_rng(seed), sigma_position=0.0, sigma_normal=0.0)
        spheres = touch.p_PC + 0.008 * touch.n_PC, np.full(5, 0.008)
        grasps.append(library.SimulatedGrasp(np.eye(3, 4), touch.p_PC, touch.n_PC, touch.n_PC, *spheres))
    return runs.Bench(experiments.CORRECTION, model, grasps, 4)


def test_a_journal_gives_back_what_was_added(journals: ModuleType, tmp_path: Path) -> None:
    path = tmp_path / "trials.jsonl"
    journal = journals.TrialJournal(path)
    assert not path.exists()
    journal.add(FIRST, (0.001, 0.1 + 0.2, math.nan))
    again = journals.TrialJournal(path)
    assert len(again) == 1
    assert again[dict(reversed(FIRST.items()))][:2] == (0.001, 0.1 + 0.2)
    assert math.isnan(again[FIRST][2])
    assert SECOND not in again
    assert json.loads(path.read_text(encoding="utf-8")) == {**FIRST, "numbers": [0.001, 0.1 + 0.2, None]}


def test_a_half_written_line_is_dropped_and_its_trial_written_anew(journals: ModuleType, tmp_path: Path) -> None:
    path = tmp_path / "trials.jsonl"
    for key in (FIRST, SECOND):
        journals.TrialJournal(path).add(key, (1.0,))
    path.write_bytes(path.read_bytes()[:-5])
    journal = journals.TrialJournal(path)
    assert FIRST in journal
    assert SECOND not in journal
    journal.add(SECOND, (2.0,))
    assert journals.TrialJournal(path)[SECOND] == (2.0,)


@pytest.mark.parametrize("line", ["{", "[1]", '{"grasp": 0}', '{"grasp": 0, "numbers": 1}', '{"numbers": ["x"]}', ""])
def test_another_file_is_no_journal(journals: ModuleType, tmp_path: Path, line: str) -> None:
    path = tmp_path / "trials.jsonl"
    journals.TrialJournal(path).add(FIRST, (1.0,))
    text = path.read_text(encoding="utf-8") + line + "\n"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InvalidInputError, match=r"trials\.jsonl: line 2 must be a trial as this program writes it"):
        journals.TrialJournal(path)
    assert path.read_text(encoding="utf-8") == text


def stand_in(error: float) -> Any:
    return lambda model, trial, method: (error, 0.1, 1.0, math.nan, 2.0)


def test_a_run_goes_on_where_the_last_one_ended(
    runs: ModuleType, journals: ModuleType, bench: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(runs.Bench, "rehearse", lambda self, methods: None)
    for grasps, error in ((1, 0.25), (2, 0.5)):
        monkeypatch.setattr(runs, "run_trial", stand_in(error))
        journal = journals.TrialJournal(tmp_path / "trials.jsonl")
        results = runs.run_experiment(bench, {"pair_search": grasps, "as published": grasps}, journal)
    assert len(journal) == 2 * 12 * 2
    for method in ("pair_search", "as published"):
        assert all(results.runs[cell, method].errors.translation.tolist() == [0.25, 0.5] for cell in runs.CELLS)
    assert not any(method in {"with hand", "monte_carlo"} for _, method in results.runs)


def test_trials_that_a_cell_lacks_count_in_none(
    runs: ModuleType, journals: ModuleType, bench: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An interrupt ends the thesis' search within a grasp."""

    def interrupted(tasks: Iterator[Any]) -> Iterator[Any]:
        for task in tasks:
            if not (task.grasp == 1 and task.cell == runs.CELLS[-1] and task.method == "as published"):
                yield task, (0.5, 0.1, 1.0, 1.0, 2.0)

    monkeypatch.setattr(runs, "_run_all", lambda bench, methods, tasks, jobs: interrupted(tasks))
    results = runs.run_experiment(bench, {"pair_search": 2, "as published": 2})
    assert {len(results.runs[cell, "as published"]) for cell in runs.CELLS} == {1}
    assert {len(results.runs[cell, "pair_search"]) for cell in runs.CELLS} == {2}


def test_two_processes_come_to_the_same(runs: ModuleType, bench: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(EXAMPLES / "thesis"))  # As where the script is run: processes begin with this path.
    alone, shared = (runs.run_experiment(bench, {"pair_search": 2}, jobs=jobs) for jobs in (1, 2))
    assert alone.runs.keys() == shared.runs.keys()
    for key, expected in alone.runs.items():
        # But for the last digits: sums depend on where in memory an array begins.
        np.testing.assert_allclose(shared.runs[key].errors, expected.errors, rtol=1e-6)
        np.testing.assert_allclose(shared.runs[key].mass, expected.mass, rtol=1e-6)
        assert np.all(shared.runs[key].seconds > 0)
