"""Many starts at once: sample the space, refine the promising poses, polish the best."""

import dataclasses

import numpy as np

from tactopose_drake.core.objectives.base import LeastSquaresObjective
from tactopose_drake.core.searches.base import PoseSpace, SearchResult, StopSignal, never
from tactopose_drake.core.searches.levenberg_marquardt import LevenbergMarquardt
from tactopose_drake.core.validation import FloatArray


@dataclasses.dataclass(frozen=True, kw_only=True)
class MultiStart:
    """Samples the space, and halves the field between rounds of refinement.

    Attributes:
        samples: poses drawn and scored.
        starts: of these, how many are refined.
        kept: how many of those are polished to convergence.
        coarse: the refinement of the starts, a few steps each.
        fine: the polish.
    """

    samples: int = 320
    starts: int = 56
    kept: int = 12
    coarse: LevenbergMarquardt = dataclasses.field(
        default_factory=lambda: LevenbergMarquardt(max_iterations=5, initial_damping=1e-2)
    )
    fine: LevenbergMarquardt = dataclasses.field(
        default_factory=lambda: LevenbergMarquardt(max_iterations=15, tolerance=1e-3)
    )

    def minimize(
        self,
        objective: LeastSquaresObjective,
        space: PoseSpace,
        generator: np.random.Generator,
        should_stop: StopSignal = never,
    ) -> SearchResult:
        """The distinct and the repeated minima that the starts lead to, by rising cost."""
        X_PO = np.concatenate([space.center[None], space.sample(generator, self.samples - 1)])
        return self.refine(objective, X_PO, should_stop)

    def refine(
        self, objective: LeastSquaresObjective, X_candidates: FloatArray, should_stop: StopSignal = never
    ) -> SearchResult:
        """Scores the candidates (B, 3, 4) and refines the best of them."""
        cost = objective.cost(X_candidates)
        if len(cost) > self.starts:
            X_candidates = X_candidates[np.argpartition(cost, self.starts)[: self.starts]]
        coarse = self.coarse.refine(objective, X_candidates, should_stop)
        fine = self.fine.refine(objective, coarse.ranked(self.kept).X_PO, should_stop)
        return fine._replace(iterations=fine.iterations + coarse.iterations.max())
