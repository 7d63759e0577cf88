"""The interface of objectives, and their sums."""

import functools
from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.kernels import least_squares_kernels
from tactopose_drake.core.kernels.least_squares_kernels import DescentRule
from tactopose_drake.core.validation import FloatArray


class NormalEquations(NamedTuple):
    """A least-squares cost and its local model, for a batch of B poses.

    Attributes:
        cost: half the sum of squared residuals, shape (B,).
        gradient: derivative of the cost by the increment, shape (B, 6).
        hessian: Gauss-Newton approximation of the second derivative, shape (B, 6, 6).
    """

    cost: FloatArray
    gradient: FloatArray
    hessian: FloatArray


class Objective(Protocol):
    """Scores a batch of poses, lower is better, independently of the search that uses it."""

    def cost(self, X_PO: FloatArray) -> FloatArray:
        """Costs (B,) of poses (B, 3, 4)."""
        ...


class Descent(NamedTuple):
    """The result of a descent.

    Poses (B, 3, 4), costs (B,), numbers of steps tried (B,), whether each converged (B,), and Gauss-Newton Hessians
    there (B, 6, 6).
    """

    X_PO: FloatArray
    cost: FloatArray
    iterations: NDArray[np.int64]
    converged: NDArray[np.bool_]
    hessian: FloatArray


class SmoothObjective(Objective, Protocol):
    """An objective with derivatives with respect to the six increments.

    Operations that some objectives do faster than a search could have a default here; derive from this class to get
    them.

    Attributes:
        is_touch: whether it is the smooth likelihood of contacts, and of nothing else.
    """

    is_touch: bool = False

    def normal_equations(self, X_PO: FloatArray) -> NormalEquations:
        """Cost, gradient and Gauss-Newton Hessian at poses (B, 3, 4)."""
        ...

    def exact_cost(self, X_PO: FloatArray) -> FloatArray:
        """Costs (B,) of poses (B, 3, 4) without the approximations that make the cost smooth; by default the cost."""
        return self.cost(X_PO)

    @property
    def descent(self) -> Callable[[DescentRule, FloatArray], Descent] | None:
        """Levenberg-Marquardt from each of the poses (B, 3, 4) in one compiled loop; None if there is none."""
        return None


class LeastSquaresObjective(SmoothObjective, Protocol):
    """An objective that is half a sum of squares.

    Residuals and their Jacobian define it; subclasses override what they can compute faster.

    Attributes:
        but_for_one: see `DoubtedObjective`; None, as no contact is doubted.
    """

    but_for_one: SmoothObjective | None = None

    def residuals(self, X_PO: FloatArray) -> FloatArray:
        """Residuals (B, m) of poses (B, 3, 4)."""
        ...

    def residuals_and_jacobian(self, X_PO: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Residuals (B, m) and their derivatives by the increment (B, m, 6)."""
        ...

    def cost(self, X_PO: FloatArray) -> FloatArray:
        """Costs (B,) of poses (B, 3, 4)."""
        cost: FloatArray = 0.5 * np.sum(self.residuals(X_PO) ** 2, axis=-1)
        return cost

    def normal_equations(self, X_PO: FloatArray) -> NormalEquations:
        """Cost, gradient and Gauss-Newton Hessian at poses (B, 3, 4)."""
        return form_normal_equations(*self.residuals_and_jacobian(X_PO))

    @property
    def terms(self) -> tuple["LeastSquaresObjective", ...]:
        """The objectives that this is the sum of."""
        return (self,)

    @property
    def quick(self) -> "LeastSquaresObjective":
        """A cheaper objective with minima nearby; itself, if there is none."""
        return self

    @property
    def believed(self) -> "LeastSquaresObjective":
        """The objective without outliers: itself."""
        return self


def form_normal_equations(residuals: FloatArray, jacobian: FloatArray) -> NormalEquations:
    """Normal equations from residuals (B, m) and any Jacobian (B, m, n)."""
    count, _, n = jacobian.shape
    equations = NormalEquations(np.empty(count), np.empty((count, n)), np.empty((count, n, n)))
    least_squares_kernels.form_normal_equations(residuals, np.ascontiguousarray(jacobian), *equations)
    return equations


class SmoothSum(SmoothObjective):
    """The sum of smooth objectives: costs and derivatives add up."""

    def __init__(self, terms: Sequence[SmoothObjective]) -> None:
        self._summands = tuple(terms)

    def cost(self, X_PO: FloatArray) -> FloatArray:
        """Costs (B,) of poses (B, 3, 4)."""
        total = self._summands[0].cost(X_PO)
        for term in self._summands[1:]:
            total = total + term.cost(X_PO)
        return total

    def normal_equations(self, X_PO: FloatArray) -> NormalEquations:
        """Cost, gradient and Gauss-Newton Hessian at poses (B, 3, 4)."""
        cost, gradient, hessian = self._summands[0].normal_equations(X_PO)
        for term in self._summands[1:]:
            more = term.normal_equations(X_PO)
            cost, gradient, hessian = cost + more.cost, gradient + more.gradient, hessian + more.hessian
        return NormalEquations(cost, gradient, hessian)

    def exact_cost(self, X_PO: FloatArray) -> FloatArray:
        """The sum of the exact costs (B,) of poses (B, 3, 4)."""
        return functools.reduce(np.add, [term.exact_cost(X_PO) for term in self._summands])

    @property
    def descent(self) -> Callable[[DescentRule, FloatArray], Descent] | None:
        """The descent of the only summand, if there is only one and it has one."""
        return self._summands[0].descent if len(self._summands) == 1 else None


class DoubtedObjective(SmoothSum):
    """A sum of objectives, some of which are of contacts and pads that may be outliers.

    Attributes:
        believed: the same without outliers.
        but_for_one: the contacts, and pads as contacts, without the one that each pose explains worst, and the prior;
            None if there are too few.
    """

    def __init__(
        self,
        terms: Sequence[SmoothObjective],
        believed: LeastSquaresObjective,
        but_for_one: SmoothObjective | None = None,
    ) -> None:
        super().__init__(terms)
        self.believed, self.but_for_one = believed, but_for_one


class SumObjective(SmoothSum, LeastSquaresObjective):
    """The sum of least-squares objectives: residuals are concatenated, too."""

    def __init__(self, terms: Sequence[LeastSquaresObjective], quick: LeastSquaresObjective | None = None) -> None:
        super().__init__(terms)
        self._terms, self._quick = tuple(terms), quick

    @property
    def terms(self) -> tuple[LeastSquaresObjective, ...]:
        """The objectives that this is the sum of."""
        return self._terms

    @property
    def quick(self) -> LeastSquaresObjective:
        """The cheaper objective given on construction, or itself."""
        return self if self._quick is None else self._quick

    def residuals(self, X_PO: FloatArray) -> FloatArray:
        """Residuals (B, m) of poses (B, 3, 4)."""
        return np.concatenate([term.residuals(X_PO) for term in self.terms], axis=-1)

    def residuals_and_jacobian(self, X_PO: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Residuals (B, m) and their derivatives by the increment (B, m, 6)."""
        parts = [term.residuals_and_jacobian(X_PO) for term in self.terms]
        return np.concatenate([r for r, _ in parts], axis=-1), np.concatenate([J for _, J in parts], axis=-2)
