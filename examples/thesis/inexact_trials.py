"""Evaluates chapter 5's objectives with an inexact hand: corrections, rank correlations, and figure 5.11's rotations.

Every trial draws a hand, and a displaced pose as for table 5.3; all objectives are given the same.
"""

import dataclasses

import numpy as np
from figure_5_11 import TURNS_DEG, turned_poses
from inexact_hand import InexactHand, Level, untold
from pad_corrections import correct, errors_of, rank_correlations
from pad_grasps import DISTANCE, OURS, PCA, Array, PadGrasp, displaced_poses
from rich.console import Console
from rich.progress import track

from tactopose_drake.core.poses import increments_between, retract

TOLD = "ours, told"
METHODS = (PCA, DISTANCE, OURS, TOLD)
WAY = 40  # number of poses between the true one and displaced ones, for a trial's rank correlations


@dataclasses.dataclass(frozen=True, eq=False)
class LevelTrials:
    """The results of one objective with hands whose errors are of one level.

    Attributes:
        error: errors of the final poses, mm and deg, shape (grips, trials, 2).
        rho: rank correlation of cost and error on the way to the true pose, shape (grips, trials, 2).
    """

    error: Array
    rho: Array

    @property
    def mean(self) -> Array:
        """Mean error, mm and deg, shape (2,)."""
        mean: Array = self.error.mean(axis=(0, 1))
        return mean


def feel_both(grasp: PadGrasp, hand: InexactHand, level: Level, generator: np.random.Generator) -> dict[str, PadGrasp]:
    """The grasp as a drawn hand feels it, for each method; the last one is given the hands' standard deviations."""
    told = hand.feel(grasp, level, generator)
    without = grasp.felt(untold(told))
    return {PCA: without, DISTANCE: without, OURS: without, TOLD: grasp.felt(told)}


def objective_of(method: str) -> str:
    """The name of a method's objective; what it is told of the hand is in the patches."""
    return OURS if method == TOLD else method


def run_level(grasps: dict[str, PadGrasp], level: Level, trials: int, seed: tuple[int, ...]) -> dict[str, LevelTrials]:
    """Corrects displaced poses of each grip, felt with drawn hands, by every method."""
    hand = InexactHand()
    shape = len(grasps), trials, 2
    results = {method: LevelTrials(np.empty(shape), np.empty(shape)) for method in METHODS}
    work = [(i, name, trial) for i, name in enumerate(grasps) for trial in range(trials)]
    for i, name, trial in track(work, f"hands off by {level}", console=Console(stderr=True), transient=True):
        grasp, generator = grasps[name], np.random.default_rng((*seed, i, trial))
        start = displaced_poses(grasp.X_PO, 1, generator)[0]
        true = np.repeat(grasp.X_PO[None], WAY, axis=0)
        off = increments_between(true, displaced_poses(grasp.X_PO, WAY, generator))
        way = retract(true, generator.uniform(size=(WAY, 1)) * off)
        way_errors = errors_of(grasp, way)
        for method, felt in feel_both(grasp, hand, level, generator).items():
            X_PO = correct(felt, objective_of(method), start, np.random.default_rng((*seed, i, trial)))
            results[method].error[i, trial] = errors_of(grasp, X_PO[None])[0]
            cost = felt.objectives[objective_of(method)].cost(way)
            results[method].rho[i, trial] = rank_correlations(cost, way_errors)
    return results


def least_turns(grasp: PadGrasp, level: Level, hands: int, seed: tuple[int, ...]) -> dict[str, Array]:
    """For each method, the rotations of figure 5.11 at which drawn hands' costs are least, shape (hands,), deg."""
    hand, X_PO = InexactHand(), turned_poses(grasp, TURNS_DEG)
    turns: dict[str, list[float]] = {method: [] for method in METHODS}
    for i in range(hands):
        for method, felt in feel_both(grasp, hand, level, np.random.default_rng((*seed, i))).items():
            cost = felt.objectives[objective_of(method)].cost(X_PO)
            turns[method].append(float(TURNS_DEG[cost.argmin()]))
    return {method: np.array(values) for method, values in turns.items()}
