"""A search where the best pose leaves so much unexplained that one of the contacts or pads may be false.

A false one draws all poses of a search toward itself, and none near the truth may be left. So others are proposed, each
of which need not suit the contact that it suits least, and refined without that one. All that is found is refined by
the mixture likelihood, which then says itself which one is false, if any.
"""

import dataclasses

import numpy as np

from tactopose_drake.core.evidence.evidence import Evidence
from tactopose_drake.core.kernels.mode_kernels import one_of_each
from tactopose_drake.core.objectives.objective import SmoothObjective
from tactopose_drake.core.objectives.surface_contact import ContactsButOne, SurfaceContact
from tactopose_drake.core.poses import compose
from tactopose_drake.core.searches.levenberg_marquardt import LevenbergMarquardt
from tactopose_drake.core.searches.pose_problem import PoseProblem
from tactopose_drake.core.searches.search import Search, SearchResult, StopSignal
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import FloatArray

# Of a search so many minima are refined, if they cost no more than this above the best.
_KEPT, _WORTH = 10, 15.0
# Poses within so many standard deviations of each other have come to the same one; more, while they still move.
_SAME_MINIMUM, _SAME_WAY = 1.0, 1.5
_NO_SYMMETRY = np.eye(3, 4)[None]
# So many of the best poses are refined from their half turns, too: what one contact tells of the ends may be false.
_TURNED = 3
# Without one of the contacts: some steps of all, then more of so many, of which so many go on.
_STEPS = LevenbergMarquardt(max_iterations=3, tolerance=3e-4, initial_damping=1e-2, least_refused=0.1)
_ROUNDS = (_STEPS, 30), (dataclasses.replace(_STEPS, max_iterations=15), 30)
_REFINEMENT = LevenbergMarquardt(max_iterations=8, tolerance=1e-3)


def search_with_doubt(
    model: ObjectModel,
    evidence: Evidence,
    problem: PoseProblem,
    search: Search,
    found: SearchResult,
    generator: np.random.Generator,
    should_stop: StopSignal,
) -> SearchResult:
    """The minima of the mixture likelihood that a search has led to, and those that it leads to without one contact.

    Args:
        model: the object.
        evidence: all that is known.
        problem: what it asks.
        search: that was made.
        found: what it has found.
        generator: of random numbers.
        should_stop: asked between rounds.
    """
    objective = problem.doubted(problem.objective)
    X_PO = _minima(found, problem)
    others = search.but_for_one(problem.space, generator) if len(evidence.touch) > 1 else None
    if others is not None:
        X_PO = np.concatenate([X_PO, _but_for_one(model, evidence, problem, objective, others, should_stop)])
    cost = objective.cost(X_PO)
    order = cost.argsort(kind="stable")
    X_PO, cost = X_PO[order], cost[order]
    starts = X_PO[cost < cost[0] + _WORTH]
    if evidence.prior is None:
        starts = np.concatenate([starts, compose(X_PO[:_TURNED, None], model.half_turns).reshape(-1, 3, 4)])
    return _REFINEMENT.refine(objective, starts, should_stop)


def _minima(found: SearchResult, problem: PoseProblem) -> FloatArray:
    """The best poses (n, 3, 4) that a search has found, one of those that led to the same minimum."""
    hessian = found.hessian
    if hessian is None:
        hessian = problem.objective.normal_equations(found.X_PO).hessian
    apart = one_of_each(found.X_PO, hessian + problem.space.information, _NO_SYMMETRY, _SAME_MINIMUM)
    return found.X_PO[apart[:_KEPT]]


def _but_for_one(
    model: ObjectModel,
    evidence: Evidence,
    problem: PoseProblem,
    doubted: SmoothObjective,
    X_PO: FloatArray,
    should_stop: StopSignal,
) -> FloatArray:
    """The poses (n, 3, 4) that those (m, 3, 4) lead to by all contacts and pads but one, best first as `doubted` says.

    There is at least one. All that is known besides has its say in which go on, and after that.
    """
    touch = ContactsButOne(SurfaceContact(model.grid, evidence.touch), problem.prior)
    for refinement, kept in _ROUNDS:
        found = refinement.refine(touch, X_PO, should_stop)
        found = found._replace(cost=doubted.cost(found.X_PO)).ranked()
        assert found.hessian is not None
        information = found.hessian + problem.space.information
        X_PO = found.X_PO[one_of_each(found.X_PO, information, _NO_SYMMETRY, _SAME_WAY)[:kept]]
    return X_PO
