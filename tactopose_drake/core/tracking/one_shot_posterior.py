"""The seam to the one-shot estimate: what the touch of now says of the pose by itself, found in slices of its search.

A search is made in slices, each of which fits into the time of an update: it proposes minima of the touch, from a part
of the starts, other ones each time; it settles these and the modes that are known by all the evidence; it weighs what
explains the touch as the estimate does; and what it says is put to use. Over some searches all is searched.
"""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import numpy as np

from tactopose_drake.core.evidence.evidence import Evidence
from tactopose_drake.core.poses import compose
from tactopose_drake.core.posterior.belief_sampling import weigh_modes
from tactopose_drake.core.posterior.hypotheses import Modes, find_modes
from tactopose_drake.core.posterior.plausibility import explain_with_doubt
from tactopose_drake.core.posterior.posterior import make_posterior
from tactopose_drake.core.posterior.posterior_params import DEFAULT_PARAMS
from tactopose_drake.core.searches.levenberg_marquardt import LevenbergMarquardt
from tactopose_drake.core.searches.pair_search import PairSearch, Start, global_stages
from tactopose_drake.core.searches.patch_searches import patch_search
from tactopose_drake.core.searches.pose_problem import PoseProblem, make_problem
from tactopose_drake.core.searches.search import SearchResult
from tactopose_drake.core.shape.free_spin import nearest_images
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.tracking.motion_prediction import Motion
from tactopose_drake.core.tracking.tracker_params import RelocalisationParams
from tactopose_drake.core.validation import FloatArray

_REFINEMENT = LevenbergMarquardt(max_iterations=6, tolerance=1e-2)


class WeighedModes(NamedTuple):
    """What the one-shot posterior says.

    Attributes:
        modes: of the pose.
        inlier_probability: of each contact, that it is what it claims to be, shape (k,).
        noise_scale: by how much the noise seems larger than told.
    """

    modes: Modes
    inlier_probability: FloatArray
    noise_scale: float

    def moved(self, motion: Motion) -> WeighedModes:
        """The same after a motion of the object."""
        mixture = dataclasses.replace(self.modes.mixture, X_PO=compose(motion.pose, self.modes.mixture.X_PO))
        return self._replace(modes=dataclasses.replace(self.modes, mixture=mixture))


def propose_poses(
    model: ObjectModel, params: RelocalisationParams, near: Evidence, generator: np.random.Generator
) -> FloatArray:
    """Minima of the touch alone, without what bounds the pose, which is slow; best first, shape (n, 3, 4).

    Args:
        model: the object.
        params: how much work it is.
        near: the touch; where there is a prior, the search goes near it.
        generator: of random numbers.
    """
    starts = params.starts
    touch = dataclasses.replace(near, hand=None, untouched=None, balance=None, friction=None, patches=near.felt)
    problem = make_problem(model, touch)
    pairs = PairSearch(model=model, contacts=touch.contacts)
    if touch.felt:
        pairs = patch_search(model, touch.felt, touch.contacts)
    pairs = dataclasses.replace(
        pairs,
        start=Start(candidates=starts, samples=starts // 2),
        stages=global_stages(starts // 2, starts // 3, starts // 8, starts // 20),
    )
    found = pairs.minimize(problem.objective, problem.space, generator)
    return _distinct(model, params, problem, found).mixture.X_PO


def settle_poses(model: ObjectModel, params: RelocalisationParams, evidence: Evidence, X_PO: FloatArray) -> FloatArray:
    """Minima of all the evidence that poses (n, 3, 4) lead to, of those that explain the touch, shape (m, 3, 4).

    Of poses that look the same the nearest to the first is taken, where no prior tells them apart.
    """
    problem = make_problem(model, evidence)
    if evidence.prior is None:
        X_PO = nearest_images(X_PO, X_PO[0], model.symmetry_turns, model.symmetries)
    found = _REFINEMENT.refine(problem.objective, X_PO)
    X_PO = _distinct(model, params, problem, found).mixture.X_PO
    judgement = None if problem.mixture is None else problem.mixture.judge(X_PO)
    return X_PO[explain_with_doubt(model, evidence, judgement, X_PO)]


def weigh_poses(
    model: ObjectModel,
    params: RelocalisationParams,
    evidence: Evidence,
    X_PO: FloatArray,
    generator: np.random.Generator,
) -> WeighedModes:
    """The posterior's modes at minima (m, 3, 4) of the evidence, at least one."""
    problem = make_problem(model, evidence)
    each = np.zeros(len(X_PO), dtype=np.intp)
    minima = SearchResult(X_PO, problem.objective.cost(X_PO), each, each == 0)
    sampling = dataclasses.replace(DEFAULT_PARAMS.sampling, most_rounds=params.rounds, samples=params.samples)
    posterior = make_posterior(model, evidence, problem, dataclasses.replace(DEFAULT_PARAMS, sampling=sampling))
    modes = weigh_modes(_distinct(model, params, problem, minima), posterior, generator)
    if problem.mixture is None:
        return WeighedModes(modes, np.zeros(0), 1.0)
    judgement, weights = problem.mixture.judge(modes.mixture.X_PO), modes.mixture.weights
    return WeighedModes(modes, weights @ judgement.inlier_probability, float(weights @ judgement.noise_scale))


def _distinct(model: ObjectModel, params: RelocalisationParams, problem: PoseProblem, found: SearchResult) -> Modes:
    """Distinct modes by Laplace's approximation, of which not too many are kept."""
    return find_modes(
        found,
        problem.determining.normal_equations(found.X_PO).hessian,
        problem.space.information,
        model.symmetry_poses,
        model.size,
        params.found,
    )
