"""Processor time of an estimate from five contacts, near a prior and without one, and how often it finds the pose.

`pytest -n 0 -s tests/benchmarks/test_estimation.py` prints them; --benchmark-json keeps them as extra_info.
"""

import itertools
import math
import time
from typing import Any

import numpy as np
import pytest

import tactopose_drake as tp
from tactopose_drake.core.objectives.surface_contact import SurfaceContact
from tactopose_drake.core.poses import compose, increments_between, make_poses, random_rotations, retract
from tactopose_drake.core.searches.levenberg_marquardt import LevenbergMarquardt
from tactopose_drake.core.shape.free_spin import turn_toward
from tactopose_drake.core.synthetic.synthetic_touch import touch_surface
from tactopose_drake.resources import model_path

TRIALS = 100
OBJECTS = ["bust", "mug", "spray_bottle", "tea_box", "wine_glass"]


@pytest.fixture(scope="module", params=OBJECTS)
def model(request: pytest.FixtureRequest) -> tp.ObjectModel:
    return tp.ObjectModel.from_mesh(model_path("objects", f"{request.param}.obj"))


def make_trials(model: tp.ObjectModel) -> list[tuple[tp.Contacts, tp.PosePrior, np.ndarray]]:
    """Touches, priors 33 mm and 16 degrees off, and the true poses."""
    trials = []
    for seed in range(TRIALS):
        generator = np.random.default_rng(seed)
        X_PO = make_poses(random_rotations(generator, 1), 0.05 * generator.normal(size=(1, 3)))[0]
        contacts = touch_surface(model, X_PO, 5, generator)
        w, v = (u / np.linalg.norm(u) for u in generator.normal(size=(2, 3)))
        prior = tp.PosePrior(retract(X_PO, np.concatenate([math.radians(16.0) * w, 0.033 * v])))
        trials.append((contacts, prior, X_PO))
    return trials


def report(benchmark: Any, what: str, share: float, meaning: str) -> None:
    benchmark.extra_info["share"] = share
    print(f"\n{what}: {1e3 * benchmark.stats.stats.median:.2f} ms, {share:.0%} {meaning}")  # noqa: T201


@pytest.mark.benchmark(timer=time.process_time)
@pytest.mark.parametrize("method", ["pair_search", "levenberg_marquardt"])
def test_correction(benchmark: Any, model: tp.ObjectModel, method: str) -> None:
    trials = make_trials(model)
    endless = itertools.cycle(trials)

    def correct() -> tp.PoseEstimate:
        contacts, prior, _ = next(endless)
        return tp.estimate_pose(model, contacts, prior=prior, method=method)

    benchmark.pedantic(correct, rounds=TRIALS, warmup_rounds=3)
    near = 0
    for contacts, prior, X_PO in trials:
        best = tp.estimate_pose(model, contacts, prior=prior, method=method).best.X_PO.GetAsMatrix34()
        alike = turn_toward(compose(best[None], model.symmetry_poses), X_PO, model.symmetries)
        off = increments_between(alike, X_PO[None])
        turned, moved = np.linalg.norm(off[:, :3], axis=1), np.linalg.norm(off[:, 3:], axis=1)
        near += bool(np.any((turned < math.radians(10.0)) & (moved < 0.01)))
    report(benchmark, f"{model.name}, correction by {method}", near / TRIALS, "within 10 mm and 10 degrees")


def fingers_behind(contacts: tp.Contacts) -> tp.HandGeometry:
    """A straight finger behind each contact, 10 cm long, of 80 spheres as dense as a hand's."""
    assert contacts.n_PC is not None
    along, around = np.linspace(0.0, 0.1, 20), np.linspace(0.0, 2.0 * np.pi, 4, endpoint=False)
    centres = []
    for p, n in zip(contacts.p_PC, contacts.n_PC, strict=True):
        across = np.linalg.svd(n[None])[2][1:]
        ring = 0.003 * np.stack([np.cos(around), np.sin(around)], axis=1) @ across
        centres.append(p + (0.005 + along)[:, None, None] * n + ring)
    p_PH = np.concatenate(centres).reshape(-1, 3)
    return tp.HandGeometry(p_PH, np.full(len(p_PH), 0.005))


@pytest.mark.benchmark(timer=time.process_time)
@pytest.mark.parametrize("is_near", [True, False])
def test_with_the_hand_s_volume(benchmark: Any, model: tp.ObjectModel, is_near: bool) -> None:
    """Beside the same without it, in the same run."""
    trials = [(contacts, prior if is_near else None) for contacts, prior, _ in make_trials(model)]
    endless = itertools.cycle([(*trial, fingers_behind(trial[0])) for trial in trials])
    alone = []

    def estimate() -> tp.PoseEstimate:
        contacts, prior, hand = next(endless)
        return tp.estimate_pose(model, contacts, prior=prior, hand=hand)

    benchmark.pedantic(estimate, rounds=TRIALS, warmup_rounds=3)
    for contacts, prior in trials:
        begun = time.process_time()
        tp.estimate_pose(model, contacts, prior=prior)
        alone.append(time.process_time() - begun)
    ratio = benchmark.stats.stats.median / float(np.median(alone))
    benchmark.extra_info["ratio"] = ratio
    what = f"{model.name}, with the hand's volume{' near a prior' if is_near else ''}"
    print(f"\n{what}: {1e3 * benchmark.stats.stats.median:.2f} ms, {ratio:.2f} times as long as without")  # noqa: T201


@pytest.mark.benchmark(timer=time.process_time)
def test_global(benchmark: Any, model: tp.ObjectModel) -> None:
    trials = make_trials(model)
    endless = itertools.cycle(trials)
    benchmark.pedantic(lambda: tp.estimate_pose(model, next(endless)[0]), rounds=TRIALS, warmup_rounds=3)
    complete = 0
    for contacts, _, X_PO in trials:
        truth = LevenbergMarquardt().refine(SurfaceContact(model.grid, contacts), X_PO[None])
        least = min(hypothesis.cost for hypothesis in tp.estimate_pose(model, contacts).hypotheses)
        complete += least <= truth.cost[0] + 0.5
    report(benchmark, f"{model.name}, global", complete / TRIALS, "at least as good as the refined truth")
