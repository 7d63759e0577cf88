"""What a search is: it minimises any objective over a space of poses and returns ranked poses."""

from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np

from tactopose_drake.core.evidence.gaussian_prior import GaussianPrior
from tactopose_drake.core.kernels import pose_kernels
from tactopose_drake.core.objectives.objective import DoubtedObjective, LeastSquaresObjective
from tactopose_drake.core.validation import FloatArray

StopSignal = Callable[[], bool]
"""Asked between the rounds of a search; once it is true, the search returns the best that it has."""


def never() -> bool:
    """The stop signal of a search that may take its time."""
    return False


# The root of the 99.9 % point of chi-square with three degrees of freedom.
_REACH = 4.03


class SearchResult(NamedTuple):
    """Poses by rising cost.

    Attributes:
        X_PO: poses, shape (B, 3, 4).
        cost: their costs, shape (B,).
        iterations: steps that were tried for each, shape (B,).
        converged: whether each ended at a minimum, rather than at the limit of iterations, shape (B,).
        hessian: Gauss-Newton Hessians of the objective there, shape (B, 6, 6); None where the search has none.
    """

    X_PO: FloatArray
    cost: FloatArray
    iterations: np.ndarray[tuple[int], np.dtype[np.int64]]
    converged: np.ndarray[tuple[int], np.dtype[np.bool_]]
    hessian: FloatArray | None = None

    def ranked(self) -> "SearchResult":
        """The poses by rising cost."""
        order = self.cost.argsort(kind="stable")
        return SearchResult(*(None if column is None else column.take(order, axis=0) for column in self))  # type: ignore[arg-type]


def join_results(*results: SearchResult) -> SearchResult:
    """The poses of several results, one after the other."""
    if len(results) == 1:
        return results[0]
    columns = zip(*results, strict=True)
    return SearchResult(*(None if column[-1] is None else np.concatenate(column) for column in columns))  # type: ignore[arg-type]


class PoseSpace(Protocol):
    """Where a search looks."""

    @property
    def center(self) -> FloatArray:
        """The pose that a local search starts from, shape (3, 4)."""
        ...

    @property
    def information(self) -> FloatArray:
        """The inverse covariance of the space's poses as increments from the centre, shape (6, 6)."""
        ...

    @property
    def reach(self) -> tuple[float, float]:
        """How far from the centre poses are worth a look: rotation, rad, and translation, m."""
        ...

    def sample(self, generator: np.random.Generator, count: int) -> FloatArray:
        """Random poses of the space, shape (count, 3, 4)."""
        ...


def is_near(space: PoseSpace) -> bool:
    """Whether a prior bounds the space: without one all rotations are worth a look."""
    return space.reach[0] < np.pi


class PriorSpace:
    """The poses around a prior, normally distributed as it says.

    Attributes:
        center: the prior's pose, shape (3, 4).
        information: its inverse covariance, shape (6, 6).
        reach: the radii that hold all but a thousandth of it: rotation, rad, and translation, m.
    """

    def __init__(self, prior: GaussianPrior) -> None:
        self._sigmas = prior.sigmas
        self.center = prior.mean
        self.information = np.diag(1.0 / self._sigmas**2)
        self.reach = _REACH * prior.sigma_rotation, _REACH * prior.sigma_translation

    def sample(self, generator: np.random.Generator, count: int) -> FloatArray:
        """Random poses, shape (count, 3, 4)."""
        X_PO = np.empty((count, 3, 4))
        increments = generator.normal(size=(count, 6)) * self._sigmas
        pose_kernels.retract(np.repeat(self.center[None], count, axis=0), increments, X_PO)
        return X_PO


class Search(Protocol):
    """Minimises an objective; knows nothing of what it measures."""

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
        """The same where contacts may be false; None where the search knows nothing of that."""
        return None

    def widened(self) -> "Search | None":
        """The same near a prior, looking at more; None where there is no such."""
        return None
