"""A search where the best pose leaves so much unexplained that one of the contacts or pads may be false.

A false one draws all poses of a search toward itself, and none near the truth may be left. Without it, in turn
without each of those that the best pose explains least, the search finds what the others say. All that is found is
refined by the mixture likelihood, which then says itself which one is false, if any.
"""

from typing import cast

import numpy as np

from tactopose_drake.core.evidence.evidence import Evidence
from tactopose_drake.core.kernels.mode_kernels import one_of_each
from tactopose_drake.core.objectives.objective import LeastSquaresObjective
from tactopose_drake.core.poses import compose
from tactopose_drake.core.searches.levenberg_marquardt import LevenbergMarquardt
from tactopose_drake.core.searches.pose_problem import PoseProblem, make_problem
from tactopose_drake.core.searches.search import Search, SearchResult, StopSignal
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import FloatArray

# Of each search so many minima are refined, if they cost no more than this above the best.
_KEPT, _WORTH = 10, 15.0
# Poses within so many standard deviations of each other have come to the same one.
_SAME_MINIMUM = 1.0
_NO_SYMMETRY = np.eye(3, 4)[None]
# So many of the best poses are refined from their half turns, too: what one contact tells of the ends may be false.
_TURNED = 3
# Without one of so many contacts and pads in turn, at the most: those that the best pose explains least.
_SUSPECTS = 6
_REFINEMENT = LevenbergMarquardt(max_iterations=15, tolerance=1e-3)


def search_with_doubt(
    model: ObjectModel,
    evidence: Evidence,
    problem: PoseProblem,
    search: Search,
    found: SearchResult,
    generator: np.random.Generator,
    should_stop: StopSignal,
) -> SearchResult:
    """The minima of the mixture likelihood that a search has led to, and those that it leads to without one.

    Args:
        model: the object.
        evidence: all that is known.
        problem: what it asks.
        search: that was made.
        found: what it has found.
        generator: of random numbers.
        should_stop: asked between searches.
    """
    poses = [_minima(found, problem)]
    shares = problem.inlier_probability(found.X_PO[:1])[0]
    for index in np.argsort(shares, kind="stable")[:_SUSPECTS] if len(shares) > 1 else ():
        other = search.leaving_out(int(index))
        if other is None or should_stop():
            break
        part = make_problem(model, evidence.without(int(index)))
        poses.append(_minima(other.minimize(part.objective, part.space, generator, should_stop), part))
    objective = problem.doubted(problem.objective)
    X_PO = np.concatenate(poses)
    cost = objective.cost(X_PO)
    order = cost.argsort(kind="stable")
    X_PO, cost = X_PO[order], cost[order]
    starts = X_PO[cost < cost[0] + _WORTH]
    if evidence.prior is None:
        starts = np.concatenate([starts, compose(X_PO[:_TURNED, None], model.half_turns).reshape(-1, 3, 4)])
    # By increments it asks for normal equations alone, and so for no residuals.
    return _REFINEMENT.refine(cast(LeastSquaresObjective, objective), starts, should_stop)


def _minima(found: SearchResult, problem: PoseProblem) -> FloatArray:
    """The best poses (n, 3, 4) that a search has found, one of those that led to the same minimum."""
    hessian = found.hessian
    if hessian is None:
        hessian = problem.objective.normal_equations(found.X_PO).hessian
    apart = one_of_each(found.X_PO, hessian + problem.space.information, _NO_SYMMETRY, _SAME_MINIMUM)
    return found.X_PO[apart[:_KEPT]]
