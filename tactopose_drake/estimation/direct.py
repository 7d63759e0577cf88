"""DIRECT over the increments from the centre of a space: NLopt's GN_DIRECT_L, which Drake brings.

Source: [G01] J. Gablonsky and C. Kelley, A locally-biased form of the DIRECT algorithm, J. Global Optim., 2001.
"""

import dataclasses
from typing import Any

import numpy as np
from pydrake.autodiffutils import AutoDiffXd, ExtractValue
from pydrake.solvers import MathematicalProgram, NloptSolver, SolverOptions

from tactopose_drake.core.objectives.objective import LeastSquaresObjective
from tactopose_drake.core.searches.candidates import CandidatePoses, refine_best
from tactopose_drake.core.searches.levenberg_marquardt import LevenbergMarquardt
from tactopose_drake.core.searches.search import PoseSpace, Search, SearchResult, StopSignal, never
from tactopose_drake.estimation.mathematical_program import StoppedError


@dataclasses.dataclass(frozen=True, kw_only=True)
class Direct(Search):
    """Divides the box that the space reaches, the promising parts first; the best poses that it saw are refined.

    It takes no random number: the same problem gives the same poses.

    Attributes:
        max_evaluations: poses tried at the most.
        refined: so many of the best distinct poses are refined in the end.
        refinement: how.
    """

    max_evaluations: int = 20_000
    refined: int = 20
    refinement: LevenbergMarquardt = dataclasses.field(default_factory=LevenbergMarquardt)

    def minimize(
        self,
        objective: LeastSquaresObjective,
        space: PoseSpace,
        generator: np.random.Generator,
        should_stop: StopSignal = never,
    ) -> SearchResult:
        """The minima that the best of the visited poses lead to, by rising cost."""
        candidates = CandidatePoses(objective, space.center, np.repeat(space.reach, 3))

        def cost(y: np.ndarray[Any, Any]) -> AutoDiffXd:
            if len(candidates) and should_stop():
                raise StoppedError  # NLopt stops at it, and Drake swallows it.
            # Drake asks for a gradient even where the algorithm uses none.
            return AutoDiffXd(candidates.try_pose(ExtractValue(y).ravel()))

        program = MathematicalProgram()
        y = program.NewContinuousVariables(6, "y")
        program.AddBoundingBoxConstraint(-1.0, 1.0, y)
        program.AddCost(cost, vars=y)
        solver, options = NloptSolver(), SolverOptions()
        options.SetOption(solver.solver_id(), NloptSolver.AlgorithmName(), "GN_DIRECT_L")
        options.SetOption(solver.solver_id(), NloptSolver.MaxEvalName(), self.max_evaluations)
        solver.Solve(program, np.zeros(6), options)
        found = refine_best(objective, candidates.by_cost(), self.refined, self.refinement, should_stop)
        return found._replace(iterations=found.iterations + len(candidates))
