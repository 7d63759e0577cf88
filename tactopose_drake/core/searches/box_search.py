"""What searches have in common that look at many poses of a box before they refine a few."""

import abc
import dataclasses

import numpy as np

from tactopose_drake.core.objectives.objective import LeastSquaresObjective
from tactopose_drake.core.searches.candidates import CandidatePoses, refine_best
from tactopose_drake.core.searches.levenberg_marquardt import LevenbergMarquardt
from tactopose_drake.core.searches.search import PoseSpace, Search, SearchResult, StopSignal, never


@dataclasses.dataclass(frozen=True, kw_only=True)
class BoxSearch(Search, abc.ABC):
    """Tries poses of the box that the space reaches; the best of them are refined.

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
        """The minima that the best of the tried poses lead to, by rising cost."""
        candidates = CandidatePoses(objective, space.center, np.repeat(space.reach, 3))
        self.try_poses(candidates, generator, should_stop)
        found = refine_best(objective, candidates.by_cost(), self.refined, self.refinement, should_stop)
        return found._replace(iterations=found.iterations + len(candidates))

    @abc.abstractmethod
    def try_poses(self, candidates: CandidatePoses, generator: np.random.Generator, should_stop: StopSignal) -> None:
        """Tries increments from -1 to 1 in each of six units, one at least, until it should stop."""
