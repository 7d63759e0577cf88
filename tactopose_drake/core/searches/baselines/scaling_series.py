"""Scaling series: neighbourhoods of the space are refined while the likelihood is annealed.

Source: [P11] A. Petrovskaya and O. Khatib, Global localization of objects via touch, IEEE Trans. Robotics, 2011.
"""

import dataclasses

import numpy as np

from tactopose_drake.core.kernels import pose_kernels
from tactopose_drake.core.objectives.objective import LeastSquaresObjective
from tactopose_drake.core.searches.baselines.region_kernels import mark_first
from tactopose_drake.core.searches.candidates import refine_best
from tactopose_drake.core.searches.levenberg_marquardt import LevenbergMarquardt
from tactopose_drake.core.searches.search import PoseSpace, Search, SearchResult, StopSignal, never
from tactopose_drake.core.validation import FloatArray

# Each round halves the volume of a neighbourhood in six dimensions.
_ZOOM = 2.0 ** (-1.0 / 6.0)


@dataclasses.dataclass(frozen=True, kw_only=True)
class ScalingSeries(Search):
    """Keeps a set of neighbourhoods that may contain the pose, samples them evenly, and prunes them.

    A neighbourhood is the set of poses within a rotation and a translation of its centre. Each round shrinks both
    radii, and the temperature with their square, so that the cost of a radius stays comparable to noise. The series
    ends at temperature one, and the best samples are refined.

    Unlike in [P11], the number of neighbourhoods is bounded, and their centres stay among the samples.

    Attributes:
        peak_width: translation radius of the neighbourhoods in the last round, m; about the noise of a contact.
        first: number of samples of the whole space.
        per_region: number of samples in each neighbourhood; those inside an earlier one are dropped.
        share: samples whose annealed likelihood is below this share of the largest are pruned.
        max_regions: most samples that are kept, the best ones.
        refined: number of the best distinct poses that are refined in the end.
        refinement: how these are refined.
    """

    peak_width: float = 0.001
    first: int = 5000
    per_region: int = 6
    share: float = 0.1
    max_regions: int = 500
    refined: int = 20
    refinement: LevenbergMarquardt = dataclasses.field(default_factory=LevenbergMarquardt)

    def minimize(
        self,
        objective: LeastSquaresObjective,
        space: PoseSpace,
        generator: np.random.Generator,
        should_stop: StopSignal = never,
    ) -> SearchResult:
        """Returns the minima that the best of the last samples lead to, in ascending order of cost."""
        radii = np.array(space.reach)
        X_PO = space.sample(generator, self.first)
        cost = objective.cost(X_PO)
        order = np.argsort(cost, kind="stable")
        X_PO, cost = X_PO[order], cost[order]
        tried = len(X_PO)
        rounds = max(0, int(6.0 * np.log2(radii[1] / self.peak_width)))
        for left in range(rounds, -1, -1):
            radii = radii * _ZOOM
            temperature = _ZOOM ** (-2.0 * left)
            kept = cost - cost[0] <= -np.log(self.share) * temperature
            kept[self.max_regions :] = False
            X_PO, cost = self._refine(objective, X_PO[kept], cost[kept], radii, generator)
            tried += len(X_PO)
            if should_stop():
                break
        found = refine_best(objective, X_PO, self.refined, self.refinement, should_stop)
        return found._replace(iterations=found.iterations + tried)

    def _refine(
        self,
        objective: LeastSquaresObjective,
        X_region: FloatArray,
        cost: FloatArray,
        radii: FloatArray,
        generator: np.random.Generator,
    ) -> tuple[FloatArray, FloatArray]:
        """The centres of neighbourhoods and even samples of them, in ascending order of cost."""
        count = len(X_region) * self.per_region
        increments = np.concatenate([_in_ball(generator, count) * radius for radius in radii], axis=1)
        samples = np.empty((count, 3, 4))
        pose_kernels.retract(np.repeat(X_region, self.per_region, axis=0), increments, samples)
        alone = np.empty(count, dtype=np.bool_)
        mark_first(X_region, samples, self.per_region, radii, alone)
        samples = samples[alone]
        both = np.concatenate([X_region, samples])
        costs = np.concatenate([cost, objective.cost(samples)])
        order = np.argsort(costs, kind="stable")
        return both[order], costs[order]


def _in_ball(generator: np.random.Generator, count: int) -> FloatArray:
    """Uniformly random points of the unit ball, shape (count, 3)."""
    direction = generator.normal(size=(count, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    return direction * np.cbrt(generator.random((count, 1)))
