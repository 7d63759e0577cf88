"""Base class of searches that evaluate many poses of a box before they refine a few."""

import abc
import dataclasses

import numpy as np

from tactopose_drake.core.objectives.objective import LeastSquaresObjective
from tactopose_drake.core.searches.candidates import CandidatePoses, refine_best
from tactopose_drake.core.searches.levenberg_marquardt import LevenbergMarquardt
from tactopose_drake.core.searches.search import PoseSpace, Search, SearchResult, StopSignal, never


@dataclasses.dataclass(frozen=True, kw_only=True)
class BoxSearch(Search, abc.ABC):
    """Evaluates poses of the box that the space reaches, and refines the best of them.

    Attributes:
        max_evaluations: most poses evaluated.
        refined: number of the best distinct poses that are refined in the end.
        refinement: how these are refined.
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
        """Returns the minima that the best poses evaluated lead to, in ascending order of cost."""
        candidates = CandidatePoses(objective, space.center, np.repeat(space.reach, 3))
        self.try_poses(candidates, generator, should_stop)
        found = refine_best(objective, candidates.by_cost(), self.refined, self.refinement, should_stop)
        return found._replace(iterations=found.iterations + len(candidates))

    @abc.abstractmethod
    def try_poses(self, candidates: CandidatePoses, generator: np.random.Generator, should_stop: StopSignal) -> None:
        """Evaluates increments in [-1, 1]^6, scaled to the box, at least one, until it should stop."""
