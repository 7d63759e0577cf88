"""Where the object may be in each recorded grasp: what a calibration begins with, and what it comes back to.

A grasp's hypotheses come from the package's own estimate, with contacts as uncertain as the hand's errors make them at
that moment. One that is wrong would bend the whole calibration; so after each fit every hypothesis of every grasp is
tried with the hand as it is known by then, and the estimate is asked again with the contacts that this hand gives.
"""

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np

from tactopose_drake.core.calibration.annealed_fit import AnnealedFit, ContactNoise, anneal
from tactopose_drake.core.calibration.shared_least_squares import SharedProblem, linearize, solve_shared
from tactopose_drake.core.calibration.surface_rows import Noise, Touches
from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import FloatArray
from tactopose_drake.estimation.estimate import estimate_pose

_HYPOTHESES = 24  # of a grasp
_ROUGHLY = 1e-3  # relative change of the cost, at which a descent to a pose ends
_ROUNDS = 6
_FIRST, _AGAIN = 10.0, 4.0  # times the noise, with which a first fit begins, and a later one
_REFERENCE = (0.0006, 0.06)  # m, rad: noise with which fits are compared
_BETTER = 1e-3  # relative, of the cost
_LEAST = np.diag(np.repeat([1e-5**2, 1e-3**2], 3))  # covariance of a contact of a hand that errs in nothing


@dataclasses.dataclass(frozen=True, eq=False)
class PoseHunt:
    """What the search for the poses is about.

    Attributes:
        problem: all grasps.
        models: the object of each.
        noise: of the contacts, beside the hand's errors.
        seed: of the estimates' random numbers.
    """

    problem: SharedProblem
    models: Sequence[ObjectModel]
    noise: ContactNoise
    seed: int = 0

    def best_fit(self, tell: Callable[[float, str], None]) -> AnnealedFit:
        """The fit of the best poses that are found.

        Args:
            tell: is told how much of the work is done, from 0 to 1, and what begins.
        """
        tell(0.0, "looking for the object in each grasp")
        unit = np.zeros(self.problem.readings.shape[1])
        covariance = np.eye(len(unit))
        found = self._estimates(unit, covariance)
        tell(1 / (_ROUNDS + 2), "fitting the hand")
        best = anneal(self.problem, unit, np.array([poses[0] for poses in found]), self.noise, _FIRST)
        for k in range(_ROUNDS):
            tell((k + 2) / (_ROUNDS + 2), "looking for better poses")
            solution = best.solution
            more = self._estimates(solution.shared, solution.covariance)
            candidates = [np.concatenate([a, b]) for a, b in zip(found, more, strict=True)]
            X_PO = self._choose(solution.shared, solution.X_PO, candidates)
            changed = np.abs(X_PO - solution.X_PO).max(axis=(1, 2)) > 1e-3
            if not changed.any():
                break
            other = anneal(self.problem, solution.shared, X_PO, self.noise, _AGAIN)
            if not self._cost(other) < self._cost(best) * (1.0 - _BETTER):
                break
            best = other
        return best

    def _cost(self, fit: AnnealedFit) -> float:
        count = len(fit.noise.by_wrench.position)
        noise = Noise(*(np.full(count, sigma) for sigma in _REFERENCE))
        return linearize(self.problem, fit.solution.shared, fit.solution.X_PO, noise).cost

    def _estimates(self, unit: FloatArray, covariance: FloatArray) -> list[FloatArray]:
        """The hypotheses of each grasp, best first, shape (h, 3, 4) each; the identity where nothing is felt."""
        touches, total = self.problem.touch(unit), self.noise.total
        by_hand = touches.J @ covariance @ np.swapaxes(touches.J, 1, 2) + _LEAST
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
            estimate = estimate_pose(model, contacts, seed=self.seed, max_hypotheses=_HYPOTHESES)
            found.append(np.array([h.X_PO.GetAsMatrix34() for h in estimate.hypotheses]))
        return found

    def _choose(self, unit: FloatArray, X_PO: FloatArray, candidates: Sequence[FloatArray]) -> FloatArray:
        """Of each grasp the pose that fits best with a hand of these errors, by descent from each candidate."""
        frozen = self.problem.touch(unit)
        chosen, least = X_PO.copy(), np.full(len(X_PO), np.inf)
        noise = Noise(*(np.full(len(frozen.grasp), sigma) for sigma in _REFERENCE))
        for k in range(-1, max(map(len, candidates))):
            start = X_PO if k < 0 else np.array([poses[min(k, len(poses) - 1)] for poses in candidates])
            poses, cost = fit_poses(self.problem, frozen, start, noise)
            better = cost < least - _BETTER
            chosen[better], least[better] = poses[better], cost[better]
        return chosen


def fit_poses(
    problem: SharedProblem, touches: Touches, X_PO: FloatArray, noise: Noise
) -> tuple[FloatArray, FloatArray]:
    """Descends to the nearest poses, the contacts being what they are.

    Returns:
        The poses, shape (g, 3, 4), and the sum of squares of each grasp, shape (g,), each contact's bounded.
    """
    fixed = touches._replace(J=np.zeros((len(touches.grasp), 6, 0)))
    alone = SharedProblem(lambda _: fixed, problem.grids, np.zeros((0, 0)), np.zeros(0))
    for widened in (4.0, 1.0):
        wide = Noise(widened * noise.position, widened * noise.normal)
        solution = solve_shared(alone, np.zeros(0), X_PO, wide, _ROUGHLY)
        X_PO = solution.X_PO
    square = np.minimum(np.sum(solution.at.rows.residual**2, axis=1), 25.0)
    return X_PO, np.asarray(np.bincount(touches.grasp, weights=square, minlength=len(X_PO)), dtype=np.float64)
