"""Relocalisation: modes found by a search of the one-shot posterior compete with those of the filter.

A mode's weight is its posterior probability by the current touch, times the likelihood of the window's other touches.
If there is a prior, or vision, the mode is first moved to where these fit, too: few contacts leave long valleys, in
which a wrong prior puts it far from where more fingers have held the object before. Without a prior it stays where the
touch puts it, for touches from when the hand was closing may be wrong. The filter's prediction does not enter: so a
mode that was led astray, and since then only predicts its own error, loses against one that explains the touch better,
whenever that is found. While the touch stays, searches weight the same evidence again with independent samples; their
mean counts, with a forgetting factor. The filter's pose of a mode that it already has is kept, for it has learnt from
many frames, unless the touch contradicts it. But until the next search it is no better known than by the posterior and
the window together: the filter linearises at one place, and does not know how far a bent valley extends.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.kernels.matrix_kernels import inverses
from tactopose_drake.core.objectives.objective import SmoothObjective, SmoothSum
from tactopose_drake.core.poses import compose, increments_between, increments_of_images
from tactopose_drake.core.posterior.modes import Modes
from tactopose_drake.core.searches.pose_problem import make_problem
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.tracking.contact_update import begin_modes
from tactopose_drake.core.tracking.keyframes import (
    Touch,
    TouchWindow,
    make_window,
    past_cost,
    past_information,
    past_objective,
)
from tactopose_drake.core.tracking.tracked_modes import REFINEMENT, TrackedModes
from tactopose_drake.core.tracking.tracker_params import PoseTrackerParams
from tactopose_drake.core.validation import FloatArray


def relocalise(
    model: ObjectModel, params: PoseTrackerParams, touch: Touch, modes: TrackedModes, posterior: Modes, share: float
) -> TrackedModes:
    """The posterior's modes, weighted by the window: first those that the filter already has, then new ones.

    Args:
        model: the object.
        params: what is assumed.
        touch: the current touch.
        modes: the filter's, updated with the touch.
        posterior: the modes of the current touch.
        share: weight of this posterior in the running mean of each mode's log weight.
    """
    X_PO, covariance, weights = posterior.mixture.X_PO, posterior.mixture.covariance, posterior.mixture.weights
    window = make_window(touch.keyframes, params.window)
    now = np.log(np.maximum(weights, 1e-300)) - past_cost(model, params, window, X_PO)
    now -= np.logaddexp.reduce(now)
    kept = np.argsort(-now, kind="stable")[: params.mixture.max_modes]
    kept = kept[now[kept] > now[kept[:1]] + math.log(params.mixture.least_share)]
    X_PO, covariance, now = X_PO[kept], covariance[kept], now[kept]
    problem = make_problem(model, touch.averaged(params))
    objective = problem.doubted(problem.objective)
    if window.past is not None and touch.standing is not None:
        X_PO, now = _fit_past(model, params, window, objective, X_PO, now)
        information = inverses(covariance)[0] + past_information(model, params, window, X_PO)
        kept, now = _join(X_PO, information, now, params.mixture.same_sigmas)
        X_PO, covariance = X_PO[kept], covariance[kept]
    same, within = _same_modes(model, params, X_PO, covariance, modes)
    cost, least = (
        objective.cost(np.ascontiguousarray(X)) + past_cost(model, params, window, X) for X in (modes.X_PO, X_PO)
    )
    pairs = _match(cost, same, within & (cost < least[:, None] + params.relocalisation.least_gain))
    is_right = pairs >= 0
    new = begin_modes(model, params, touch.reading, touch.standing, X_PO[~is_right], covariance[~is_right])
    if len(modes):
        before = modes.log_weight - np.logaddexp.reduce(modes.log_weight)
        now = _mean_weights(before, now, same, share)
    information = inverses(covariance)[0] + past_information(model, params, window, X_PO)
    joined = modes.chosen(pairs[is_right]).at_least(inverses(information[is_right])[0]).joined(new)
    order = np.argsort(~is_right, kind="stable")
    return dataclasses.replace(joined, log_weight=now[order], most_information=information[order])


def _fit_past(
    model: ObjectModel,
    params: PoseTrackerParams,
    window: TouchWindow,
    touch: SmoothObjective,
    X_PO: FloatArray,
    log_weight: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Moves modes (n, 3, 4) of the current touch within their valleys to where the past touches fit, too.

    A mode keeps its pose unless its weight grows. A lower cost by the current touch adds nothing to the weight, as the
    mode's mass contains it already.

    Args:
        model: the object.
        params: what is assumed.
        window: the touches, of which there are past ones.
        touch: the objective of the current one.
        X_PO: its modes, shape (n, 3, 4).
        log_weight: logarithms of their weights by all touches, shape (n,).

    Returns:
        The poses and the logarithms of their weights.
    """
    moved = REFINEMENT.refine_each(SmoothSum([touch, past_objective(model, params, window)]), X_PO).X_PO
    of_now = touch.cost(moved) - touch.cost(X_PO)
    of_past = past_cost(model, params, window, moved) - past_cost(model, params, window, X_PO)
    gain = -of_past - np.maximum(of_now, 0.0)
    return np.where((gain > 0.0)[:, None, None], moved, X_PO), log_weight + np.maximum(gain, 0.0)


def _join(
    X_PO: FloatArray, information: FloatArray, log_weight: FloatArray, same_sigmas: float
) -> tuple[NDArray[np.intp], FloatArray]:
    """Which of the modes (n, 3, 4) to keep, the heaviest of those at one place, with all their weight.

    Args:
        X_PO: the poses, shape (n, 3, 4).
        information: of the increments at each, shape (n, 6, 6).
        log_weight: logarithms of their weights, shape (n,).
        same_sigmas: standard deviations within which two are one.

    Returns:
        Indices by falling weight, and the logarithms of the weights, normalised.
    """
    order = np.argsort(-log_weight, kind="stable")
    u = increments_between(X_PO[order, None], X_PO[None, order])
    is_near = np.einsum("ijk,ikl,ijl->ij", u, information[order], u) < same_sigmas**2
    first = is_near.argmax(axis=0)
    heaviest = np.unique(first[first])
    total = np.full(len(order), -np.inf)
    np.logaddexp.at(total, first[first], log_weight[order])
    total = total[heaviest] - np.logaddexp.reduce(log_weight)
    ranked = np.argsort(-total, kind="stable")
    return order[heaviest[ranked]], total[ranked]


def _mean_weights(before: FloatArray, now: FloatArray, same: NDArray[np.bool_], share: float) -> FloatArray:
    """Running means of the log weights of the posterior's modes (k,), shape (k,).

    A valley has many minima, and each search finds different ones. Means are therefore taken over families of modes
    that are one, and a family's mass is divided among its modes as in this posterior: no mass is lost on a minimum that
    held hardly any. Means of logarithms adapt at once where the evidence is clear. Modes that the filter does not
    have keep their present probability.

    Args:
        before: log weights of the filter's modes, shape (n,).
        now: log weights of the posterior's modes, shape (k,).
        same: which of the latter is which of the former, shape (k, n).
        share: weight of `now` in the mean.
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
    """Which of the posterior's k modes are which of the filter's n, by either's covariance, shape (2, k, n)."""
    images = compose(modes.X_PO[:, None], model.symmetry_poses[None])
    u = increments_between(X_PO[:, None, None], images[None])
    theirs = np.repeat(modes.covariance[:, None], images.shape[1], axis=1)
    if images.shape[1] > 1:
        J = increments_of_images(modes.X_PO[:, None], images)
        theirs = J @ theirs @ np.swapaxes(J, 2, 3)
    of_images = inverses(theirs.reshape(-1, 6, 6))[0].reshape(theirs.shape)
    spreads = inverses(covariance)[0][:, None, None], of_images[None]
    distances = [np.einsum("jmsi,jmsik,jmsk->jms", u, information, u).min(axis=2) for information in spreads]
    return np.asarray(np.stack(distances) < params.mixture.same_sigmas**2)


def _match(cost: FloatArray, same: NDArray[np.bool_], stays: NDArray[np.bool_]) -> NDArray[np.intp]:
    """The filter's mode that each of the posterior's k modes is and whose pose it keeps, or -1, shape (k,).

    Args:
        cost: of the filter's modes, shape (n,).
        same: which of these each is, shape (k, n).
        stays: which of these explain the touch as well, and are within their own covariance of it, shape (k, n): a mode
            that is surer than the touch may stand at a valley's end.
    """
    pairs, free = np.full(len(same), -1), np.ones(len(cost), dtype=np.bool_)
    for j in range(len(same)):
        alike = np.flatnonzero(free & same[j])
        if len(alike):
            i = int(alike[np.argmin(cost[alike])])
            free[i], pairs[j] = False, i if stays[j, i] else -1
    return pairs
