"""Pose searches as MathematicalPrograms, by the solvers in Drake: from one pose by gradients, and by DIRECT.

Source: [G01] J. Gablonsky and C. Kelley, A locally-biased form of the DIRECT algorithm, J. Global Optim., 2001.
"""

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
from pydrake.autodiffutils import AutoDiffXd, ExtractGradient, ExtractValue
from pydrake.solvers import (
    IpoptSolver,
    MathematicalProgram,
    NloptSolver,
    SnoptSolver,
    SolverInterface,
    SolverOptions,
)

from tactopose_drake.core.objectives.objective import LeastSquaresObjective
from tactopose_drake.core.poses import retract, right_jacobian
from tactopose_drake.core.searches.box_search import BoxSearch
from tactopose_drake.core.searches.candidates import CandidatePoses
from tactopose_drake.core.searches.search import PoseSpace, Search, SearchResult, StopSignal, never
from tactopose_drake.core.validation import FloatArray, known_name, positive_number


class StoppedError(RuntimeError):
    """Stops a solver from its cost function: NLopt returns; SNOPT and IPOPT raise this or another RuntimeError."""


@dataclasses.dataclass(frozen=True)
class _Solver:
    make: Callable[[], SolverInterface]
    options: dict[str, Any]
    iteration_limit: str


# SNOPT's exit "the current point cannot be improved", with which it ends at a minimum on a kink of the cost.
_SNOPT_CANNOT_IMPROVE = 41

_SOLVERS = {
    "nlopt_slsqp": _Solver(NloptSolver, {"algorithm": "LD_SLSQP", "xtol_rel": 1e-10, "xtol_abs": 1e-10}, "max_eval"),
    # NLopt's own L-BFGS is not built into Drake (its code is under the LGPL); IPOPT's Hessian below is an L-BFGS one.
    "nlopt_ccsaq": _Solver(NloptSolver, {"algorithm": "LD_CCSAQ", "xtol_rel": 1e-10, "xtol_abs": 1e-10}, "max_eval"),
    "snopt": _Solver(SnoptSolver, {"Major optimality tolerance": 1e-8}, "Major iterations limit"),
    "ipopt": _Solver(
        IpoptSolver,
        {
            "hessian_approximation": "limited-memory",
            "tol": 1e-8,
            # The interpolated cost has kinks between cells; a minimum on a kink is recognised by a cost that stalls.
            "acceptable_tol": 1e10,
            "acceptable_obj_change_tol": 1e-6,
            "acceptable_iter": 10,
        },
        "max_iter",
    ),
}


@dataclasses.dataclass(frozen=True, kw_only=True)
class PoseProgram(Search):
    """Minimises an objective over the increment from one pose with one of Drake's solvers.

    The decision variables are the increment (w, v) from the centre of the space, each divided by the change that moves
    the object's surface by one centimetre, so that solvers that assume a unit metric take steps of suitable size. The
    gradient is exact for large increments, too, by the right Jacobian of SO(3).

    Attributes:
        solver: "nlopt_slsqp", "nlopt_ccsaq", "snopt" or "ipopt".
        length: lever arm that makes rotations and translations comparable, m; half the object's size.
        max_iterations: iteration limit of the solver; for NLopt, evaluations.
    """

    solver: str = "nlopt_slsqp"
    length: float = 0.05
    max_iterations: int = 2000

    def __post_init__(self) -> None:
        known_name("solver", self.solver, _SOLVERS)
        positive_number("length", self.length)

    def minimize(
        self,
        objective: LeastSquaresObjective,
        space: PoseSpace,
        generator: np.random.Generator,
        should_stop: StopSignal = never,
    ) -> SearchResult:
        """Minimises from the centre of the space; returns one pose, the best evaluated one if it is stopped."""
        units = np.repeat([0.01 / self.length, 0.01], 3)
        candidates = CandidatePoses(objective, space.center, units)
        stopped = False

        def cost(y: np.ndarray[Any, Any]) -> Any:
            nonlocal stopped
            stopped = stopped or (len(candidates) > 0 and should_stop())
            if stopped:
                raise StoppedError
            if y.dtype != object:
                return candidates.try_pose(y)
            increment = ExtractValue(y).ravel()
            value, gradient = cost_and_gradient(objective, space.center, increment * units)
            candidates.remember(increment, value)
            return AutoDiffXd(value, (gradient * units) @ ExtractGradient(y))

        program = MathematicalProgram()
        y = program.NewContinuousVariables(6, "y")
        program.AddCost(cost, vars=y)
        chosen = _SOLVERS[self.solver]
        solver = chosen.make()
        options = SolverOptions()
        for name, option in {**chosen.options, chosen.iteration_limit: self.max_iterations}.items():
            options.SetOption(solver.solver_id(), name, option)
        try:
            result = solver.Solve(program, np.zeros(6), options)
        except RuntimeError:
            if not stopped:
                raise
        if stopped:
            X_PO, converged = candidates.by_cost()[:1], False
        else:
            X_PO = candidates.pose(result.GetSolution(y))[None]
            at_kink = self.solver == "snopt" and result.get_solver_details().info == _SNOPT_CANNOT_IMPROVE
            converged = result.is_success() or at_kink
        return SearchResult(X_PO, objective.cost(X_PO), np.array([len(candidates)]), np.array([converged]))


def cost_and_gradient(
    objective: LeastSquaresObjective, X_start: FloatArray, increment: FloatArray
) -> tuple[float, FloatArray]:
    """The cost at X_start (3, 4) moved by an increment (6,), and its gradient with respect to the increment (6,)."""
    equations = objective.normal_equations(retract(X_start, increment)[None])
    gradient = equations.gradient[0].copy()
    # exp(w + dw) = exp(w) exp(J_r dw); the objective's gradient is with respect to the right-hand factor.
    gradient[:3] = right_jacobian(increment[:3]).T @ gradient[:3]
    return float(equations.cost[0]), gradient


@dataclasses.dataclass(frozen=True, kw_only=True)
class Direct(BoxSearch):
    """Divides the box of the search space, promising parts first; the best evaluated poses are then refined ([G01]).

    It uses no random numbers: the same problem gives the same poses.
    """

    def try_poses(self, candidates: CandidatePoses, generator: np.random.Generator, should_stop: StopSignal) -> None:
        """Evaluates poses by dividing the box."""

        def cost(y: np.ndarray[Any, Any]) -> AutoDiffXd:
            if len(candidates) and should_stop():
                raise StoppedError  # It stops NLopt; Drake does not pass it on.
            # Drake requires a gradient even though the algorithm uses none.
            return AutoDiffXd(candidates.try_pose(ExtractValue(y).ravel()))

        program = MathematicalProgram()
        y = program.NewContinuousVariables(6, "y")
        program.AddBoundingBoxConstraint(-1.0, 1.0, y)
        program.AddCost(cost, vars=y)
        solver, options = NloptSolver(), SolverOptions()
        options.SetOption(solver.solver_id(), NloptSolver.AlgorithmName(), "GN_DIRECT_L")
        options.SetOption(solver.solver_id(), NloptSolver.MaxEvalName(), self.max_evaluations)
        solver.Solve(program, np.zeros(6), options)
