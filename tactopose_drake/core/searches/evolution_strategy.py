"""An evolution strategy: each generation is drawn about the best poses of the last. It needs costs but no derivatives.

Source: [H16] N. Hansen, The CMA evolution strategy: a tutorial, 2016: the weighted mean of the parents (eq. 6) and the
covariance of their steps (eq. 30, the rank-mu update).
"""

import dataclasses
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from tactopose_drake.core.objectives.objective import Objective
from tactopose_drake.core.poses import increments_between, retract
from tactopose_drake.core.searches.search import PoseSpace, Search, SearchResult, StopSignal, never
from tactopose_drake.core.validation import FloatArray

Proposals = Callable[[PoseSpace, np.random.Generator], FloatArray]


class _Best(NamedTuple):
    """Best poses (b, 3, 4) of b populations so far, and their costs (b,)."""

    X_PO: FloatArray
    cost: FloatArray


@dataclasses.dataclass(frozen=True, kw_only=True)
class EvolutionStrategy(Search):
    """Populations that start at the best of many poses; after some rounds only the better ones go on.

    For objectives with jumps or kinks, where steps along the derivative lead nowhere.

    Attributes:
        proposals: gives start poses (n, 3, 4) for a space; None for none.
        samples: number of random start poses of the space.
        populations: how many start.
        kept: how many of them are left after the first rounds.
        first: number of the first rounds.
        size: poses that a population draws in a round.
        parents: number of the best of these that make the next generation.
        rounds: most rounds.
        tolerance: a population has converged when its parents' costs differ by less than this share of the best.
        learning: weight of a round's covariance in the next one's.
        spread: initial standard deviation of a population, as a share of the space's.
    """

    proposals: Proposals | None = None
    samples: int = 150
    populations: int = 12
    kept: int = 4
    first: int = 6
    size: int = 60
    parents: int = 10
    rounds: int = 60
    tolerance: float = 2e-2
    learning: float = 0.5
    spread: float = 0.35

    def minimize(
        self,
        objective: Objective,
        space: PoseSpace,
        generator: np.random.Generator,
        should_stop: StopSignal = never,
    ) -> SearchResult:
        """Returns the best pose of each remaining population, in ascending order of cost."""
        mean, best = self._start(objective, space, generator)
        scale = self.spread / np.sqrt(np.diag(space.information))
        covariance = np.repeat(np.diag(scale**2)[None], len(mean), axis=0)
        weights = np.log(self.parents + 0.5) - np.log(np.arange(1, self.parents + 1))  # [H16] eq. 49.
        weights /= weights.sum()
        converged, done = np.zeros(len(mean), dtype=np.bool_), 0
        while done < self.rounds and not converged.all() and not should_stop():
            drawn = self._draw(mean, covariance, space, generator)
            cost = objective.cost(drawn.reshape(-1, 3, 4)).reshape(drawn.shape[:2])
            order = np.argsort(cost, axis=1, kind="stable")[:, : self.parents]
            parents, cost = np.take_along_axis(drawn, order[..., None, None], 1), np.take_along_axis(cost, order, 1)
            better = cost[:, 0] < best.cost
            best = _Best(
                np.where(better[:, None, None], parents[:, 0], best.X_PO), np.where(better, cost[:, 0], best.cost)
            )
            converged = cost[:, -1] - cost[:, 0] <= self.tolerance * cost[:, 0]

            steps = increments_between(np.repeat(mean[:, None], self.parents, axis=1), parents)
            spread = np.einsum("i,bij,bik->bjk", weights, steps, steps)
            covariance = (1.0 - self.learning) * covariance + self.learning * spread
            mean = retract(mean, np.einsum("i,bij->bj", weights, steps))
            done += 1
            if done == self.first:
                left = np.argsort(best.cost, kind="stable")[: self.kept]
                mean, covariance, converged = mean[left], covariance[left], converged[left]
                best = _Best(best.X_PO[left], best.cost[left])
        return SearchResult(*best, np.full(len(mean), done), converged).ranked()

    def _start(
        self, objective: Objective, space: PoseSpace, generator: np.random.Generator
    ) -> tuple[FloatArray, _Best]:
        """The start of each population, and its best pose so far."""
        X_PO = np.concatenate([space.center[None], space.sample(generator, self.samples)])
        if self.proposals is not None:
            X_PO = np.concatenate([X_PO, self.proposals(space, generator)])
        cost = objective.cost(X_PO)
        order = np.argsort(cost, kind="stable")[: self.populations]
        return X_PO[order], _Best(X_PO[order], cost[order])

    def _draw(
        self, mean: FloatArray, covariance: FloatArray, space: PoseSpace, generator: np.random.Generator
    ) -> FloatArray:
        """The next generation (b, size, 3, 4) of populations with means (b, 3, 4), clipped to the space's reach."""
        root = np.linalg.cholesky(covariance + 1e-18 * np.eye(6))
        normal = generator.normal(size=(len(mean), self.size, 6))
        drawn = retract(np.repeat(mean[:, None], self.size, axis=1), normal @ np.swapaxes(root, 1, 2))
        turn, way = space.reach
        if turn < np.pi:
            limits = np.repeat([turn, way], 3)
            center = np.broadcast_to(space.center, drawn.shape)
            drawn = retract(center, np.clip(increments_between(center, drawn), -limits, limits))
        return drawn
