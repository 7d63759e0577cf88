"""A search where contacts may be false, by whatever search."""

import numpy as np

from tactopose_drake.core.kernels.mode_kernels import one_of_each
from tactopose_drake.core.searches.levenberg_marquardt import LevenbergMarquardt
from tactopose_drake.core.searches.pose_problem import PoseProblem
from tactopose_drake.core.searches.search import Search, SearchResult, StopSignal, never

# Of a search that knows nothing of doubt so many minima are refined, none within so many standard deviations of others.
_KEPT, _SAME_MINIMUM = 10, 1.0
_NO_SYMMETRY = np.eye(3, 4)[None]
_REFINEMENT = LevenbergMarquardt(max_iterations=8, tolerance=1e-3)


def search_with_doubt(
    problem: PoseProblem, search: Search, generator: np.random.Generator, should_stop: StopSignal = never
) -> SearchResult:
    """The minima of all the evidence by the mixture likelihood, which says itself which contacts are false, if any.

    Args:
        problem: what is known, of which contacts or pads may be false.
        search: one that proposes poses for that itself, or one by which all is as told: from its minima doubt leads on.
        generator: of random numbers.
        should_stop: asked between rounds.
    """
    objective, space = problem.doubted(problem.objective), problem.space
    found = search.minimize_with_doubt(objective, space, generator, should_stop)
    if found is not None:
        return found
    found = search.minimize(problem.objective, space, generator, should_stop)
    information = problem.objective.normal_equations(found.X_PO).hessian + space.information
    apart = one_of_each(found.X_PO, information, _NO_SYMMETRY, _SAME_MINIMUM, _KEPT)
    return _REFINEMENT.refine(objective, found.X_PO[apart], should_stop)
