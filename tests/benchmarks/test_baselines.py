"""A correction by touch beside what others have: point-to-plane ICP of small_gicp, and SciPy's least squares.

`pytest -n 0 -s tests/benchmarks/test_baselines.py` prints milliseconds, their ratio to ours, and how often each ends
within 10 mm and 10 degrees; --benchmark-json keeps them as extra_info. All start from the same guess, 33 mm and 16
degrees off, with the same five contacts; ICP gets their points as its cloud, and SciPy our objective's residuals.
"""

import functools
import itertools
import math
import statistics
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pytest
import small_gicp
from scipy.optimize import least_squares

import tactopose_drake as tp
from tactopose_drake.core.evidence.evidence import Evidence
from tactopose_drake.core.poses import compose, increments_between, inverse, make_poses, random_rotations, retract
from tactopose_drake.core.searches.pose_problem import make_problem
from tactopose_drake.core.shape.free_spin import turn_toward
from tactopose_drake.core.synthetic.synthetic_touch import touch_surface
from tactopose_drake.resources import model_path

TRIALS = 50
OBJECTS = ["bust", "mug", "spray_bottle"]


class Trial(NamedTuple):
    """A touch, a guess, and the truth."""

    contacts: tp.Contacts
    prior: tp.PosePrior
    X_PO: np.ndarray


def make_trials(model: tp.ObjectModel) -> list[Trial]:
    trials = []
    for seed in range(TRIALS):
        generator = np.random.default_rng(seed)
        X_PO = make_poses(random_rotations(generator, 1), 0.05 * generator.normal(size=(1, 3)))[0]
        contacts = touch_surface(model, X_PO, 5, generator)
        w, v = (u / np.linalg.norm(u) for u in generator.normal(size=(2, 3)))
        prior = tp.PosePrior(retract(X_PO, np.concatenate([math.radians(16.0) * w, 0.033 * v])))
        trials.append(Trial(contacts, prior, X_PO))
    return trials


def correct_by_touch(model: tp.ObjectModel, trial: Trial) -> np.ndarray:
    return tp.estimate_pose(model, trial.contacts, prior=trial.prior).best.X_PO.GetAsMatrix34()


@functools.cache
def target_of(model: tp.ObjectModel) -> tuple[Any, Any]:
    """The object's surface samples as small_gicp wants them, made once, as our model is."""
    cloud = small_gicp.PointCloud(model.samples.points)
    tree = small_gicp.KdTree(cloud)
    small_gicp.estimate_normals_covariances(cloud, tree)
    return cloud, tree


def correct_by_icp(model: tp.ObjectModel, trial: Trial) -> np.ndarray:
    cloud, tree = target_of(model)
    # Each point three times: the same least squares, and no warning of so small a cloud.
    source = small_gicp.PointCloud(np.tile(trial.contacts.p_PC, (3, 1)))
    start = np.eye(4)
    start[:3] = inverse(trial.prior.mean)
    found = small_gicp.align(
        cloud, source, tree, start, registration_type="PLANE_ICP", max_correspondence_distance=0.1, max_iterations=100
    )
    return inverse(found.T_target_source[:3])


def correct_by_scipy(model: tp.ObjectModel, trial: Trial) -> np.ndarray:
    problem = make_problem(model, Evidence(trial.contacts, trial.prior))

    def residuals(increment: np.ndarray) -> np.ndarray:
        return problem.objective.residuals(retract(trial.prior.mean, increment)[None])[0]

    return retract(trial.prior.mean, least_squares(residuals, np.zeros(6), method="lm").x)


def judge(
    solve: Callable[[tp.ObjectModel, Trial], np.ndarray], model: tp.ObjectModel, trials: list[Trial]
) -> tuple[float, float]:
    """Median CPU time, s, and the share within 10 mm and 10 degrees, up to the object's symmetries."""
    solve(model, trials[0])
    seconds, near = [], 0
    for trial in trials:
        started = time.process_time()
        X_PO = solve(model, trial)
        seconds.append(time.process_time() - started)
        alike = turn_toward(compose(X_PO[None], model.symmetry_poses), trial.X_PO, model.symmetries)
        off = increments_between(alike, trial.X_PO[None])
        turned, moved = np.linalg.norm(off[:, :3], axis=1), np.linalg.norm(off[:, 3:], axis=1)
        near += bool(np.any((turned < math.radians(10.0)) & (moved < 0.01)))
    return statistics.median(seconds), near / len(trials)


@pytest.mark.benchmark(timer=time.process_time)
@pytest.mark.parametrize("name", OBJECTS)
def test_correction_beside_others(benchmark: Any, name: str) -> None:
    model = tp.ObjectModel.from_mesh(model_path("objects", f"{name}.obj"))
    trials = make_trials(model)
    endless = itertools.cycle(trials)
    benchmark.pedantic(lambda: correct_by_touch(model, next(endless)), rounds=TRIALS, warmup_rounds=3)
    ours, near = judge(correct_by_touch, model, trials)
    lines = [f"\n{name}: pair_search {1e3 * ours:.2f} ms, {near:.0%} within 10 mm and 10 degrees"]
    for other, solve in (("small_gicp's ICP", correct_by_icp), ("scipy.least_squares", correct_by_scipy)):
        seconds, share = judge(solve, model, trials)
        benchmark.extra_info[other] = {"ratio": seconds / ours, "share": share}
        lines.append(f"  {other}: {1e3 * seconds:.2f} ms, {seconds / ours:.2g} times ours, {share:.0%}")
    print("\n".join(lines))  # noqa: T201
