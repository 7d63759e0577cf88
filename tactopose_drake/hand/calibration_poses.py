"""Search for the object's pose in each recorded grasp, alternating with the fit of the hand's errors.

A grasp's hypotheses come from `estimate_pose`, with contact covariances that the current uncertainty of the hand
implies. A wrong pose would bias the whole calibration. So after each fit every hypothesis of every grasp is compared
again for the hand as fitted so far, and the estimate is repeated with the contacts that this hand gives. The whole is
restarted from other hypotheses until two attempts agree.
"""

import dataclasses
import functools
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from tactopose_drake.core.calibration.annealed_fit import AnnealedFit, ContactNoise, anneal, start_noise
from tactopose_drake.core.calibration.grasp_candidates import Candidates, GraspTouches, explain, mixture
from tactopose_drake.core.calibration.shared_least_squares import (
    Knowledge,
    SharedProblem,
    linearize,
    others,
    solve_shared,
)
from tactopose_drake.core.calibration.surface_residuals import ContactSigmas, GraspContacts
from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import FloatArray
from tactopose_drake.estimation.estimate import estimate_pose
from tactopose_drake.hand.contact_uncertainty import LEAST_COVARIANCE

_HYPOTHESES = 24  # of a grasp
_ROUGHLY = 1e-3  # relative change of the cost at which a descent to a pose ends
_ROUNDS = 6
_ATTEMPTS = 4
_AGREE = 0.01  # two attempts agree if the relative difference of their costs is below this
_MOVED = 1e-3  # a pose counts as another one if an entry changes by more than this, m or 1
_AGAIN = 4.0  # multiple of the noise with which a later fit begins
_BETTER = 1e-3  # least relative decrease of the cost for another fit to be accepted


class PoseFit(NamedTuple):
    """The best fit and its uncertainty.

    Attributes:
        fit: the fit with the most probable pose of each grasp.
        known: mean and covariance of the shared unknowns, allowing for other poses of the grasps.
        probability: probability of each grasp's pose, shape (g,).
    """

    fit: AnnealedFit
    known: Knowledge
    probability: FloatArray


@dataclasses.dataclass(frozen=True, eq=False)
class PoseHunt:
    """The search for the poses of all grasps.

    Attributes:
        problem: the least-squares problem of all grasps.
        models: the object of each grasp.
        noise: noise of the contacts beside the hand's errors.
        seed: seed of the estimates' random numbers.
    """

    problem: SharedProblem
    models: Sequence[ObjectModel]
    noise: ContactNoise
    seed: int = 0

    def best_fit(self, tell: Callable[[float, str], None]) -> PoseFit:
        """Finds the best poses and the fit to them.

        Args:
            tell: called with the share of the work that is done, from 0 to 1, and the name of the next step.
        """
        tell(0.0, "looking for the object in each grasp")
        none = np.zeros(self.problem.readings.shape[1])
        found, generator = self._estimates(none, np.eye(len(none))), np.random.default_rng(self.seed)
        best: AnnealedFit | None = None
        for attempt in range(_ATTEMPTS):
            # The first attempt starts from the most probable pose of each grasp, the others from random hypotheses.
            picks = [0 if attempt == 0 else int(generator.integers(len(poses))) for poses in found]
            X_PO = np.array([poses[k] for poses, k in zip(found, picks, strict=True)])
            fit = self._descend(X_PO, found, functools.partial(_tell_share, tell, attempt))
            if best is None:
                best = fit
                continue
            costs = self._costs(fit, best)
            if costs[0] < costs[1]:
                best = fit
            if abs(costs[0] - costs[1]) < _AGREE * min(costs):
                break
        assert best is not None
        compared = self._compare(best, self._with_more(best, found))
        solution = best.solution
        known = mixture(compared, others(self.problem, solution), Knowledge(solution.shared, solution.covariance))
        return PoseFit(best, known, np.array([poses.probability[poses.taken] for poses in compared]))

    def _costs(self, *fits: AnnealedFit) -> list[float]:
        """The costs of several fits, all with the smallest noise that any of them found."""
        noise = self.noise._replace(
            position=min(fit.noise.position for fit in fits), normal=min(fit.noise.normal for fit in fits)
        )
        return [linearize(self.problem, f.solution.shared, f.solution.X_PO, noise.total).cost for f in fits]

    def _descend(self, X_PO: FloatArray, found: Sequence[FloatArray], tell: Callable[[float], None]) -> AnnealedFit:
        """The fit to which starting poses lead."""
        none = np.zeros(self.problem.readings.shape[1])
        tell(0.5 / (_ROUNDS + 1))
        best = anneal(self.problem, none, X_PO, self.noise, start_noise(self.problem.touch(none), self.noise))
        for k in range(_ROUNDS):
            tell((k + 1) / (_ROUNDS + 1))
            better = self._with_other_poses(best, self._compare(best, self._with_more(best, found)))
            if better is None:
                break
            best = better
        return best

    def _with_other_poses(self, best: AnnealedFit, compared: Sequence[Candidates]) -> AnnealedFit | None:
        """A fit of lower cost with the most probable poses of all grasps or of a single one; None if there is none."""
        solution = best.solution
        X_PO = np.array([candidates.X_PO[0] for candidates in compared])
        moved = np.flatnonzero(np.abs(X_PO - solution.X_PO).max(axis=(1, 2)) > _MOVED)
        again = _AGAIN * max(self.noise.position, best.noise.position), _AGAIN * best.noise.normal
        attempts = [moved] if len(moved) < 2 else [moved, *moved[:, None]]
        for places in attempts if len(moved) else []:
            start = solution.X_PO.copy()
            start[places] = X_PO[places]
            other = anneal(self.problem, solution.shared, start, self.noise, again)
            # Compare with the same noise: a worse fit would otherwise be excused by its larger noise.
            there = linearize(self.problem, other.solution.shared, other.solution.X_PO, best.noise.total)
            if there.cost < solution.at.cost * (1.0 - _BETTER):
                return other
        return None

    def _estimates(self, unit: FloatArray, covariance: FloatArray) -> list[FloatArray]:
        """The hypotheses of each grasp, best first, shape (h, 3, 4) each; the identity for a grasp without contacts."""
        touches, total = self.problem.touch(unit), self.noise.total
        by_hand = touches.J @ covariance @ np.swapaxes(touches.J, 1, 2) + LEAST_COVARIANCE
        by_hand[:, :3, :3] += total.position[:, None, None] ** 2 * np.eye(3)
        by_hand[:, 3:, 3:] += total.normal[:, None, None] ** 2 * np.eye(3)
        by_hand = 0.5 * (by_hand + np.swapaxes(by_hand, 1, 2))
        found = []
        for g, model in enumerate(self.models):
            rows = np.flatnonzero((touches.grasp == g) & touches.valid)
            if not len(rows):
                found.append(np.eye(3, 4)[None])
                continue
            contacts = Contacts(touches.p_PC[rows], touches.n_PC[rows], covariance=by_hand[rows])
            # No outliers here: the joint fit of all grasps identifies false contacts better.
            estimate = estimate_pose(
                model, contacts, seed=self.seed, max_hypotheses=_HYPOTHESES, outlier_probability=0.0
            )
            found.append(np.array([h.X_PO.GetAsMatrix34() for h in estimate.hypotheses]))
        return found

    def _with_more(self, fit: AnnealedFit, found: Sequence[FloatArray]) -> list[FloatArray]:
        """The candidates, plus the hypotheses of new estimates with the hand as fitted."""
        more = self._estimates(fit.solution.shared, fit.solution.covariance)
        return [np.concatenate([a, b]) for a, b in zip(found, more, strict=True)]

    def _compare(self, fit: AnnealedFit, candidates: Sequence[FloatArray]) -> list[Candidates]:
        """The possible poses of each grasp, by descent from its candidates with the hand as all other grasps fit it."""
        found, noise = [], fit.noise.total
        for g, known in enumerate(others(self.problem, fit.solution)):
            felt = GraspTouches.of(self.problem.touch(known.mean), noise, self.problem.grids, g)
            start = np.concatenate([fit.solution.X_PO[g : g + 1], candidates[g]])
            found.append(explain(felt, start, known))
        return found


def _tell_share(tell: Callable[[float, str], None], attempt: int, share: float) -> None:
    tell((attempt + share) / _ATTEMPTS, "fitting the hand")


def fit_poses(
    problem: SharedProblem, touches: GraspContacts, X_PO: FloatArray, noise: ContactSigmas
) -> tuple[FloatArray, FloatArray]:
    """Descends to the nearest poses for fixed contacts.

    Returns:
        The poses, shape (g, 3, 4), and the sum of squares of each grasp, shape (g,), with each contact's bounded.
    """
    fixed = touches._replace(J=np.zeros((len(touches.grasp), 6, 0)))
    alone = SharedProblem(lambda _: fixed, problem.grids, np.zeros((0, 0)), np.zeros(0))
    for widened in (4.0, 1.0):
        wide = ContactSigmas(widened * noise.position, widened * noise.normal)
        solution = solve_shared(alone, np.zeros(0), X_PO, wide, _ROUGHLY)
        X_PO = solution.X_PO
    square = np.minimum(np.sum(solution.at.rows.residual**2, axis=1), 25.0)
    return X_PO, np.asarray(np.bincount(touches.grasp, weights=square, minlength=len(X_PO)), dtype=np.float64)
