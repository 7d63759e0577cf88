"""The filter's modes and those of the one-shot posterior compete by evidence.

A mode's weight is what the one-shot estimate gives it by the touch of now, and what it would have had by the touches of
the window. What the filter foretold has no part in that: so a mode that was led astray, and since then only foretells
what it is itself led by, loses against one that explains the touch better, whenever that is found. While the touch
stays, the searches weigh the same evidence again, each by samples of its own: their mean, with a forgetting factor, is
what counts. Of each mode of the posterior that the filter has already, the filter's pose stays, which has learnt from
many frames, unless the touch contradicts it.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.evidence.evidence import Evidence
from tactopose_drake.core.kernels.matrix_kernels import inverses
from tactopose_drake.core.plain_values import copied
from tactopose_drake.core.poses import compose, increments_between
from tactopose_drake.core.posterior.hypotheses import Modes
from tactopose_drake.core.searches.pose_problem import make_problem
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.tracking.contact_update import update_with_contacts
from tactopose_drake.core.tracking.keyframes import Touch, past_cost
from tactopose_drake.core.tracking.tracked_modes import TrackedModes
from tactopose_drake.core.tracking.tracker_params import PoseTrackerParams
from tactopose_drake.core.validation import FloatArray


def relocalise(
    model: ObjectModel, params: PoseTrackerParams, touch: Touch, modes: TrackedModes, posterior: Modes, share: float
) -> TrackedModes:
    """The modes of the posterior by the window, by falling weight.

    Args:
        model: the object.
        params: what is assumed.
        touch: of now.
        modes: the filter's, after the touch.
        posterior: by the touch of now.
        share: of the mean of a mode's weights, that is by it.
    """
    X_PO, weights = posterior.mixture.X_PO, posterior.mixture.weights
    log_weight = np.log(np.maximum(weights, 1e-300)) - past_cost(model, params, touch.window, X_PO)
    log_weight -= np.logaddexp.reduce(log_weight)
    kept = np.argsort(-log_weight, kind="stable")[: params.mixture.max_modes]
    kept = kept[log_weight[kept] > log_weight[kept[:1]] + math.log(params.mixture.least_share)]
    same = _same_modes(model, params, posterior, kept, modes)
    pairs, is_right = _match(model, params, touch.averaged(params), posterior, kept, modes, same)
    new = _make_modes(model, params, touch, posterior, kept[~is_right])
    joined = modes.chosen(pairs[is_right]).joined(new)
    now = log_weight[kept]
    if len(modes):
        before = modes.log_weight - np.logaddexp.reduce(modes.log_weight)
        now = _mean_weights(before, now, same, share)
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
    model: ObjectModel, params: PoseTrackerParams, posterior: Modes, kept: NDArray[np.intp], modes: TrackedModes
) -> NDArray[np.bool_]:
    """Which of the posterior's k modes that are kept are which of the filter's n, up to symmetries, shape (k, n)."""
    information = inverses(posterior.mixture.covariance[kept])[0]
    images = compose(modes.X_PO[:, None], model.symmetry_poses[None])
    u = increments_between(posterior.mixture.X_PO[kept, None, None], images[None])
    distance = np.einsum("jmsi,jik,jmsk->jms", u, information, u).min(axis=2)
    return np.asarray(distance < params.mixture.same_sigmas**2)


def _match(
    model: ObjectModel,
    params: PoseTrackerParams,
    evidence: Evidence,
    posterior: Modes,
    kept: NDArray[np.intp],
    modes: TrackedModes,
    same: NDArray[np.bool_],
) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """For each of the posterior's modes that are kept the filter's that it is, or -1; and whether its pose stays."""
    pairs, is_right = np.full(len(kept), -1), np.zeros(len(kept), dtype=np.bool_)
    objective = make_problem(model, evidence).objective
    cost = objective.cost(np.ascontiguousarray(modes.X_PO))
    least = objective.cost(np.ascontiguousarray(posterior.mixture.X_PO[kept]))
    free = np.ones(len(modes), dtype=np.bool_)
    for j in range(len(kept)):
        alike = np.flatnonzero(free & same[j])
        if len(alike):
            i = int(alike[np.argmin(cost[alike])])
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
        X_near, information = X_PO, make_problem(model, Evidence(reading.contacts)).space.information
        spread = np.asarray(np.linalg.inv(information), dtype=np.float64)
    else:
        X_near, spread = np.tile(near.X_PO, (n, 1, 1)), near.covariance
    priors = TrackedModes.independent(X_near, np.tile(spread, (n, 1, 1)), sources)
    update = update_with_contacts(model, params, reading, priors, X_PO)
    # How rough the surface is where they touch is known once they have been there.
    roughness = np.zeros_like(priors.roughness)
    roughness[:, reading.source] = update.roughness + reading.parts.excess
    new = copied(priors, X_PO=X_PO, covariance=update.covariance, roughness=roughness)
    return copied(new, cross_covariance=update.cross_covariance).fitted(posterior.mixture.covariance[kept])
