"""A search beside the filter: the one-shot posterior of the touch, in slices that each fit into the time of an update.

The slices propose minima of the touch, from a different subset of starts in each search; refine these and the known
modes with all the evidence; estimate the errors of the hand's calibration from the residuals; cover the modes with
proposals, as the one-shot estimate does, and weight samples of them; and evaluate how deep the object would penetrate
the hand. The result is then used as in `relocalisation.py`. Over several searches the whole pose space is covered.
"""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import numpy as np

from tactopose_drake.core.evidence.contact_reading import ErrorScales
from tactopose_drake.core.evidence.evidence import Evidence
from tactopose_drake.core.motion.rigid_motion import Motion
from tactopose_drake.core.poses import compose
from tactopose_drake.core.posterior.importance_sampling import SamplingState, begin_sampling, sample_on
from tactopose_drake.core.posterior.modes import Modes, find_modes
from tactopose_drake.core.posterior.plausibility import explain_with_doubt, is_comfortable
from tactopose_drake.core.posterior.posterior import make_posterior
from tactopose_drake.core.searches.doubt import search_with_doubt
from tactopose_drake.core.searches.pair_search import PairSearch, Start, global_stages
from tactopose_drake.core.searches.patch_searches import patch_search
from tactopose_drake.core.searches.pose_problem import PoseProblem, make_problem
from tactopose_drake.core.shape.free_spin import nearest_images
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.times import has_passed
from tactopose_drake.core.tracking.calibration_scale import estimate_scale, follow_scale
from tactopose_drake.core.tracking.contact_errors import LEAST_INLIER
from tactopose_drake.core.tracking.found_modes import FoundModes
from tactopose_drake.core.tracking.keyframes import Touch
from tactopose_drake.core.tracking.tracked_modes import REFINEMENT, TrackedModes
from tactopose_drake.core.tracking.tracker_params import PoseTrackerParams, RelocalisationParams
from tactopose_drake.core.validation import FloatArray


class TouchSampling(NamedTuple):
    """The touch of one slice, the sources of its contacts, and the state of sampling its posterior."""

    evidence: Evidence
    sources: tuple[str, ...]
    state: SamplingState


class SearchState(NamedTuple):
    """Progress of the search.

    Attributes:
        X_PO: the poses found so far, at the time of the last slice, shape (n, 3, 4); None between two searches.
        is_settled: whether these are minima of all the evidence.
        is_scaled: whether the calibration's errors have been estimated at these.
        minima: result of the last search, at its time, shape (m, 3, 4), so that modes led astray are found again.
        sampling: state of weighting the modes, or the weighted modes before they are tested against the hand; None
            outside these stages.
        X_PP: the motion of the object in P since then, to be multiplied from the left, shape (3, 4).
        searches: number of completed searches.
        agreeing: number of these since the last event that made earlier results worthless.
        time: when the last one began, s.
    """

    X_PO: FloatArray | None = None
    is_settled: bool = False
    is_scaled: bool = False
    minima: FloatArray = np.empty((0, 3, 4))
    sampling: TouchSampling | FoundModes | None = None
    X_PP: FloatArray = np.eye(3, 4)
    searches: int = 0
    agreeing: int = 0
    time: float = -np.inf

    def moved(self, motion: Motion) -> SearchState:
        """The state after a further motion of the object."""
        return self._replace(X_PP=motion.of_poses(self.X_PP))

    def as_of_now(self) -> SearchState:
        """The state with its poses moved to the present."""
        X_PO = None if self.X_PO is None else compose(self.X_PP, self.X_PO)
        return self._replace(X_PO=X_PO, minima=compose(self.X_PP, self.minima), X_PP=np.eye(3, 4))

    def is_due(self, time: float, params: RelocalisationParams, *, is_urgent: bool) -> bool:
        """Whether the next search may begin at a time, s."""
        steady = self.agreeing >= params.steady_searches
        period = params.urgent_period if is_urgent else params.steady_period if steady else params.period
        return has_passed(time, self.time, period)

    def ended(self) -> SearchState:
        """The state after the end of a search."""
        return self._replace(X_PO=None, is_settled=False, is_scaled=False, sampling=None, searches=self.searches + 1)


class SearchStep(NamedTuple):
    """The result of some slices of a search.

    Attributes:
        state: progress of the search.
        found: the posterior, when it is complete, else None.
        errors: the contacts' errors, with the calibration's estimated anew, if these slices include that stage and
            `estimate_scale` could tell it; else None.
    """

    state: SearchState
    found: FoundModes | None = None
    errors: ErrorScales | None = None


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
    """Advances the search by some slices.

    If the filter has no mode, there is nothing to keep up with, and the search is completed.

    Args:
        model: the object.
        params: what is assumed.
        touch: the current touch.
        modes: the filter's.
        search: progress so far.
        slices: how many to take, up to the search's end; None for all.
        thorough: whether to sample until the modes' probabilities are accurate, rather than in a single round.
    """
    taken, most, errors = 0, slices if len(modes) else None, None
    if not thorough:
        one_round = dataclasses.replace(params.relocalisation, most_samples=params.relocalisation.samples)
        params = dataclasses.replace(params, relocalisation=one_round)
    while True:
        search, found, estimated = _next_slice(model, params, touch, modes, search)
        taken += 1
        if estimated is not None:
            errors = estimated
            touch = touch._replace(reading=touch.reading._replace(errors=errors))
        if search.X_PO is None or taken == most:
            return SearchStep(search, found, errors)


def _next_slice(
    model: ObjectModel, params: PoseTrackerParams, touch: Touch, modes: TrackedModes, search: SearchState
) -> SearchStep:
    """Advances the search by one slice. A search that ends leaves no poses in its state."""
    if isinstance(search.sampling, FoundModes):  # Their poses date from the slice in which weighting began.
        found, search = search.sampling.moved(search.X_PP), search.as_of_now()
        return SearchStep(search.ended(), _clear_of_the_hand(model, params.relocalisation, touch, found))
    if search.sampling is not None:
        samples = search.sampling.state.samples
        drawn = 0 if samples is None else len(samples.X_PO)  # So that no two rounds use the same random numbers.
        generator = np.random.default_rng([params.seed, search.searches, 1 + drawn])
        sampling = _sample_on(model, params.relocalisation, search.sampling, generator)
        return SearchStep(search._replace(sampling=sampling))
    search = search.as_of_now()
    evidence, settings = touch.averaged(params), params.relocalisation
    generator = np.random.default_rng([params.seed, search.searches])
    if search.X_PO is None:
        near = dataclasses.replace(evidence, prior=None) if search.searches % 2 else evidence
        return SearchStep(search._replace(X_PO=_propose_poses(model, settings, near, generator)))
    if search.is_settled and not search.is_scaled:
        scale = _estimate_scale(model, params, touch, evidence, search.X_PO)
        errors = None if scale is None else follow_scale(touch.reading.errors, scale, params.calibration_scale)
        return SearchStep(search._replace(is_scaled=True), errors=errors)
    if search.is_settled:
        sampling = _begin_sampling(model, settings, touch, evidence, search.X_PO, generator)
        return SearchStep(search._replace(sampling=sampling))
    X_PO = np.concatenate([modes.X_PO, search.minima, search.X_PO])
    X_PO = _settle_poses(model, settings, evidence, X_PO) if len(X_PO) else X_PO
    search = search._replace(X_PO=X_PO, is_settled=True, minima=X_PO[: params.mixture.max_modes])
    return SearchStep(search if len(X_PO) else search.ended())


def _clear_of_the_hand(model: ObjectModel, params: RelocalisationParams, touch: Touch, found: FoundModes) -> FoundModes:
    """The modes, weighted by the penetration of the hand at each if several are likely."""
    likely = found.likely(params)
    if touch.depth_in_hand is None or not len(likely):
        return found
    depth = touch.depth_in_hand(np.ascontiguousarray(found.modes.mixture.X_PO[likely]))
    return found.clear(model, touch.evidence.hand, params, likely, depth)


def _propose_poses(
    model: ObjectModel, params: RelocalisationParams, near: Evidence, generator: np.random.Generator
) -> FloatArray:
    """Minima of the touch alone, near its prior if there is one, best first, shape (n, 3, 4).

    Evidence that only bounds the pose is left out, as it is slow.
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
    """Refines poses (n, 3, 4) with all the evidence; returns those minima that explain the touch, shape (m, 3, 4).

    Without a prior, each start is replaced by its symmetric image nearest to the first.
    """
    problem = make_problem(model, evidence)
    if evidence.prior is None:
        X_PO = nearest_images(X_PO, X_PO[0], model.symmetry_turns, model.symmetries)
    found = REFINEMENT.refine(problem.objective, X_PO)
    if not is_comfortable(model, evidence, problem, found.X_PO):
        found = REFINEMENT.refine(problem.doubted(problem.objective), np.concatenate([X_PO, found.X_PO]))
    X_PO = _distinct(model, params, problem, found.X_PO, found.cost).mixture.X_PO
    judgement = None if problem.mixture is None else problem.mixture.judge(X_PO)
    return X_PO[explain_with_doubt(model, evidence, judgement, X_PO, params.posterior.plausibility)]


def _begin_sampling(
    model: ObjectModel,
    params: RelocalisationParams,
    touch: Touch,
    evidence: Evidence,
    X_PO: FloatArray,
    generator: np.random.Generator,
) -> TouchSampling:
    """Begins to weight the posterior's modes at minima (m, 3, 4), at least one, of a touch with this mean evidence."""
    problem, modes = _modes_at(model, params, evidence, X_PO)
    posterior = make_posterior(model, evidence, problem, params.posterior)
    sources = touch.reading.names[: len(evidence.contacts)]
    return TouchSampling(evidence, sources, begin_sampling(modes, posterior, generator))


def _modes_at(
    model: ObjectModel, params: RelocalisationParams, evidence: Evidence, X_PO: FloatArray
) -> tuple[PoseProblem, Modes]:
    """The estimation problem of the evidence, and its distinct modes at minima (m, 3, 4)."""
    problem = make_problem(model, evidence)
    return problem, _distinct(model, params, problem, X_PO, problem.doubted(problem.objective).cost(X_PO))


def _estimate_scale(
    model: ObjectModel, params: PoseTrackerParams, touch: Touch, evidence: Evidence, X_PO: FloatArray
) -> FloatArray | None:
    """Estimates the scale of the calibration's errors at minima (m, 3, 4) of a touch with this mean evidence."""
    problem, modes = _modes_at(model, params.relocalisation, evidence, X_PO)
    contacts, X_PO, now = touch.reading.contacts, modes.mixture.X_PO, touch.keyframes[-1]
    inlier, count = np.ones((len(X_PO), len(contacts))), len(touch.evidence.contacts)
    if problem.mixture is not None:
        inlier[:, :count] = problem.mixture.judge(X_PO).inlier_probability
    if problem.pad_mixture is not None:
        inlier[:, count:] = problem.pad_mixture.inlier_probability(X_PO)
    mean = contacts.with_arrays(p_PC=now.p_PC, n_PC=now.n_PC)
    return estimate_scale(model, params, touch.reading, mean, now.frames, modes, inlier)


def _sample_on(
    model: ObjectModel, params: RelocalisationParams, touch: TouchSampling, generator: np.random.Generator
) -> TouchSampling | FoundModes:
    """One step of the weighting; after the last, the weighted modes.

    Without proposals that cover the modes, they are those of Laplace's approximation.
    """
    evidence, sources, state = touch
    problem = make_problem(model, evidence)
    if state.cover is not None:
        posterior = make_posterior(model, evidence, problem, params.posterior)
        state = sample_on(state, posterior, generator)
    if state.cover is not None:
        return touch._replace(state=state)
    modes = state.modes
    if problem.mixture is None:
        return FoundModes(modes, np.zeros(0), (), 1.0)
    judgement, weights = problem.mixture.judge(modes.mixture.X_PO), modes.mixture.weights
    log_inlier = weights @ np.log(np.maximum(judgement.inlier_probability, LEAST_INLIER))
    return FoundModes(modes, np.exp(log_inlier), sources, float(weights @ judgement.noise_scale))


def _distinct(
    model: ObjectModel, params: RelocalisationParams, problem: PoseProblem, X_PO: FloatArray, cost: FloatArray
) -> Modes:
    """Distinct modes at minima (m, 3, 4) with costs (m,), by Laplace's approximation; at most `params.found`."""
    return find_modes(
        X_PO,
        cost,
        problem.determining.normal_equations(X_PO).hessian,
        problem.space.information,
        model.symmetry_poses,
        model.size,
        params.found,
    )
