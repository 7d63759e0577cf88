"""The seam to the one-shot estimate: what the touch of now says of the pose by itself, in a slice of its search.

A slice begins with a part of the starts, other ones each time, and with the modes that are known, so that it fits into
the time of an update; over some slices all is searched. What is found is weighed as the estimate weighs it.
"""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import numpy as np

from tactopose_drake.core.evidence.evidence import Evidence
from tactopose_drake.core.posterior.belief_sampling import weigh_modes
from tactopose_drake.core.posterior.hypotheses import Modes, find_modes
from tactopose_drake.core.posterior.plausibility import explain_touch
from tactopose_drake.core.posterior.posterior import make_posterior
from tactopose_drake.core.posterior.posterior_params import DEFAULT_PARAMS
from tactopose_drake.core.searches.levenberg_marquardt import LevenbergMarquardt
from tactopose_drake.core.searches.pair_search import PairSearch, Start, global_stages
from tactopose_drake.core.searches.patch_searches import patch_search
from tactopose_drake.core.searches.pose_problem import make_problem
from tactopose_drake.core.searches.search import SearchResult
from tactopose_drake.core.shape.free_spin import nearest_images
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.tracking.tracker_params import PoseTrackerParams
from tactopose_drake.core.validation import FloatArray

_REFINEMENT = LevenbergMarquardt(max_iterations=6, tolerance=1e-2)


class SearchSlice(NamedTuple):
    """A part of the search.

    Attributes:
        near: where to search; None for anywhere.
        known: poses with which it begins too, shape (n, 3, 4); of those that look the same the nearest to the first.
        generator: of its random numbers.
    """

    near: Evidence
    known: FloatArray
    generator: np.random.Generator


def one_shot_posterior(
    model: ObjectModel, params: PoseTrackerParams, evidence: Evidence, search: SearchSlice
) -> Modes | None:
    """The modes of the pose by the evidence of one time, of those that explain the touch; None where there is none.

    Args:
        model: the object.
        params: how much work a slice is.
        evidence: of now; a prior in it counts.
        search: where to look, and how.
    """
    settings = params.relocalisation
    problem = make_problem(model, evidence)
    X_start = np.concatenate([search.known, _minima_of_touch(model, params, search)])
    if evidence.prior is None and len(X_start):
        X_start = nearest_images(X_start, X_start[0], model.symmetry_turns, model.symmetries)
    found = _REFINEMENT.refine(problem.objective, X_start)
    explains = explain_touch(model, evidence, found.X_PO, params.plausibility)
    if not explains.any():
        return None
    found = SearchResult(
        found.X_PO[explains], found.cost[explains], found.iterations[explains], found.converged[explains]
    )
    modes = find_modes(
        found,
        problem.determining.normal_equations(found.X_PO).hessian,
        problem.space.information,
        model.symmetry_poses,
        model.size,
        settings.found,
    )
    sampling = dataclasses.replace(DEFAULT_PARAMS.sampling, most_rounds=settings.rounds)
    posterior = make_posterior(model, evidence, problem, dataclasses.replace(DEFAULT_PARAMS, sampling=sampling))
    return weigh_modes(modes, posterior, search.generator)


def _minima_of_touch(model: ObjectModel, params: PoseTrackerParams, search: SearchSlice) -> FloatArray:
    """Minima of the touch alone, without what bounds the pose, which is slow; best first, shape (n, 3, 4)."""
    starts = params.relocalisation.starts
    touch = dataclasses.replace(
        search.near, hand=None, untouched=None, balance=None, friction=None, patches=search.near.felt
    )
    problem = make_problem(model, touch)
    pairs = PairSearch(model=model, contacts=touch.contacts)
    if touch.felt:
        pairs = patch_search(model, touch.felt, touch.contacts)
    pairs = dataclasses.replace(
        pairs,
        start=Start(candidates=starts, samples=starts // 2),
        stages=global_stages(starts // 2, starts // 3, starts // 8, starts // 20),
    )
    found = pairs.minimize(problem.objective, problem.space, search.generator)
    modes = find_modes(
        found,
        problem.determining.normal_equations(found.X_PO).hessian,
        problem.space.information,
        model.symmetry_poses,
        model.size,
        params.relocalisation.found,
    )
    return modes.mixture.X_PO
