from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from click.testing import CliRunner

from tactopose_drake.core.searches.baselines.monte_carlo import MonteCarlo, MonteCarloDesign
from tests.examples.scripts import load_script


@pytest.fixture(scope="module")
def script() -> ModuleType:
    return load_script("thesis/search_progress.py")


def test_least_costs_are_the_least_in_each_bin(script: ModuleType) -> None:
    values, cost = np.array([0.0, 0.001, 0.5, 1.0]), np.array([3.0, 2.0, 7.0, 1.0])
    middles, least = script.least_costs(values, cost)
    np.testing.assert_array_equal(least, [2.0, 7.0, 1.0])
    assert np.all(np.diff(middles) > 0)


def test_writes_both_figures_and_where_the_search_ended(
    script: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    short = MonteCarloDesign(particles=1000, population=200, power=100.0, noise=0.4, cooling=2.0, confidence=50.0)
    monkeypatch.setattr(
        script,
        "published_problem",
        lambda model, trial, make=script.published_problem: make(model, trial)._replace(
            search=MonteCarlo(scale=0.003, correction=short)
        ),
    )
    result = CliRunner().invoke(script.main, ["--seed", "3", "--out", str(tmp_path)])
    assert result.exit_code == 0, result.output
    for name in ("figure_4_5.png", "figure_4_19.png"):
        assert (tmp_path / name).read_bytes().startswith(b"\x89PNG")
    text = (tmp_path / "search_progress.md").read_text(encoding="utf-8")
    assert "seed 3" in text
    assert "- 1000 particles" in text
