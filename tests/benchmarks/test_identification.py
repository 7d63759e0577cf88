"""Milliseconds of processor time of an identification by five contacts, beside the thesis' way to do it.

`pytest -n 0 -s tests/benchmarks/test_identification.py` prints them; --benchmark-json keeps them as extra_info. The
thesis runs its global search once for each object ([B16] section 6.2.1): here of our likelihood, and of few objects,
because it is slow.

[B16] J. Bimbo, Touch Based Object Pose Estimation For Robotic Grasping, thesis, 2016.
"""

import itertools
import time
from typing import Any

import numpy as np
import pytest

import tactopose_drake as tp
from tactopose_drake.core.poses import make_poses, random_rotations
from tactopose_drake.core.synthetic.synthetic_touch import touch_surface
from tactopose_drake.resources import model_path
from tests.benchmarks.support import median_seconds

ALL = sorted(path.stem for path in model_path("objects").glob("*.obj"))
FEW = ["mug", "soda_can"]
TRIALS = 30


def load_models(names: list[str]) -> list[tp.ObjectModel]:
    return [tp.ObjectModel.from_mesh(model_path("objects", f"{name}.obj")) for name in names]


def make_touch(models: list[tp.ObjectModel], trial: int) -> tuple[int, tp.Contacts]:
    """Which object is touched, and how."""
    generator = np.random.default_rng(trial)
    touched = trial % len(models)
    X_PO = make_poses(random_rotations(generator, 1), 0.05 * generator.normal(size=(1, 3)))[0]
    return touched, touch_surface(models[touched], X_PO, 5, generator)


@pytest.mark.benchmark(timer=time.process_time)
def test_among_all_objects_of_the_package(benchmark: Any) -> None:
    models = load_models(ALL)
    trials = [make_touch(models, trial) for trial in range(TRIALS)]
    endless = itertools.cycle(trials)
    benchmark.pedantic(lambda: tp.identify(models, next(endless)[1]), rounds=TRIALS, warmup_rounds=3)
    right = sum(tp.identify(models, contacts).best.index == touched for touched, contacts in trials)
    benchmark.extra_info.update(objects=len(models), right=right / TRIALS)
    milliseconds = 1e3 * benchmark.stats.stats.median
    print(f"\n{len(models)} objects: {milliseconds:.0f} ms, {right} of {TRIALS} right")  # noqa: T201


@pytest.mark.benchmark(timer=time.process_time)
def test_against_the_thesis_search(benchmark: Any) -> None:
    models = load_models(FEW)
    trials = [make_touch(models, trial) for trial in range(TRIALS)]
    endless = itertools.cycle(trials)
    benchmark.pedantic(lambda: tp.identify(models, next(endless)[1]), rounds=TRIALS, warmup_rounds=3)
    ours = median_seconds(lambda trial: tp.identify(models, trial[1]), trials)
    started = time.process_time()
    for model in models:
        tp.estimate_pose(model, trials[0][1], method="monte_carlo")
    theirs = time.process_time() - started
    benchmark.extra_info["monte_carlo"] = theirs / ours
    print(f"\n{len(FEW)} objects: {1e3 * ours:.1f} ms, monte_carlo {theirs:.1f} s, {theirs / ours:.0f} times")  # noqa: T201
