"""A search beside the filter: the one-shot posterior of the touch, in slices that each fit into the time of an update.

It proposes minima of the touch, from a part of the starts, other ones each time; it settles these and the modes that
are known by all the evidence; it asks of what they leave over how far the hand's calibration is off; it covers what
explains the touch by densities, as the estimate does, and weighs samples of them; it asks how deep the object would be
in the hand; and what it says is put to use, see `relocalisation.py`. Over some searches all is searched.
"""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import numpy as np

from tactopose_drake.core.evidence.evidence import Evidence
from tactopose_drake.core.motion.rigid_motion import Motion
from tactopose_drake.core.poses import compose
from tactopose_drake.core.posterior.hypotheses import Modes, find_modes
from tactopose_drake.core.posterior.importance_sampling import Weighing, begin_weighing, weigh_on
from tactopose_drake.core.posterior.plausibility import explain_with_doubt, is_comfortable
from tactopose_drake.core.posterior.posterior import make_posterior
from tactopose_drake.core.searches.doubt import search_with_doubt
from tactopose_drake.core.searches.levenberg_marquardt import LevenbergMarquardt
from tactopose_drake.core.searches.pair_search import PairSearch, Start, global_stages
from tactopose_drake.core.searches.patch_searches import patch_search
from tactopose_drake.core.searches.pose_problem import PoseProblem, make_problem
from tactopose_drake.core.shape.free_spin import nearest_images
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.tracking.calibration_scale import estimate_scale, follow_scale
from tactopose_drake.core.tracking.contact_errors import LEAST_INLIER
from tactopose_drake.core.tracking.keyframes import Touch
from tactopose_drake.core.tracking.tracked_modes import TrackedModes
from tactopose_drake.core.tracking.tracker_params import PoseTrackerParams, RelocalisationParams
from tactopose_drake.core.tracking.weighed_modes import WeighedModes
from tactopose_drake.core.validation import FloatArray

_REFINEMENT = LevenbergMarquardt(max_iterations=20, tolerance=1e-2)


class TouchWeighing(NamedTuple):
    """The touch of one slice, by the sources of its contacts, and how far its modes are weighed."""

    evidence: Evidence
    sources: tuple[str, ...]
    weighing: Weighing


class SearchState(NamedTuple):
    """How far the search is.

    Attributes:
        X_PO: what the slices so far have found, as of the last of them, shape (n, 3, 4); None between two searches.
        is_settled: whether these are minima of all the evidence.
        is_scaled: whether it has been asked of these how large the calibration's errors seem.
        minima: what the last search has found, as of that time, shape (m, 3, 4): modes led astray are found again.
        weighing: of the modes, which the next slice goes on with, or asks of them whether they are clear of the hand;
            None where that does something else.
        X_PP: the motion of the object in P since then, which acts from the left, shape (3, 4).
        searches: how many there were.
        agreeing: how many of them since something happened that makes what they said before worthless.
        time: when the last one began, s.
    """

    X_PO: FloatArray | None = None
    is_settled: bool = False
    is_scaled: bool = False
    minima: FloatArray = np.empty((0, 3, 4))
    weighing: TouchWeighing | WeighedModes | None = None
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
        return self._replace(X_PO=X_PO, minima=compose(self.X_PP, self.minima), X_PP=np.eye(3, 4))

    def is_due(self, time: float, params: RelocalisationParams, *, is_urgent: bool) -> bool:
        """Whether the next search may begin at a time, s."""
        steady = self.agreeing >= params.steady_searches
        period = params.urgent_period if is_urgent else params.steady_period if steady else params.period
        return time >= self.time + period - 1e-9

    def ended(self) -> SearchState:
        """That before the next search."""
        return self._replace(X_PO=None, is_settled=False, is_scaled=False, weighing=None, searches=self.searches + 1)


class SearchStep(NamedTuple):
    """What slices of a search come to.

    Attributes:
        state: how far the search is.
        weighed: what the posterior says where that is to be put to use, else None.
        calibration_scale: how large the calibration's errors seem, see `estimate_scale`, where that was asked, else
            None.
    """

    state: SearchState
    weighed: WeighedModes | None = None
    calibration_scale: FloatArray | None = None


def search_on(
    model: ObjectModel,
    params: PoseTrackerParams,
    touch: Touch,
    modes: TrackedModes,
    search: SearchState,
    *,
    slices: int | None = 1,
    thorough: bool = True,
) -> SearchStep:
    """What the next slices come to.

    Where the filter has no mode, there is none to keep up meanwhile: all are taken.

    Args:
        model: the object.
        params: what is assumed.
        touch: of now.
        modes: the filter's.
        search: how far it is.
        slices: how many are taken, up to the search's end; None: all.
        thorough: whether samples are drawn until the modes' probabilities are sure, and not in one round alone.
    """
    taken, most, scale = 0, slices if len(modes) else None, None
    if not thorough:
        one_round = dataclasses.replace(params.relocalisation, most_samples=params.relocalisation.samples)
        params = dataclasses.replace(params, relocalisation=one_round)
    while True:
        search, weighed, told = _next_slice(model, params, touch, modes, search)
        taken += 1
        if told is not None:
            scale, errors = told, follow_scale(touch.reading.errors, told, params.calibration_scale)
            touch = touch._replace(reading=touch.reading._replace(errors=errors))
        if search.X_PO is None or taken == most:
            return SearchStep(search, weighed, scale)


def _next_slice(
    model: ObjectModel, params: PoseTrackerParams, touch: Touch, modes: TrackedModes, search: SearchState
) -> SearchStep:
    """Likewise; no poses are left in what a search has come to when it ends."""
    if isinstance(search.weighing, WeighedModes):  # They are as of the slice that began to weigh.
        weighed, search = search.weighing.moved(search.X_PP), search.as_of_now()
        return SearchStep(search.ended(), _clear_of_the_hand(model, params.relocalisation, touch, weighed))
    if search.weighing is not None:
        samples = search.weighing.weighing.samples
        parts = 0 if samples is None else len(samples.drawn)  # Rounds from the same proposals are no copies.
        generator = np.random.default_rng([params.seed, search.searches, 1 + parts])
        weighing = _weigh_on(model, params.relocalisation, search.weighing, generator)
        return SearchStep(search._replace(weighing=weighing))
    search = search.as_of_now()
    evidence, settings = touch.averaged(params), params.relocalisation
    generator = np.random.default_rng([params.seed, search.searches])
    if search.X_PO is None:
        near = dataclasses.replace(evidence, prior=None) if search.searches % 2 else evidence
        return SearchStep(search._replace(X_PO=_propose_poses(model, settings, near, generator)))
    if search.is_settled and not search.is_scaled:
        scale = _estimate_scale(model, params, touch, search.X_PO)
        return SearchStep(search._replace(is_scaled=True), calibration_scale=scale)
    if search.is_settled:
        weighing = _begin_weighing(model, params, touch, search.X_PO, generator)
        return SearchStep(search._replace(weighing=weighing))
    X_PO = np.concatenate([modes.X_PO, search.minima, search.X_PO])
    X_PO = _settle_poses(model, settings, evidence, X_PO) if len(X_PO) else X_PO
    search = search._replace(X_PO=X_PO, is_settled=True, minima=X_PO[: params.mixture.max_modes])
    return SearchStep(search if len(X_PO) else search.ended())


def _clear_of_the_hand(
    model: ObjectModel, params: RelocalisationParams, touch: Touch, weighed: WeighedModes
) -> WeighedModes:
    """The same where several likely modes count by how deep the object is in the hand at each."""
    likely = weighed.likely(params)
    if touch.depth_in_hand is None or not len(likely):
        return weighed
    depth = touch.depth_in_hand(np.ascontiguousarray(weighed.modes.mixture.X_PO[likely]))
    return weighed.clear(model, touch.evidence.hand, params, depth)


def _propose_poses(
    model: ObjectModel, params: RelocalisationParams, near: Evidence, generator: np.random.Generator
) -> FloatArray:
    """Minima of the touch alone, near its prior if there is one, best first, shape (n, 3, 4).

    What bounds the pose is left out: it is slow.
    """
    starts = params.starts
    touch = dataclasses.replace(near, hand=None, untouched=None, balance=None, friction=None, patches=near.felt)
    problem = make_problem(model, touch)
    pairs = PairSearch.of(model, touch.contacts)
    if touch.felt:
        pairs = patch_search(model, touch.felt, touch.contacts)
    stages = global_stages(-(-starts // 2), -(-starts // 8))
    start = Start(candidates=starts, samples=starts // 2)
    pairs = dataclasses.replace(pairs, start=start, start_but_for_one=start, stages=stages)
    found = search_with_doubt(problem, pairs, generator)
    return _distinct(model, params, problem, found.X_PO, found.cost).mixture.X_PO


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
    X_PO = _distinct(model, params, problem, found.X_PO, found.cost).mixture.X_PO
    judgement = None if problem.mixture is None else problem.mixture.judge(X_PO)
    return X_PO[explain_with_doubt(model, evidence, judgement, X_PO, params.posterior.plausibility)]


def _begin_weighing(
    model: ObjectModel, params: PoseTrackerParams, touch: Touch, X_PO: FloatArray, generator: np.random.Generator
) -> TouchWeighing:
    """Begins to weigh the posterior's modes at minima (m, 3, 4) of the touch, at least one."""
    settings, evidence = params.relocalisation, touch.averaged(params)
    problem, modes = _modes_at(model, settings, evidence, X_PO)
    posterior = make_posterior(model, evidence, problem, settings.posterior)
    sources = touch.reading.names[: len(evidence.contacts)]
    return TouchWeighing(evidence, sources, begin_weighing(modes, posterior, generator))


def _modes_at(
    model: ObjectModel, params: RelocalisationParams, evidence: Evidence, X_PO: FloatArray
) -> tuple[PoseProblem, Modes]:
    """The problem that evidence poses, and its distinct modes at minima (m, 3, 4)."""
    problem = make_problem(model, evidence)
    return problem, _distinct(model, params, problem, X_PO, problem.doubted(problem.objective).cost(X_PO))


def _estimate_scale(model: ObjectModel, params: PoseTrackerParams, touch: Touch, X_PO: FloatArray) -> FloatArray | None:
    """How large the calibration's errors seem to the modes at minima (m, 3, 4) of the touch; see `estimate_scale`."""
    problem, modes = _modes_at(model, params.relocalisation, touch.averaged(params), X_PO)
    contacts, X_PO, now = touch.reading.contacts, modes.mixture.X_PO, touch.keyframes[-1]
    inlier, count = np.ones((len(X_PO), len(contacts))), len(touch.evidence.contacts)
    if problem.mixture is not None:
        inlier[:, :count] = problem.mixture.judge(X_PO).inlier_probability
    if problem.pad_mixture is not None:
        inlier[:, count:] = problem.pad_mixture.inlier_probability(X_PO)
    mean = contacts.with_arrays(p_PC=now.p_PC, n_PC=now.n_PC)
    return estimate_scale(model, params, touch.reading, mean, now.frames, modes, inlier)


def _weigh_on(
    model: ObjectModel, params: RelocalisationParams, touch: TouchWeighing, generator: np.random.Generator
) -> TouchWeighing | WeighedModes:
    """The next step of weighing; after the last what the posterior says of the modes.

    That is by Laplace's approximation where nothing covers them.
    """
    evidence, sources, weighing = touch
    problem = make_problem(model, evidence)
    if weighing.cover is not None:
        posterior = make_posterior(model, evidence, problem, params.posterior)
        weighing = weigh_on(weighing, posterior, generator)
    if weighing.cover is not None:
        return touch._replace(weighing=weighing)
    modes = weighing.modes
    if problem.mixture is None:
        return WeighedModes(modes, np.zeros(0), (), 1.0)
    judgement, weights = problem.mixture.judge(modes.mixture.X_PO), modes.mixture.weights
    log_inlier = weights @ np.log(np.maximum(judgement.inlier_probability, LEAST_INLIER))
    return WeighedModes(modes, np.exp(log_inlier), sources, float(weights @ judgement.noise_scale))


def _distinct(
    model: ObjectModel, params: RelocalisationParams, problem: PoseProblem, X_PO: FloatArray, cost: FloatArray
) -> Modes:
    """Distinct modes at minima (m, 3, 4) of these costs (m,), by Laplace's approximation; not too many are kept."""
    return find_modes(
        X_PO,
        cost,
        problem.determining.normal_equations(X_PO).hessian,
        problem.space.information,
        model.symmetry_poses,
        model.size,
        params.found,
    )
