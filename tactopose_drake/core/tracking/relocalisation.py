"""Relocalisation: the one-shot posterior runs beside the filter, whose modes compete with its.

A search is made in slices, each of which fits into the time of an update: it proposes minima of the touch, from a part
of the starts, other ones each time; it settles these and the modes that are known by all the evidence; it covers what
explains the touch by densities, as the estimate does, and weighs samples of them; and what it says is put to use. Over
some searches all is searched.

A mode's weight is what the posterior gives it by the touch of now, and what it would have had by the touches of the
window. What the filter foretold has no part in that: so a mode that was led astray, and since then only foretells what
it is itself led by, loses against one that explains the touch better, whenever that is found. While the touch stays,
searches weigh the same evidence again, each by samples of its own: their mean, with a forgetting factor, counts. The
filter's pose of a mode that it has already stays, for it has learnt from many frames, unless the touch contradicts it.
"""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.evidence.evidence import Evidence
from tactopose_drake.core.kernels.matrix_kernels import inverses
from tactopose_drake.core.poses import compose, increments_between
from tactopose_drake.core.posterior.hypotheses import Modes, find_modes
from tactopose_drake.core.posterior.importance_sampling import Weighing, begin_weighing, weigh_on
from tactopose_drake.core.posterior.plausibility import explain_with_doubt, is_comfortable
from tactopose_drake.core.posterior.posterior import make_posterior
from tactopose_drake.core.searches.doubt import search_with_doubt
from tactopose_drake.core.searches.levenberg_marquardt import LevenbergMarquardt
from tactopose_drake.core.searches.pair_search import PairSearch, Start, global_stages
from tactopose_drake.core.searches.patch_searches import patch_search
from tactopose_drake.core.searches.pose_problem import PoseProblem, make_problem
from tactopose_drake.core.searches.search import SearchResult
from tactopose_drake.core.shape.free_spin import nearest_images
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.tracking.contact_errors import LEAST_INLIER
from tactopose_drake.core.tracking.contact_update import begin_modes
from tactopose_drake.core.tracking.keyframes import Touch, past_cost
from tactopose_drake.core.tracking.motion_prediction import Motion
from tactopose_drake.core.tracking.tracked_modes import TrackedModes
from tactopose_drake.core.tracking.tracker_params import PoseTrackerParams, RelocalisationParams
from tactopose_drake.core.tracking.weighed_modes import WeighedModes
from tactopose_drake.core.validation import FloatArray

_REFINEMENT = LevenbergMarquardt(max_iterations=20, tolerance=1e-2)


class TouchWeighing(NamedTuple):
    """The touch of one slice, and how far its modes are weighed."""

    evidence: Evidence
    weighing: Weighing


class SearchState(NamedTuple):
    """How far the search is.

    Attributes:
        X_PO: what the slices so far have found, as of the last of them, shape (n, 3, 4); None between two searches.
        is_settled: whether these are minima of all the evidence.
        minima: what the last search has found, as of that time, shape (m, 3, 4): modes led astray are found again.
        weighing: of the modes, which the next slice goes on with; None where that does something else.
        weighed: what the posterior says of them; None before that.
        depths: how deep the object is in the hand at the likely ones of them, as far as that has been asked, m.
        X_PP: the motion of the object in P since then, which acts from the left, shape (3, 4).
        searches: how many there were.
        agreeing: how many of them since something happened that makes what they said before worthless.
        time: when the last one began, s.
    """

    X_PO: FloatArray | None = None
    is_settled: bool = False
    minima: FloatArray = np.empty((0, 3, 4))
    weighing: TouchWeighing | None = None
    weighed: WeighedModes | None = None
    depths: tuple[float, ...] = ()
    X_PP: FloatArray = np.eye(3, 4)
    searches: int = 0
    agreeing: int = 0
    time: float = -np.inf

    def moved(self, motion: Motion) -> SearchState:
        """The same after a further motion of the object."""
        return self._replace(X_PP=motion.of_poses(self.X_PP))

    def as_of_now(self) -> SearchState:
        """The same with its poses as they are after the motion."""
        X_PO = None if self.X_PO is None else compose(self.X_PP, self.X_PO)
        weighed = None if self.weighed is None else self.weighed.moved(self.X_PP)
        return self._replace(X_PO=X_PO, minima=compose(self.X_PP, self.minima), weighed=weighed, X_PP=np.eye(3, 4))

    def ended(self) -> SearchState:
        """That before the next search."""
        return self._replace(X_PO=None, is_settled=False, weighed=None, depths=(), searches=self.searches + 1)


def search_on(
    model: ObjectModel,
    params: PoseTrackerParams,
    touch: Touch,
    modes: TrackedModes,
    search: SearchState,
    *,
    at_once: bool = False,
) -> tuple[SearchState, WeighedModes | None]:
    """The next slice, and what the posterior says where that is to be put to use.

    Where the filter has no mode, there is none to keep up meanwhile: all slices are one.

    Args:
        model: the object.
        params: what is assumed.
        touch: of now.
        modes: the filter's.
        search: how far it is.
        at_once: whether all slices are one in any case.
    """
    while True:
        search, weighed = _next_slice(model, params, touch, modes, search)
        if (len(modes) and not at_once) or search.X_PO is None:
            return search, weighed


def _next_slice(
    model: ObjectModel, params: PoseTrackerParams, touch: Touch, modes: TrackedModes, search: SearchState
) -> tuple[SearchState, WeighedModes | None]:
    """Likewise; no poses are left in what a search has come to when it ends."""
    if search.weighing is not None:  # It is as of the slice that began it.
        generator = np.random.default_rng([params.seed, search.searches, 1])
        return _weigh_on(model, params.relocalisation, search, search.weighing, generator), None
    search = search.as_of_now()
    if search.weighed is not None:
        return _clear_of_the_hand(model, params.relocalisation, touch, search, search.weighed)
    evidence, settings = touch.averaged(params), params.relocalisation
    generator = np.random.default_rng([params.seed, search.searches])
    if search.X_PO is None:
        near = dataclasses.replace(evidence, prior=None) if search.searches % 2 else evidence
        return search._replace(X_PO=_propose_poses(model, settings, near, generator)), None
    if search.is_settled:
        return search._replace(weighing=_begin_weighing(model, settings, evidence, search.X_PO, generator)), None
    X_PO = np.concatenate([modes.X_PO, search.minima, search.X_PO])
    X_PO = _settle_poses(model, settings, evidence, X_PO) if len(X_PO) else X_PO
    search = search._replace(X_PO=X_PO, is_settled=True, minima=X_PO[: params.mixture.max_modes])
    return (search if len(X_PO) else search.ended()), None


def _clear_of_the_hand(
    model: ObjectModel, params: RelocalisationParams, touch: Touch, search: SearchState, weighed: WeighedModes
) -> tuple[SearchState, WeighedModes | None]:
    """A slice in which it is asked how deep one of several likely modes is in the hand; the last one is the end."""
    depths, likely = search.depths, weighed.likely(params)
    if touch.depth_in_hand is None:
        return search.ended(), weighed
    if len(likely):
        X_next = weighed.modes.mixture.X_PO[likely[len(depths), None]]
        depths = (*depths, *touch.depth_in_hand(X_next).tolist())
    if len(depths) < len(likely):
        return search._replace(depths=depths), None
    return search.ended(), weighed.clear(model, touch.evidence.hand, params, np.array(depths))


def _propose_poses(
    model: ObjectModel, params: RelocalisationParams, near: Evidence, generator: np.random.Generator
) -> FloatArray:
    """Minima of the touch alone, near its prior if there is one, best first, shape (n, 3, 4).

    What bounds the pose is left out: it is slow.
    """
    starts = params.starts
    touch = dataclasses.replace(near, hand=None, untouched=None, balance=None, friction=None, patches=near.felt)
    problem = make_problem(model, touch)
    pairs = PairSearch(model=model, contacts=touch.contacts)
    if touch.felt:
        pairs = patch_search(model, touch.felt, touch.contacts)
    stages = global_stages(-(-starts // 2), -(-starts // 8))
    start = Start(candidates=starts, samples=starts // 2)
    pairs = dataclasses.replace(pairs, start=start, start_but_for_one=start, stages=stages)
    found = search_with_doubt(problem, pairs, generator)
    return _distinct(model, params, problem, found).mixture.X_PO


def _settle_poses(model: ObjectModel, params: RelocalisationParams, evidence: Evidence, X_PO: FloatArray) -> FloatArray:
    """Minima of all the evidence that poses (n, 3, 4) lead to, of those that explain the touch, shape (m, 3, 4).

    Of poses that look the same the nearest to the first is taken, where no prior tells them apart.
    """
    problem = make_problem(model, evidence)
    if evidence.prior is None:
        X_PO = nearest_images(X_PO, X_PO[0], model.symmetry_turns, model.symmetries)
    found = _REFINEMENT.refine(problem.objective, X_PO)
    if not is_comfortable(model, evidence, problem, found.X_PO):
        found = _REFINEMENT.refine(problem.doubted(problem.objective), np.concatenate([X_PO, found.X_PO]))
    X_PO = _distinct(model, params, problem, found).mixture.X_PO
    judgement = None if problem.mixture is None else problem.mixture.judge(X_PO)
    return X_PO[explain_with_doubt(model, evidence, judgement, X_PO, params.posterior.plausibility)]


def _begin_weighing(
    model: ObjectModel,
    params: RelocalisationParams,
    evidence: Evidence,
    X_PO: FloatArray,
    generator: np.random.Generator,
) -> TouchWeighing:
    """Begins to weigh the posterior's modes at minima (m, 3, 4) of the evidence, at least one."""
    problem = make_problem(model, evidence)
    each = np.zeros(len(X_PO), dtype=np.intp)
    minima = SearchResult(X_PO, problem.doubted(problem.objective).cost(X_PO), each, each == 0)
    modes = _distinct(model, params, problem, minima)
    posterior = make_posterior(model, evidence, problem, params.posterior)
    return TouchWeighing(evidence, begin_weighing(modes, posterior, generator))


def _weigh_on(
    model: ObjectModel,
    params: RelocalisationParams,
    search: SearchState,
    touch: TouchWeighing,
    generator: np.random.Generator,
) -> SearchState:
    """The next step of weighing; after the last what the posterior says of the modes.

    That is by Laplace's approximation where nothing covers them.
    """
    evidence, weighing = touch
    problem = make_problem(model, evidence)
    if weighing.cover is not None:
        posterior = make_posterior(model, evidence, problem, params.posterior)
        weighing = weigh_on(weighing, posterior, generator)
    if weighing.cover is not None:
        return search._replace(weighing=touch._replace(weighing=weighing))
    modes = weighing.modes
    if problem.mixture is None:
        return search._replace(weighing=None, weighed=WeighedModes(modes, np.zeros(0), 1.0))
    judgement, weights = problem.mixture.judge(modes.mixture.X_PO), modes.mixture.weights
    log_inlier = weights @ np.log(np.maximum(judgement.inlier_probability, LEAST_INLIER))
    weighed = WeighedModes(modes, np.exp(log_inlier), float(weights @ judgement.noise_scale))
    return search._replace(weighing=None, weighed=weighed)


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


def relocalise(
    model: ObjectModel, params: PoseTrackerParams, touch: Touch, modes: TrackedModes, posterior: Modes, share: float
) -> TrackedModes:
    """The modes of the posterior by the window: first those that the filter has already, then new ones.

    Args:
        model: the object.
        params: what is assumed.
        touch: of now.
        modes: the filter's, after the touch.
        posterior: by the touch of now.
        share: of the mean of a mode's weights, that is by it.
    """
    X_PO, covariance, weights = posterior.mixture.X_PO, posterior.mixture.covariance, posterior.mixture.weights
    now = np.log(np.maximum(weights, 1e-300)) - past_cost(model, params, touch.window, X_PO)
    now -= np.logaddexp.reduce(now)
    kept = np.argsort(-now, kind="stable")[: params.mixture.max_modes]
    kept = kept[now[kept] > now[kept[:1]] + math.log(params.mixture.least_share)]
    X_PO, covariance, now = X_PO[kept], covariance[kept], now[kept]
    same, within = _same_modes(model, params, X_PO, covariance, modes)
    problem = make_problem(model, touch.averaged(params))
    objective = problem.doubted(problem.objective)
    cost, least = objective.cost(np.ascontiguousarray(modes.X_PO)), objective.cost(X_PO)
    pairs = _match(cost, same, within & (cost < least[:, None] + params.relocalisation.least_gain))
    is_right = pairs >= 0
    new = begin_modes(model, params, touch.reading, touch.standing, X_PO[~is_right], covariance[~is_right])
    if len(modes):
        before = modes.log_weight - np.logaddexp.reduce(modes.log_weight)
        now = _mean_weights(before, now, same, share)
    joined = modes.chosen(pairs[is_right]).joined(new)
    return dataclasses.replace(joined, log_weight=now[np.argsort(~is_right, kind="stable")])


def _mean_weights(before: FloatArray, now: FloatArray, same: NDArray[np.bool_], share: float) -> FloatArray:
    """Means of the logarithms of the posterior's weights (k,) now and those before, shape (k,).

    A valley has many minima, of which each search finds others. Therefore means are of the modes that are one, and what
    such a family holds is shared out as it is now: a mode's mass is not lost on a minimum that held next to none. What
    is plain is learnt at once by means of logarithms. What the filter has not is as probable as it is now.

    Args:
        before: logarithms of the weights of the filter's modes, shape (n,).
        now: of those of the posterior's modes, shape (k,).
        same: which of these are one, shape (k, n).
        share: of the mean, that is by those of now.
    """
    family = np.eye(len(now), dtype=np.bool_) | (same @ same.T)
    for _ in range(len(now).bit_length()):
        family = family @ family
    held = np.logaddexp.reduce(np.where(family @ same, before, -np.inf), axis=1)
    holds = np.logaddexp.reduce(np.where(family, now, -np.inf), axis=1)
    return now + (1.0 - share) * np.where(np.isneginf(held), 0.0, held - holds)


def _same_modes(
    model: ObjectModel, params: PoseTrackerParams, X_PO: FloatArray, covariance: FloatArray, modes: TrackedModes
) -> NDArray[np.bool_]:
    """Which of the posterior's k modes are which of the filter's n, by its own spread and by theirs, (2, k, n)."""
    images = compose(modes.X_PO[:, None], model.symmetry_poses[None])
    u = increments_between(X_PO[:, None, None], images[None])
    spreads = inverses(covariance)[0][:, None], inverses(modes.covariance)[0][None]
    distances = [np.einsum("jmsi,jmik,jmsk->jms", u, information, u).min(axis=2) for information in spreads]
    return np.asarray(np.stack(distances) < params.mixture.same_sigmas**2)


def _match(cost: FloatArray, same: NDArray[np.bool_], stays: NDArray[np.bool_]) -> NDArray[np.intp]:
    """For each of the posterior's k modes the filter's that it is, and whose pose stays, or -1, shape (k,).

    Args:
        cost: of the filter's modes, shape (n,).
        same: which of these each is, shape (k, n).
        stays: which of these explain the touch as well, and leave it by no more than their own spread: a mode that is
            surer than the touch may stand at a valley's end; shape (k, n).
    """
    pairs, free = np.full(len(same), -1), np.ones(len(cost), dtype=np.bool_)
    for j in range(len(same)):
        alike = np.flatnonzero(free & same[j])
        if len(alike):
            i = int(alike[np.argmin(cost[alike])])
            free[i], pairs[j] = False, i if stays[j, i] else -1
    return pairs
