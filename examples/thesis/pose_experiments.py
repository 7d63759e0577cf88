"""The experiments of section 4.3.1: four methods on the same trials of each cell, a number of fingers and a noise.

Two methods are `tp.estimate_pose` with its defaults: from the contacts alone, and with the hand's volume. Two are the
thesis' search: with our likelihood (`method="monte_carlo"`), and with the thesis' own cost (`published_search.py`).

Source: [B16] J. Bimbo, Touch Based Object Pose Estimation For Robotic Grasping, thesis, 2016, section 4.3.1.
"""

import dataclasses
import itertools
import math
import time
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from grasp_library import Array
from grasp_trials import Errors, Noise, Trial, pose_errors
from published_search import search_as_published

import tactopose_drake as tp

# The thesis states the second and the third; its axis ticks are not in its text, so the other levels are ours.
LEVELS = tuple(Noise(1e-3 * mm, math.radians(deg)) for mm, deg in ((0.45, 2.5), (0.9, 5), (1.8, 10), (2.7, 15)))
FINGER_COUNTS = (3, 4, 5)

OURS, WITH_HAND = "pair_search", "with hand"
SAME_COST, PUBLISHED = "monte_carlo", "as published"
OUR_METHODS, THESIS_METHODS = (OURS, WITH_HAND), (SAME_COST, PUBLISHED)
METHODS = (*OUR_METHODS, *THESIS_METHODS)


class Cell(NamedTuple):
    """The conditions of a group of trials."""

    fingers: int
    noise: Noise


CELLS = tuple(itertools.starmap(Cell, itertools.product(FINGER_COUNTS, LEVELS)))
MAIN_CELL = Cell(5, LEVELS[1])  # where the thesis gives numbers


@dataclasses.dataclass(frozen=True, kw_only=True)
class Experiment:
    """One of the two experiments, with the results of the thesis.

    Attributes:
        name: name of the files.
        title: title of the table.
        object: the object that is held.
        guess: whether there is a displaced pose to correct.
        mean_translation, mean_rotation: the thesis' mean errors in the main cell, m and rad.
        seconds: the thesis' mean time in the main cell.
        success: the thesis' minimum share of successes with at least `success_fingers` fingers and noise up to that of
            the main cell.
        success_fingers: the number of fingers to which `success` refers.
        trials: the number of the thesis' trials over all of its cells.
    """

    name: str
    title: str
    object: str
    guess: bool
    mean_translation: float
    mean_rotation: float
    seconds: float
    success: float
    success_fingers: int
    trials: int


# [B16] section 4.3.1.1: "over 80% of the time as long as the sensor noise is below 1.8 mm and 10 deg and four fingers".
CORRECTION = Experiment(
    name="correction",
    title="Pose correction of the bust, 33.2 mm and 16° off (figures 4.8 to 4.10)",
    object="bust",
    guess=True,
    mean_translation=0.00405,
    mean_rotation=math.radians(5.0),
    seconds=0.64,
    success=0.80,
    success_fingers=4,
    trials=2978,
)
# [B16] section 4.3.1.2: "over 75% when using at least four fingers and a sensor noise below 0.9 mm and 5 deg".
GLOBAL = Experiment(
    name="global",
    title="Global pose estimation of the wine glass (figures 4.12 and 4.13)",
    object="wine_glass",
    guess=False,
    mean_translation=0.0071,
    mean_rotation=math.radians(3.72),
    seconds=63.0,
    success=0.75,
    success_fingers=4,
    trials=1329,
)


@dataclasses.dataclass(frozen=True, eq=False)
class Runs:
    """The results of one method on the first n trials of a cell.

    Attributes:
        errors: errors of the most probable poses, shape (n,) each.
        found: whether a pose within the limits was among the hypotheses, shape (n,).
        mass: the hypotheses' probability of such a pose, shape (n,); NaN if they have no probabilities.
        seconds: CPU time, shape (n,).
    """

    errors: Errors
    found: Array
    mass: Array
    seconds: Array

    def first(self, count: int) -> "Runs":
        """The results of the first `count` trials."""
        errors = Errors(self.errors.translation[:count], self.errors.rotation[:count])
        return Runs(errors, self.found[:count], self.mass[:count], self.seconds[:count])

    def __len__(self) -> int:
        return len(self.seconds)


@dataclasses.dataclass(frozen=True, eq=False)
class Results:
    """All runs of an experiment.

    Attributes:
        experiment: the experiment.
        initial: errors of the displaced poses, shape (n,) each; empty if there are none.
        runs: the runs by cell and method.
    """

    experiment: Experiment
    initial: Errors
    runs: Mapping[tuple[Cell, str], Runs]


def find_poses(model: tp.ObjectModel, trial: Trial, method: str) -> tuple[Array, Array]:
    """Poses (B, 3, 4), best first, and their probabilities (B,), NaN if the method gives none."""
    if method == PUBLISHED:
        X_PO = search_as_published(model, trial)
        return X_PO, np.full(len(X_PO), np.nan)
    estimated = tp.estimate_pose(
        model,
        trial.contacts,
        prior=trial.prior,
        hand=trial.hand if method == WITH_HAND else None,
        method="monte_carlo" if method == SAME_COST else "pair_search",
    )
    hypotheses = estimated.hypotheses
    return np.stack([h.X_PO.GetAsMatrix34() for h in hypotheses]), np.array([h.probability for h in hypotheses])


def run_trial(model: tp.ObjectModel, trial: Trial, method: str) -> tuple[float, ...]:
    """Errors of the best pose, m and rad, whether a good one was found, its probability, and the CPU time, s."""
    started = time.process_time()
    X_PO, probability = find_poses(model, trial, method)
    seconds = time.process_time() - started
    errors = pose_errors(model, X_PO, trial.X_PO)
    good = errors.success
    mass = math.nan if np.isnan(probability).any() else float(probability[good].sum())
    return errors.translation[0], errors.rotation[0], float(good.any()), mass, seconds
