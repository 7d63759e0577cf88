"""Relocalisation: the one-shot posterior runs beside the filter, and its modes and the filter's compete by evidence.

A mode's weight is what the one-shot estimate gives it by the touch of now, and what it would have had by the touches of
the window. What the filter foretold has no part in that: so a mode that was led astray, and since then only foretells
what it is itself led by, loses against one that explains the touch better, whenever that is found. While the touch
stays, the searches weigh the same evidence again, each by samples of its own: their mean, with a forgetting factor, is
what counts. Of each mode of the posterior that the filter has already, the filter's pose stays, which has learnt from
many frames, unless the touch contradicts it.

Noise that seems larger than told, and contacts that seem false, are the one-shot estimate's own findings. They are of
the fingers, and last: each source's contacts are doubted by them at the frames to come.
"""

import dataclasses
import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.evidence.evidence import Evidence
from tactopose_drake.core.kernels.matrix_kernels import inverses
from tactopose_drake.core.objectives.surface_contact import SurfaceContact
from tactopose_drake.core.poses import compose, increments_between
from tactopose_drake.core.posterior.hypotheses import Modes
from tactopose_drake.core.searches.pose_problem import make_problem
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.tracking.contact_errors import averaged_variances, calibration_excess, lasting_excess
from tactopose_drake.core.tracking.contact_update import update_with_contacts
from tactopose_drake.core.tracking.frame import ContactReading, PoseMeasurement
from tactopose_drake.core.tracking.keyframes import TouchWindow
from tactopose_drake.core.tracking.motion_prediction import Motion
from tactopose_drake.core.tracking.one_shot_posterior import WeighedModes, propose_poses, settle_poses, weigh_poses
from tactopose_drake.core.tracking.tracked_modes import TrackedModes
from tactopose_drake.core.tracking.tracker_params import PoseTrackerParams
from tactopose_drake.core.validation import FloatArray


class SearchState(NamedTuple):
    """How far the search is.

    Attributes:
        X_PO: what the slices so far have found, as of now, shape (n, 3, 4); None between two searches.
        is_settled: whether these are minima of all the evidence.
        weighed: what the posterior says of them; None before the last slice.
        searches: how many there were.
        agreeing: how many of them since something happened that makes what they said before worthless.
        time: when the last one began, s.
    """

    X_PO: FloatArray | None = None
    is_settled: bool = False
    weighed: WeighedModes | None = None
    searches: int = 0
    agreeing: int = 0
    time: float = -np.inf

    def moved(self, motion: Motion) -> "SearchState":
        """The same after a motion of the object."""
        if self.X_PO is None:
            return self
        weighed = None if self.weighed is None else self.weighed.moved(motion)
        return self._replace(X_PO=compose(motion.pose, self.X_PO), weighed=weighed)


class Touch(NamedTuple):
    """What poses are judged by now.

    Attributes:
        evidence: of now.
        reading: its contacts by sources.
        window: the touches of now and of the past.
        standing: what vision said, as of now.
    """

    evidence: Evidence
    reading: ContactReading
    window: TouchWindow
    standing: PoseMeasurement | None

    def averaged(self, params: PoseTrackerParams) -> Evidence:
        """The evidence with the mean of the contacts while they stay, as sure as that is, and with what vision said."""
        contacts, now = self.evidence.contacts, self.window.now
        if len(contacts) == len(now.p_PC):
            more = calibration_excess(contacts, params, self.reading.calibration)
            sigmas = np.sqrt(averaged_variances(contacts, params, now.frames) + more)
            contacts = dataclasses.replace(
                contacts,
                p_PC=now.p_PC,
                n_PC=now.n_PC,
                covariance=None,
                sigma_position=sigmas[:, 0],
                sigma_normal=sigmas[:, 1],
            )
        prior = None if self.standing is None else self.standing.as_prior()
        return dataclasses.replace(self.evidence, contacts=contacts, prior=prior)


def search_on(
    model: ObjectModel, params: PoseTrackerParams, touch: Touch, modes: TrackedModes, search: SearchState
) -> tuple[SearchState, WeighedModes | None]:
    """The next slice, and what the posterior says where that is to be put to use.

    Where the filter has no mode, there is none to keep up meanwhile: all slices are one.
    """
    if search.weighed is not None:
        return search._replace(X_PO=None, is_settled=False, weighed=None, searches=search.searches + 1), search.weighed
    evidence, settings = touch.averaged(params), params.relocalisation
    generator = np.random.default_rng([params.seed, search.searches])
    at_once = not len(modes)
    if search.X_PO is None:
        near = dataclasses.replace(evidence, prior=None) if search.searches % 2 else evidence
        search = search._replace(X_PO=propose_poses(model, settings, near, generator), is_settled=False)
        if not at_once:
            return search, None
    assert search.X_PO is not None
    if not search.is_settled:
        X_PO = np.concatenate([modes.X_PO, search.X_PO])
        X_PO = settle_poses(model, settings, evidence, X_PO) if len(X_PO) else X_PO
        search = search._replace(X_PO=X_PO, is_settled=True)
        if not at_once and len(X_PO):
            return search, None
    assert search.X_PO is not None
    ended = search._replace(X_PO=None, is_settled=False, searches=search.searches + 1)
    if not len(search.X_PO):
        return ended, None
    weighed = weigh_poses(model, settings, evidence, search.X_PO, generator)
    return (ended, weighed) if at_once else (search._replace(weighed=weighed), None)


def relocalise(
    model: ObjectModel,
    params: PoseTrackerParams,
    touch: Touch,
    modes: TrackedModes,
    posterior: Modes,
    share: float,
) -> TrackedModes:
    """The modes of the posterior by the window, by falling weight.

    Args:
        model: the object.
        params: what is assumed.
        touch: of now.
        modes: the filter's, after the touch.
        posterior: by the touch of now.
        share: of the mean of a mode's weights that is by this posterior.
    """
    X_PO, weights = posterior.mixture.X_PO, posterior.mixture.weights
    log_weight = np.log(np.maximum(weights, 1e-300)) - past_cost(model, params, touch.window, X_PO)
    log_weight -= np.logaddexp.reduce(log_weight)
    kept = np.flatnonzero(log_weight > log_weight.max() + math.log(params.mixture.least_share))
    kept = kept[np.argsort(-log_weight[kept], kind="stable")][: params.mixture.max_modes]
    pairs, is_right = _match(model, params, touch.averaged(params), posterior, kept, modes)
    new = _make_modes(model, params, touch, posterior, kept[~is_right])
    joined = modes.chosen(pairs[is_right]).joined(new)
    order = np.concatenate([np.flatnonzero(is_right), np.flatnonzero(~is_right)])
    pairs, now = pairs[order], log_weight[kept[order]]
    if len(modes):
        before = (modes.log_weight - np.logaddexp.reduce(modes.log_weight))[pairs]
        now = np.where(pairs < 0, now, before + share * (now - before))
    return dataclasses.replace(joined, log_weight=now)


def follow_doubt(
    doubt: Mapping[str, float], weighed: WeighedModes, sources: tuple[str, ...], share: float
) -> dict[str, float]:
    """By how much the variances of what lasts of each source's errors seem larger than told, after another search.

    Args:
        doubt: before.
        weighed: what the posterior says.
        sources: of its contacts, in their order, and then of others of which it says nothing.
        share: of the mean that is by this posterior.
    """
    after = dict(doubt)
    for name, inlier in zip(sources, weighed.inlier_probability, strict=False):
        now = weighed.noise_scale**2 / max(float(inlier), _LEAST_INLIER)
        after[name] = math.exp((1.0 - share) * math.log(doubt.get(name, 1.0)) + share * math.log(max(now, 1.0)))
    return after


# However false a contact seems, it counts by this share.
_LEAST_INLIER = 0.01


def past_cost(model: ObjectModel, params: PoseTrackerParams, window: TouchWindow, X_PO: FloatArray) -> FloatArray:
    """The cost of poses (n, 3, 4) by the touches of the past, shape (n,).

    One of them may be of before a slip that nobody noticed: each is a mixture of what it says and of saying nothing.
    The hand's calibration is the same at all times: of so many touches each counts by the effective sample size.
    """
    if window.past is None:
        return np.zeros(len(X_PO))
    touch = SurfaceContact(model.grid, window.past)
    residuals = touch.residuals(np.ascontiguousarray(X_PO)).reshape(len(X_PO), len(window.past), -1)
    costs = np.zeros((window.count - 1, len(X_PO)))
    np.add.at(costs, window.keyframe, 0.5 * np.square(residuals).sum(axis=2).T)
    numbers = np.bincount(window.keyframe) * (1 if window.past.n_PC is None else 3)
    limits = 0.5 * numbers - math.log(params.window.slip_probability)
    share = 1.0 / (1.0 + (window.count - 1) * params.window.lasting_share)
    total: FloatArray = share * np.minimum(costs, limits[:, None]).sum(axis=0)
    return total


def _match(
    model: ObjectModel,
    params: PoseTrackerParams,
    evidence: Evidence,
    posterior: Modes,
    kept: NDArray[np.intp],
    modes: TrackedModes,
) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """For each of the posterior's modes that are kept the filter's that it is, or -1; and whether its pose stays."""
    pairs, is_right = np.full(len(kept), -1), np.zeros(len(kept), dtype=np.bool_)
    if not len(modes):
        return pairs, is_right
    X_PO = np.ascontiguousarray(posterior.mixture.X_PO[kept])
    information = inverses(posterior.mixture.covariance[kept])[0]
    objective = make_problem(model, evidence).objective
    cost, least = objective.cost(np.ascontiguousarray(modes.X_PO)), objective.cost(X_PO)
    images = compose(modes.X_PO[:, None], model.symmetry_poses[None])
    u = increments_between(X_PO[:, None, None], images[None])
    distance = np.einsum("jmsi,jik,jmsk->jms", u, information, u).min(axis=2)
    free = np.ones(len(modes), dtype=np.bool_)
    for j in range(len(kept)):
        same = np.flatnonzero(free & (distance[j] < params.mixture.same_sigmas**2))
        if len(same):
            i = int(same[np.argmin(cost[same])])
            free[i], pairs[j] = False, i
            is_right[j] = cost[i] < least[j] + params.relocalisation.least_gain
    return pairs, is_right


def _make_modes(
    model: ObjectModel, params: PoseTrackerParams, touch: Touch, posterior: Modes, kept: NDArray[np.intp]
) -> TrackedModes:
    """Modes as the posterior knows them, of whose biases is known what the touch tells."""
    reading, near, X_PO = touch.reading, touch.standing, posterior.mixture.X_PO[kept]
    n, sources = len(kept), len(reading.sources)
    if not n:
        return TrackedModes.empty(sources)
    if near is None:
        space = make_problem(model, Evidence(reading.contacts)).space
        spread = np.asarray(np.linalg.inv(space.information), dtype=np.float64)
        priors = TrackedModes.independent(X_PO, np.tile(spread, (n, 1, 1)), sources)
    else:
        X_near, covariance = np.tile(near.X_PO, (n, 1, 1)), np.tile(near.covariance, (n, 1, 1))
        priors = TrackedModes.independent(X_near, covariance, sources)
    update = update_with_contacts(model, params, reading, priors, X_PO)
    # How rough the surface is where they touch is known once they have been there.
    roughness = np.zeros_like(priors.roughness)
    roughness[:, reading.source] = update.roughness + lasting_excess(reading, params)
    new = dataclasses.replace(
        priors,
        X_PO=X_PO,
        covariance=update.covariance,
        cross_covariance=update.cross_covariance,
        roughness=roughness,
    )
    return new.fitted(posterior.mixture.covariance[kept])
