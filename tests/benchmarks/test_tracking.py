"""Milliseconds of processor time of an update of the belief over time, beside correcting the pose of each instant anew.

`pytest -n 0 -s tests/benchmarks/test_tracking.py` prints them; --benchmark-json keeps them as extra_info. Objects are
carried about by five fingertips (examples/motion_families.py); anew corrects by the same contacts from the same guess,
with our search and with the thesis', as published.
"""

import math
import time
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
import pytest

import tactopose_drake as tp
from tactopose_drake.core.evidence.evidence import Evidence
from tactopose_drake.core.poses import make_poses, random_rotations, retract
from tactopose_drake.core.synthetic.rolling_touch import RollingTouch
from tactopose_drake.core.tracking.frame import Frame
from tactopose_drake.core.tracking.pose_tracker import PoseTracker
from tests.benchmarks.support import load, median_seconds

MOTIONS, STEPS = 4, 50
ANEW, PUBLISHED = 50, 3  # instants that are corrected anew, by our search and by the thesis'


class Motion(NamedTuple):
    """An object, and the frames of what is felt of it."""

    model: tp.ObjectModel
    frames: list[Frame]


def make_motion(seed: int) -> Motion:
    motions = load("motion_families")
    generator = np.random.default_rng(seed)
    model, p_OC, motion = motions.carry(generator, STEPS)
    R_PO = random_rotations(generator, 1)[0]
    X_PO = make_poses(R_PO, 0.03 * generator.normal(size=3) - R_PO @ model.vertices.mean(axis=0))
    touch = RollingTouch(model, X_PO, p_OC, generator)
    guess = tp.PosePrior(retract(X_PO, generator.normal(size=6) * tp.PosePrior(X_PO).sigmas))
    frames = []
    for i, step in enumerate(motion(touch)):
        touch.move(step.twist, step.tip_turn, step.slides, motions.PERIOD)
        contacts, velocities = touch.measure()
        evidence = Evidence(contacts, prior=guess)
        frames.append(Frame(motions.PERIOD * (i + 1), evidence, touch.sources, velocities))
    return Motion(model, frames)


def updates(motions: Sequence[Motion]) -> Iterator[None]:
    """Each next() is an update; without end."""
    while True:
        for motion in motions:
            tracker = PoseTracker(motion.model)
            belief = tracker.start(0.0)
            for frame in motion.frames:
                belief = tracker.step(belief, frame)
                yield


def correct(instant: tuple[Motion, Frame]) -> object:
    motion, frame = instant
    return tp.estimate_pose(motion.model, frame.evidence.contacts, prior=frame.evidence.prior)


def correct_as_published(instant: tuple[Motion, Frame]) -> object:
    motion, frame = instant
    no_hand = tp.HandGeometry([[1.0, 0.0, 0.0]], [0.001])
    trial = load("grasp_trials").Trial(frame.evidence.contacts, frame.evidence.prior, no_hand, np.eye(3, 4))
    return load("published_search").search_as_published(motion.model, trial)


@pytest.mark.benchmark(timer=time.process_time)
def test_an_update(benchmark: Any) -> None:
    motions = [make_motion(seed) for seed in range(MOTIONS)]
    endless = updates(motions)
    benchmark.pedantic(lambda: next(endless), rounds=MOTIONS * STEPS, warmup_rounds=MOTIONS * STEPS)
    ours = benchmark.stats.stats.median
    slowest = float(np.quantile(benchmark.stats.stats.data, 0.99))
    benchmark.extra_info["99 % within, ms"] = 1e3 * slowest
    lines = [f"\nupdate: {1e3 * ours:.2f} ms, 99 % within {1e3 * slowest:.1f} ms"]
    instants = [(motion, frame) for motion in motions for frame in motion.frames]
    for name, solve, count in (("pair_search", correct, ANEW), ("as published", correct_as_published, PUBLISHED)):
        seconds = median_seconds(solve, instants[:: math.ceil(len(instants) / count)])
        benchmark.extra_info[name] = seconds / ours
        lines.append(f"  anew by {name}: {1e3 * seconds:.1f} ms, {seconds / ours:.1f} times")
    print("\n".join(lines))  # noqa: T201
