"""The fuzzer's kinds `plausible` and `hostile`: public calls as users make them, and as they must not."""

import numpy as np

from tests.fuzz import estimation, grasping, modelling, sensing, tracking
from tests.fuzz.corruption import corrupt
from tests.fuzz.targets import Target

TARGETS: list[Target] = [
    *estimation.TARGETS,
    *sensing.TARGETS,
    *grasping.TARGETS,
    *modelling.TARGETS,
    *tracking.TARGETS,
]
_WEIGHTS = np.array([target.weight for target in TARGETS])


def _any_target(rng: np.random.Generator) -> Target:
    return TARGETS[int(rng.choice(len(TARGETS), p=_WEIGHTS / _WEIGHTS.sum()))]


def plausible(rng: np.random.Generator) -> None:
    """One public call with realistic arguments."""
    target = _any_target(rng)
    target.call(target.arguments(rng))


def hostile(rng: np.random.Generator) -> None:
    """One public call with some of its arguments spoilt."""
    target = _any_target(rng)
    target.call(corrupt(rng, target.arguments(rng)))
