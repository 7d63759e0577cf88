"""Simulated annealing over the increments from the centre of a space, by SciPy.

Source: [X97] Y. Xiang et al., Generalized simulated annealing algorithm and its application to the Thomson model, 1997,
which `scipy.optimize.dual_annealing` implements.
"""

import contextlib
import dataclasses

import numpy as np
from scipy.optimize import dual_annealing

from tactopose_drake.core.objectives.objective import LeastSquaresObjective
from tactopose_drake.core.searches.candidates import CandidatePoses, refine_best
from tactopose_drake.core.searches.levenberg_marquardt import LevenbergMarquardt
from tactopose_drake.core.searches.search import PoseSpace, Search, SearchResult, StopSignal, never
from tactopose_drake.core.validation import FloatArray


class _StoppedError(Exception):
    """Ends SciPy's loop from within the cost."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class SimulatedAnnealing(Search):
    """Generalised simulated annealing on the box that the space reaches; the best poses that it saw are refined.

    Attributes:
        max_evaluations: poses tried at the most.
        refined: so many of the best distinct poses are refined in the end.
        refinement: how.
    """

    max_evaluations: int = 30_000
    refined: int = 20
    refinement: LevenbergMarquardt = dataclasses.field(default_factory=LevenbergMarquardt)

    def minimize(
        self,
        objective: LeastSquaresObjective,
        space: PoseSpace,
        generator: np.random.Generator,
        should_stop: StopSignal = never,
    ) -> SearchResult:
        """The minima that the best of the annealed poses lead to, by rising cost."""
        candidates = CandidatePoses(objective, space.center, np.repeat(space.reach, 3))

        def cost(y: FloatArray) -> float:
            if len(candidates) and should_stop():
                raise _StoppedError
            return candidates.try_pose(y)

        with contextlib.suppress(_StoppedError):
            dual_annealing(
                cost,
                [(-1.0, 1.0)] * 6,
                maxiter=self.max_evaluations,  # More than enough: the evaluations end it.
                maxfun=self.max_evaluations,
                no_local_search=True,  # It would follow gradients by finite differences.
                x0=np.zeros(6),
                rng=generator,
            )
        found = refine_best(objective, candidates.by_cost(), self.refined, self.refinement, should_stop)
        return found._replace(iterations=found.iterations + len(candidates))
