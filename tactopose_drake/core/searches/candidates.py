"""Poses that a search has evaluated; the best distinct ones start the final refinement."""

import numpy as np

from tactopose_drake.core.kernels import pose_kernels
from tactopose_drake.core.objectives.objective import LeastSquaresObjective
from tactopose_drake.core.searches.levenberg_marquardt import LevenbergMarquardt
from tactopose_drake.core.searches.pairs.distinct_kernels import distinct_poses
from tactopose_drake.core.searches.search import SearchResult, StopSignal
from tactopose_drake.core.validation import FloatArray

# Poses closer than this, m and rad, count as the same: only the best is refined.
_SAME_PLACE, _SAME_TURN = 0.01, 0.2


class CandidatePoses:
    """Costs of increments from a centre, evaluated one at a time and recorded.

    The increments are scaled by units, so that each coordinate changes the pose about equally.
    """

    def __init__(self, objective: LeastSquaresObjective, center: FloatArray, units: FloatArray) -> None:
        self._objective, self._center, self._units = objective, np.array(center), units
        self._tried: list[FloatArray] = []
        self._cost: list[float] = []

    def __len__(self) -> int:
        return len(self._cost)

    def pose(self, y: FloatArray) -> FloatArray:
        """The pose (3, 4) of an increment (6,)."""
        X_PO: FloatArray = self._poses(y[None])[0]
        return X_PO

    def _poses(self, y: FloatArray) -> FloatArray:
        X_PO = np.empty((len(y), 3, 4))
        pose_kernels.retract(self._center[None], y * self._units, X_PO)
        return X_PO

    def try_pose(self, y: FloatArray) -> float:
        """Evaluates and records the cost of an increment (6,)."""
        cost = float(self._objective.cost(self.pose(y)[None])[0])
        self.remember(y, cost)
        return cost

    def remember(self, y: FloatArray, cost: float) -> None:
        """Records an increment (6,) of known cost."""
        self._tried.append(np.array(y))
        self._cost.append(cost)

    def by_cost(self) -> FloatArray:
        """The poses (n, 3, 4) in ascending order of cost."""
        order = np.argsort(self._cost, kind="stable")
        return self._poses(np.array(self._tried)[order])


def refine_best(
    objective: LeastSquaresObjective,
    X_PO: FloatArray,
    count: int,
    refinement: LevenbergMarquardt,
    should_stop: StopSignal,
) -> SearchResult:
    """Refines the first `count` distinct poses out of poses (n, 3, 4) in ascending order of cost."""
    return refinement.refine(objective, X_PO[distinct_poses(X_PO, _SAME_PLACE, _SAME_TURN)][:count], should_stop)
