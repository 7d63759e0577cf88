"""Runs any search with contacts that may be outliers."""

import numpy as np

from tactopose_drake.core.kernels.mode_kernels import NO_SYMMETRY, Minima, best_of_each
from tactopose_drake.core.searches.levenberg_marquardt import LevenbergMarquardt
from tactopose_drake.core.searches.pose_problem import PoseProblem
from tactopose_drake.core.searches.search import Search, SearchResult, StopSignal, never

# For searches without support for outliers: number of minima refined, and least standard deviations between them.
_KEPT, _SAME_MINIMUM = 10, 1.0
_REFINEMENT = LevenbergMarquardt(max_iterations=8, tolerance=1e-3)


def search_with_doubt(
    problem: PoseProblem, search: Search, generator: np.random.Generator, should_stop: StopSignal = never
) -> SearchResult:
    """Minimises the mixture likelihood of all the evidence, which decides by itself which contacts are outliers.

    Args:
        problem: the evidence, whose contacts or pads may be false.
        search: if it has no own support for outliers, its minima without any start the refinement.
        generator: of random numbers.
        should_stop: asked between rounds.
    """
    objective, space = problem.doubted(problem.objective), problem.space
    found = search.minimize_with_doubt(objective, space, generator, should_stop)
    if found is not None:
        return found
    found = search.minimize(problem.objective, space, generator, should_stop)
    hessian = problem.objective.normal_equations(found.X_PO).hessian
    minima = Minima(found.X_PO, found.cost, hessian)
    apart = best_of_each(minima, space.information, NO_SYMMETRY, _SAME_MINIMUM, _KEPT)
    return _REFINEMENT.refine(objective, found.X_PO[apart.chosen], should_stop)
