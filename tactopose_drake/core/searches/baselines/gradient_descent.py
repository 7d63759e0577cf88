"""Gradient descent over a batch of starting poses.

Source: [B16] J. Bimbo, thesis, 2016, section 2.6.2.2, eq. 2.29.
"""

import dataclasses

import numpy as np

from tactopose_drake.core.objectives.objective import LeastSquaresObjective
from tactopose_drake.core.searches.parameters import IncrementParameters, Parameters
from tactopose_drake.core.searches.search import PoseSpace, Search, SearchResult, StopSignal, never
from tactopose_drake.core.validation import FloatArray


@dataclasses.dataclass(frozen=True, kw_only=True)
class GradientDescent(Search):
    """x <- x - lambda J^T G, with each parameter in units that displace the object's surface about equally.

    The step size lambda starts at the inverse of the largest curvature at the start. A step that raises the cost is
    rejected and halves lambda; one that lowers it increases lambda by a tenth. At a kink of the cost, such as between
    the cells of a distance grid, the negative gradient may be no descent direction: there it stops above the minimum.

    Attributes:
        max_iterations: steps tried for each pose.
        tolerance: a pose has converged when an accepted step lowers its cost by less than this fraction.
        length: lever arm that makes rotations and translations comparable, m; half the object's size.
        parameters: the parametrisation: six increments, or the thesis' quaternion and translation.
    """

    max_iterations: int = 5_000
    tolerance: float = 1e-9
    length: float = 0.05
    parameters: Parameters = dataclasses.field(default_factory=IncrementParameters)

    def minimize(
        self,
        objective: LeastSquaresObjective,
        space: PoseSpace,
        generator: np.random.Generator,
        should_stop: StopSignal = never,
    ) -> SearchResult:
        """Minimises from the centre of the space."""
        return self.refine(objective, space.center[None], should_stop)

    def refine(
        self, objective: LeastSquaresObjective, X_start: FloatArray, should_stop: StopSignal = never
    ) -> SearchResult:
        """Minimises from each of the poses (B, 3, 4); returns them in ascending order of cost."""
        scales = self.parameters.scales(self.length)
        count = len(X_start)
        state = self.parameters.start(X_start).copy()
        cost, gradient, hessian = self.parameters.normal_equations(objective, state, X_start)
        curvature = np.linalg.eigvalsh(hessian * np.outer(scales, scales))[:, -1]
        step_size = 1.0 / np.maximum(curvature, 1e-300)
        iterations, converged = np.zeros(count, dtype=np.int64), np.zeros(count, dtype=np.bool_)
        active = np.arange(count)
        for _ in range(self.max_iterations):
            step = -step_size[active, None] * gradient[active] * scales**2
            moved = self.parameters.move(state[active], step)
            there = self.parameters.normal_equations(objective, moved, X_start[active])
            iterations[active] += 1
            decrease = cost[active] - there.cost
            better = decrease > 0.0
            accepted = active[better]
            small = better & (decrease <= self.tolerance * cost[active])
            state[accepted], cost[accepted] = moved[better], there.cost[better]
            gradient[accepted] = there.gradient[better]
            step_size[active] *= np.where(better, 1.1, 0.5)
            stuck = step_size[active] * curvature[active] < 1e-9
            done = small | stuck
            converged[active[done]] = True
            active = active[~done]
            if not len(active) or should_stop():
                break
        return SearchResult(self.parameters.poses(state, X_start), cost, iterations, converged).ranked()
