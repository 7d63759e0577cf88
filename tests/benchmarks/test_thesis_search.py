"""Processor time of a correction and of a global estimate, and how many times as long the thesis' search takes.

`pytest -n 0 -s tests/benchmarks/test_thesis_search.py` prints them; --benchmark-json keeps the ratios as extra_info.
The search is taken as `method="monte_carlo"`, which minimises our likelihood, and as published, with the thesis' cost
(examples/thesis/published_search.py).
"""

import itertools
import time
from typing import Any

import numpy as np
import pytest

import tactopose_drake as tp
from tactopose_drake.core.poses import exp_so3, make_poses
from tactopose_drake.core.synthetic.synthetic_touch import touch_surface
from tactopose_drake.resources import model_path
from tests.benchmarks.support import load, median_seconds

TRIALS = 50


def make_trials(model: tp.ObjectModel, guess: bool) -> list[Any]:
    """Touches of the whole surface, at the thesis' noise."""
    grasp_trials, grasp_library = load("grasp_trials"), load("grasp_library")
    trials = []
    for seed in range(TRIALS):
        generator = np.random.default_rng(seed)
        X_PO = make_poses(exp_so3(generator.normal(size=(1, 3))), 0.05 * generator.normal(size=(1, 3)))[0]
        touch = touch_surface(model, X_PO, 5, generator, sigma_position=0.0, sigma_normal=0.0)
        spheres = touch.p_PC + 0.008 * touch.n_PC, np.full(5, 0.008)
        grasp = grasp_library.SimulatedGrasp(X_PO, touch.p_PC, touch.n_PC, touch.n_PC, *spheres)
        noise = load("pose_experiments").MAIN_CELL.noise
        trials.append(grasp_trials.make_trial(model.name, grasp, 5, noise, (0, seed), guess))
    return trials


@pytest.mark.benchmark(timer=time.process_time)
@pytest.mark.parametrize(("name", "guess", "rounds"), [("bust", True, 5), ("wine_glass", False, 1)])
def test_against_the_thesis_search(benchmark: Any, name: str, guess: bool, rounds: int) -> None:
    model = tp.ObjectModel.from_mesh(model_path("objects", f"{name}.obj"))
    trials = make_trials(model, guess)
    endless = itertools.cycle(trials)

    def estimate(trial: Any, method: str = "pair_search") -> tp.PoseEstimate:
        return tp.estimate_pose(model, trial.contacts, prior=trial.prior, method=method)

    benchmark.pedantic(lambda: estimate(next(endless)), rounds=TRIALS, warmup_rounds=3)
    ours = median_seconds(estimate, trials)
    slow = {
        "monte_carlo": lambda trial: estimate(trial, "monte_carlo"),
        "as published": lambda trial: load("published_search").search_as_published(model, trial),
    }
    for method, solve in slow.items():
        theirs = median_seconds(solve, trials[:rounds])
        benchmark.extra_info[method] = theirs / ours
        print(f"\n{name}: {1e3 * ours:.1f} ms, {method} {1e3 * theirs:.0f} ms, {theirs / ours:.0f} times")  # noqa: T201
