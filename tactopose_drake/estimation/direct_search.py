"""DIRECT over the increments from the centre of a space, by NLopt's GN_DIRECT_L, which Drake includes.

Source: [G01] J. Gablonsky and C. Kelley, A locally-biased form of the DIRECT algorithm, J. Global Optim., 2001.
"""

import dataclasses
from typing import Any

import numpy as np
from pydrake.autodiffutils import AutoDiffXd, ExtractValue
from pydrake.solvers import MathematicalProgram, NloptSolver, SolverOptions

from tactopose_drake.core.searches.box_search import BoxSearch
from tactopose_drake.core.searches.candidates import CandidatePoses
from tactopose_drake.core.searches.search import StopSignal
from tactopose_drake.estimation.mathematical_program import StoppedError


@dataclasses.dataclass(frozen=True, kw_only=True)
class Direct(BoxSearch):
    """Divides the box of the search space, promising parts first; the best evaluated poses are then refined.

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
