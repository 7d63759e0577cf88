"""Levenberg-Marquardt over a batch of starting poses.

Source: [B16] J. Bimbo, thesis, 2016, section 2.6.2.2, eqs. 2.30 and 2.31, and its damping rule.
"""

import dataclasses
from collections.abc import Callable

import numpy as np

from tactopose_drake.core import kernels
from tactopose_drake.core.objectives.base import LeastSquaresObjective
from tactopose_drake.core.searches.base import PoseSpace, SearchResult
from tactopose_drake.core.searches.parameters import IncrementParameters, Parameters
from tactopose_drake.core.validation import FloatArray

Solver = Callable[[FloatArray, FloatArray, FloatArray], FloatArray]


def pseudo_inverse_steps(hessian: FloatArray, gradient: FloatArray, damping: FloatArray) -> FloatArray:
    """-(H + damping diag H)^+ g, shape (B, n). [B16] eqs. 2.30 and 2.31."""
    diagonal = np.einsum("bii->bi", hessian)
    damped = hessian + (damping[:, None] * diagonal)[:, :, None] * np.eye(hessian.shape[-1])
    step: FloatArray = -(np.linalg.pinv(damped, hermitian=True) @ gradient[..., None])[..., 0]
    return step


def cholesky_steps(hessian: FloatArray, gradient: FloatArray, damping: FloatArray) -> FloatArray:
    """The same by a compiled Cholesky factorisation, many times faster; undetermined directions get no step."""
    step = np.empty_like(gradient)
    kernels.damped_steps(hessian, gradient, damping, step)
    return step


@dataclasses.dataclass(frozen=True, kw_only=True)
class LevenbergMarquardt:
    """Levenberg-Marquardt with the thesis' damping rule: a tenth after a better step, tenfold after a rejected one.

    Attributes:
        max_iterations: steps tried for each pose.
        tolerance: a pose has converged when an accepted step lowers its cost by less than this fraction (or by less
            than 1e-9), or when rejected steps have driven the damping beyond `max_damping`.
        initial_damping, max_damping: lambda of [B16] eq. 2.30.
        parameters: what is moved: six increments, or the thesis' quaternion and translation.
        solver: how the damped equations are solved.
    """

    max_iterations: int = 100
    tolerance: float = 1e-6
    initial_damping: float = 1e-3
    max_damping: float = 1e6
    parameters: Parameters = dataclasses.field(default_factory=IncrementParameters)
    solver: Solver = cholesky_steps

    def minimize(
        self, objective: LeastSquaresObjective, space: PoseSpace, generator: np.random.Generator
    ) -> SearchResult:
        """Minimises from the centre of the space."""
        return self.refine(objective, space.center[None])

    def refine(self, objective: LeastSquaresObjective, X_start: FloatArray) -> SearchResult:
        """Minimises from each of the poses (B, 3, 4); returns them by rising cost."""
        X_start = np.ascontiguousarray(X_start)
        count = len(X_start)
        state = self.parameters.start(X_start).copy()
        cost, gradient, hessian = self.parameters.normal_equations(objective, state, X_start)
        damping = np.full(count, self.initial_damping)
        iterations, converged = np.zeros(count, dtype=np.int64), np.zeros(count, dtype=np.bool_)
        active = np.arange(count)
        for _ in range(self.max_iterations):
            step = self.solver(hessian[active], gradient[active], damping[active])
            moved = self.parameters.move(state[active], step)
            there = self.parameters.normal_equations(objective, moved, X_start[active])
            iterations[active] += 1
            decrease = cost[active] - there.cost
            better = decrease > 0.0
            accepted = active[better]
            small = better & (decrease <= self.tolerance * cost[active] + 1e-9)
            state[accepted], cost[accepted] = moved[better], there.cost[better]
            gradient[accepted], hessian[accepted] = there.gradient[better], there.hessian[better]
            damping[active] *= np.where(better, 0.1, 10.0)
            done = small | (damping[active] > self.max_damping)
            converged[active[done]] = True
            active = active[~done]
            if not len(active):
                break
        return SearchResult(self.parameters.poses(state, X_start), cost, iterations, converged).ranked()
