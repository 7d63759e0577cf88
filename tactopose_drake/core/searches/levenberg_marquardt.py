"""Levenberg-Marquardt over a batch of starting poses.

Source: [B16] J. Bimbo, thesis, 2016, section 2.6.2.2, eqs. 2.30 and 2.31, and its damping rule.
"""

import dataclasses
import functools
from collections.abc import Callable, Iterator
from typing import cast

import numpy as np

from tactopose_drake.core.kernels import least_squares_kernels
from tactopose_drake.core.kernels.least_squares_kernels import DescentRule
from tactopose_drake.core.objectives.objective import (
    Descent,
    LeastSquaresObjective,
    NormalEquations,
    SmoothObjective,
)
from tactopose_drake.core.searches.parameters import IncrementParameters, Parameters
from tactopose_drake.core.searches.search import PoseSpace, Search, SearchResult, StopSignal, join_results, never
from tactopose_drake.core.validation import FloatArray

# A compiled descent can be stopped after this many steps, about a millisecond.
_BLOCK = 2048

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
    least_squares_kernels.damped_steps(hessian, gradient, damping, step)
    return step


@dataclasses.dataclass(frozen=True, kw_only=True)
class LevenbergMarquardt(Search):
    """Levenberg-Marquardt with the thesis' damping rule: a tenth after a better step, tenfold after a rejected one.

    Attributes:
        max_iterations: steps tried for each pose.
        tolerance: a pose has converged when the actual or predicted decrease of its cost is less than
            tolerance (1 + cost), or when rejected steps have driven the damping beyond `max_damping`.
        initial_damping, max_damping: lambda of [B16] eq. 2.30.
        least_refused: least lambda after a rejected step. Zero is the thesis' rule: after many accepted steps,
            many are rejected before lambda has grown enough to have an effect, at about a tenth.
        parameters: the parametrisation: six increments, or the thesis' quaternion and translation.
        solver: how the damped equations are solved.
    """

    max_iterations: int = 100
    tolerance: float = 1e-6
    initial_damping: float = 1e-3
    max_damping: float = 1e6
    least_refused: float = 0.0
    parameters: Parameters = dataclasses.field(default_factory=IncrementParameters)
    solver: Solver = cholesky_steps

    def minimize(
        self,
        objective: LeastSquaresObjective,
        space: PoseSpace,
        generator: np.random.Generator,
        should_stop: StopSignal = never,
    ) -> SearchResult:
        """Minimises from the centre of the space."""
        return self.refine(objective, space.center[None], should_stop)

    def refine(self, objective: SmoothObjective, X_start: FloatArray, should_stop: StopSignal = never) -> SearchResult:
        """Minimises from each of the poses (B, 3, 4); returns the minima in ascending order of cost.

        With increments any smooth objective will do; other parametrisations need residuals.
        """
        return self.refine_each(objective, X_start, should_stop).ranked()

    def refine_each(
        self, objective: SmoothObjective, X_start: FloatArray, should_stop: StopSignal = never
    ) -> SearchResult:
        """The same, but returns the minima in the order of the poses that led to them."""
        X_start = np.ascontiguousarray(X_start)
        by_increments = isinstance(self.parameters, IncrementParameters)
        descent = objective.descent if by_increments and self.solver is cholesky_steps else None
        if descent is not None:
            blocks = self._descend(descent, X_start, should_stop)
            return join_results(*blocks)
        least_squares = cast(LeastSquaresObjective, objective)
        here = self.parameters.start(X_start).copy()
        state, cost = here.copy(), np.empty(len(here))
        iterations, converged = np.zeros(len(here), dtype=np.int64), np.zeros(len(here), dtype=np.bool_)
        # The working arrays hold the poses that have not converged; `active` gives their indices.
        active, start, damping = np.arange(len(here)), X_start, np.full(len(here), self.initial_damping)
        rule = self._rule
        equations = self.parameters.normal_equations(least_squares, here, X_start)
        hessian = np.empty_like(equations.hessian)
        for iteration in range(1, self.max_iterations + 1):
            step = self.solver(equations.hessian, equations.gradient, damping)
            moved = self.parameters.move(here, step)
            there = self.parameters.normal_equations(least_squares, moved, start)
            done = np.empty(len(here), dtype=np.bool_)
            least_squares_kernels.accept_steps(
                least_squares_kernels.Problems(here.reshape(len(here), -1), *equations),
                least_squares_kernels.Problems(moved.reshape(len(here), -1), *there),
                step,
                damping,
                rule,
                done,
            )
            last = iteration == self.max_iterations or should_stop()
            if last or done.any():
                ended = np.ones(len(here), dtype=np.bool_) if last else done
                index = active[ended]
                state[index], cost[index], hessian[index] = here[ended], equations.cost[ended], equations.hessian[ended]
                iterations[index], converged[index] = iteration, done[ended]
                going = ~ended
                active, start, here, damping = active[going], start[going], here[going], damping[going]
                equations = NormalEquations(*(array[going] for array in equations))
                if not len(active):
                    break
        X_PO, known = self.parameters.poses(state, X_start), hessian if by_increments else None
        return SearchResult(X_PO, cost, iterations, converged, known)

    @functools.cached_property
    def _rule(self) -> DescentRule:
        numbers = self.tolerance, self.initial_damping, self.max_damping, self.least_refused
        return DescentRule(self.max_iterations, *map(float, numbers))

    def _descend(
        self, descent: Callable[[DescentRule, FloatArray], Descent], X_start: FloatArray, should_stop: StopSignal
    ) -> Iterator[SearchResult]:
        """The same in compiled blocks of poses; after the stop signal the remaining poses are returned as they are."""
        rule = self._rule
        standing = rule._replace(max_iterations=0)
        size = 1 + _BLOCK // (1 + self.max_iterations)
        for first in range(0, max(1, len(X_start)), size):
            yield SearchResult(*descent(rule, X_start[first : first + size]))
            if should_stop():
                rule = standing


LEAST_REFUSED = 0.1
"""A good value of `least_refused`: a smaller one hardly changes the step. It saves a tenth of the trials."""

TO_THE_MINIMUM = LevenbergMarquardt(max_iterations=20, tolerance=1e-3, least_refused=LEAST_REFUSED)
"""To convergence: a pose still on its way down a valley would count as a mode of its own."""
