"""Corrects displaced poses of the grips of `pad_grasps.py`, and computes the errors of the results.

Source: [B16] J. Bimbo, Touch Based Object Pose Estimation For Robotic Grasping, thesis, 2016, section 5.3.
"""

import dataclasses
import time

import numpy as np
from grasp_trials import pose_errors
from pad_grasps import (
    DISTANCE,
    OURS,
    PCA,
    SIGMA_SHIFT,
    SIGMA_TURN,
    Array,
    DisplacedSpace,
    PadGrasp,
    displaced_poses,
)
from rich.console import Console
from rich.progress import track
from scipy.stats import spearmanr

import tactopose_drake as tp
from tactopose_drake.core.objectives import PriorObjective, SumObjective
from tactopose_drake.core.poses import increments_between, retract
from tactopose_drake.core.searches import LevenbergMarquardt, PriorSpace, patch_search
from tactopose_drake.estimation import Direct

METHODS = (PCA, DISTANCE, OURS)
# Our objective with other searches: descent from the initial pose alone, and our search with a final descent
# without the prior.
DESCENDED, SETTLED = "descent alone", "ours, then to the minimum"
SEARCHES = (DESCENDED, OURS, SETTLED)
DIRECT = Direct(max_evaluations=5000, refined=10)


@dataclasses.dataclass(frozen=True, eq=False)
class Trials:
    """One objective's trials on one grasp.

    Attributes:
        cost: costs of the final poses, shape (n,).
        error: errors of the final poses, mm and deg, shape (n, 2).
        way_cost, way_error: the same for poses on the way from the true one to the displaced ones.
        seconds: mean CPU time of a trial.
    """

    cost: Array
    error: Array
    way_cost: Array
    way_error: Array
    seconds: float

    def numbers(self) -> Array:
        """The columns, shape (8,)."""
        at_least = self.error[self.cost.argmin()]
        ends = rank_correlations(self.cost, self.error), rank_correlations(self.way_cost, self.way_error)
        return np.concatenate([self.error.mean(axis=0), at_least, *ends])


def rank_correlations(cost: Array, error: Array) -> Array:
    """Spearman's rho, [B16] eq. 5.12, between costs (n,) and each column of errors (n, 2), shape (2,)."""
    return np.array([spearmanr(cost, column).statistic for column in error.T])


def errors_of(grasp: PadGrasp, X_PO: Array) -> Array:
    """Errors of poses (n, 3, 4), mm and deg, shape (n, 2)."""
    errors = pose_errors(grasp.model, X_PO, grasp.X_PO)
    return np.stack([1e3 * errors.translation, np.degrees(errors.rotation)], axis=1)


def correct(grasp: PadGrasp, method: str, X_PO: Array, generator: np.random.Generator) -> Array:
    """The best pose (3, 4) that a method finds from a displaced one (3, 4)."""
    if method in (PCA, DISTANCE):
        found = DIRECT.minimize(grasp.objectives[method], DisplacedSpace(X_PO), generator)
    elif method == DESCENDED:
        found = LevenbergMarquardt().refine(grasp.objectives[OURS], X_PO[None])
    else:
        prior = tp.PosePrior(X_PO, SIGMA_SHIFT, SIGMA_TURN)
        posterior = SumObjective([grasp.objectives[OURS], PriorObjective(prior)])
        found = patch_search(grasp.model, grasp.patches).minimize(posterior, PriorSpace(prior), generator)
        if method == SETTLED:
            found = LevenbergMarquardt().refine(grasp.objectives[OURS], found.X_PO[:1])
    best: Array = found.X_PO[0]
    return best


def run_trials(grasp: PadGrasp, trials: int, seed: tuple[int, int], label: str) -> dict[str, Trials]:
    """Corrects the same displaced poses by every method."""
    generator = np.random.default_rng(seed)
    starts = displaced_poses(grasp.X_PO, trials, generator)
    shares = generator.uniform(size=(trials, 1))
    true = np.repeat(grasp.X_PO[None], trials, axis=0)
    way = retract(true, shares * increments_between(true, starts))
    console = Console(stderr=True)
    results = {}
    for method in dict.fromkeys(METHODS + SEARCHES):
        correct(grasp, method, starts[0], np.random.default_rng(0))  # Compiles, and computes what a model keeps.
        begin = time.process_time()
        described = track(starts, f"{label}: {method}", console=console, transient=True)
        X_PO = np.array([correct(grasp, method, start, generator) for start in described])
        seconds = (time.process_time() - begin) / trials
        cost = grasp.objectives[method if method in METHODS else OURS].cost
        results[method] = Trials(cost(X_PO), errors_of(grasp, X_PO), cost(way), errors_of(grasp, way), seconds)
    return results
