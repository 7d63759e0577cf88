"""The interface of searches: a search minimises an objective over a space of poses and returns ranked poses."""

from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np

from tactopose_drake.core.evidence.gaussian_prior import GaussianPrior
from tactopose_drake.core.kernels import pose_kernels
from tactopose_drake.core.objectives.objective import DoubtedObjective, LeastSquaresObjective
from tactopose_drake.core.validation import FloatArray

StopSignal = Callable[[], bool]
"""Evaluated between the rounds of a search; once it is true, the search returns the best result so far."""


def never() -> bool:
    """A stop signal that never stops the search."""
    return False


# Square root of the 99.9 % quantile of chi-square with three degrees of freedom.
_REACH = 4.03


class SearchResult(NamedTuple):
    """Poses in ascending order of cost.

    Attributes:
        X_PO: poses, shape (B, 3, 4).
        cost: their costs, shape (B,).
        iterations: number of steps tried for each, shape (B,).
        converged: whether each ended at a minimum, rather than at the limit of iterations, shape (B,).
        hessian: Gauss-Newton Hessians of the objective there, shape (B, 6, 6); None if the search has none.
    """

    X_PO: FloatArray
    cost: FloatArray
    iterations: np.ndarray[tuple[int], np.dtype[np.int64]]
    converged: np.ndarray[tuple[int], np.dtype[np.bool_]]
    hessian: FloatArray | None = None

    def ranked(self) -> "SearchResult":
        """The result in ascending order of cost."""
        order = self.cost.argsort(kind="stable")
        return SearchResult(*(None if column is None else column.take(order, axis=0) for column in self))  # type: ignore[arg-type]


def join_results(*results: SearchResult) -> SearchResult:
    """Concatenates several results."""
    if len(results) == 1:
        return results[0]
    columns = zip(*results, strict=True)
    return SearchResult(*(None if column[-1] is None else np.concatenate(column) for column in columns))  # type: ignore[arg-type]


class PoseSpace(Protocol):
    """The set of poses that a search considers."""

    @property
    def center(self) -> FloatArray:
        """The pose that a local search starts from, shape (3, 4)."""
        ...

    @property
    def information(self) -> FloatArray:
        """Inverse covariance of the space's poses, as increments from the centre, shape (6, 6)."""
        ...

    @property
    def reach(self) -> tuple[float, float]:
        """Largest rotation, rad, and translation, m, from the centre that are worth considering."""
        ...

    def sample(self, generator: np.random.Generator, count: int) -> FloatArray:
        """Random poses of the space, shape (count, 3, 4)."""
        ...


def is_near_prior(space: PoseSpace) -> bool:
    """Whether a prior bounds the space: without one, or with a very wide one, all rotations are possible."""
    return space.reach[0] < np.pi


class PriorSpace:
    """The normal distribution of poses around a prior.

    Attributes:
        center: the prior's pose, shape (3, 4).
        information: its inverse covariance, with standard deviations of rotations up to pi, shape (6, 6).
        reach: radii that contain 99.9 % of it each: rotation, rad, and translation, m.
    """

    def __init__(self, prior: GaussianPrior) -> None:
        self._sigmas = prior.sigmas
        self._sigmas[:3] = min(prior.sigma_rotation, np.pi)  # No rotation is larger.
        self.center = prior.mean
        self.information = np.diag(1.0 / self._sigmas**2)
        self.reach = _REACH * prior.sigma_rotation, _REACH * prior.sigma_translation

    def sample(self, generator: np.random.Generator, count: int) -> FloatArray:
        """Random poses, shape (count, 3, 4)."""
        X_PO = np.empty((count, 3, 4))
        increments = generator.normal(size=(count, 6)) * self._sigmas
        pose_kernels.retract(self.center[None], increments, X_PO)
        return X_PO


class Search(Protocol):
    """Minimises an objective, whatever it measures."""

    def minimize(
        self,
        objective: LeastSquaresObjective,
        space: PoseSpace,
        generator: np.random.Generator,
        should_stop: StopSignal = never,
    ) -> SearchResult:
        """Returns poses of the space that (locally) minimise the objective, by rising cost; at least one."""
        ...

    def minimize_with_doubt(
        self,
        objective: DoubtedObjective,
        space: PoseSpace,
        generator: np.random.Generator,
        should_stop: StopSignal = never,
    ) -> SearchResult | None:
        """The same with contacts that may be outliers; None if the search does not support that."""
        return None

    def widened(self) -> "Search | None":
        """The same search with more start poses near a prior; None if there is no such search."""
        return None
