"""Relocalisation: the one-shot posterior runs beside the filter, and its modes and the filter's compete by evidence.

A mode's weight is what the one-shot estimate gives it by the touch of now, and what it would have had by the touches of
the window. What it was worth before has no part in that: so one that was led astray, and since then only foretells what
it is itself led by, loses against one that explains the touch better, whenever that is found. Of each mode of the
posterior that the filter has already, the filter's pose stays, which has learnt from many frames, unless the window
contradicts it.
"""

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.evidence.evidence import Evidence
from tactopose_drake.core.kernels.matrix_kernels import inverses
from tactopose_drake.core.objectives.surface_contact import SurfaceContact
from tactopose_drake.core.poses import compose, increments_between
from tactopose_drake.core.posterior.hypotheses import Modes
from tactopose_drake.core.searches.pose_problem import make_problem
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.tracking.contact_update import update_with_contacts
from tactopose_drake.core.tracking.frame import ContactReading, PoseMeasurement
from tactopose_drake.core.tracking.keyframes import TouchWindow
from tactopose_drake.core.tracking.one_shot_posterior import SearchSlice, one_shot_posterior
from tactopose_drake.core.tracking.tracked_modes import TrackedModes
from tactopose_drake.core.tracking.tracker_params import PoseTrackerParams
from tactopose_drake.core.validation import FloatArray


def relocalise(
    model: ObjectModel,
    params: PoseTrackerParams,
    evidence: Evidence,
    reading: ContactReading,
    window: TouchWindow,
    modes: TrackedModes,
    standing: PoseMeasurement | None,
    searches: int,
) -> TrackedModes:
    """The modes of the posterior by the window, by falling weight; none where no pose explains the touch.

    Args:
        model: the object.
        params: what is assumed.
        evidence: of now.
        reading: its touch by sources.
        window: the touches by which poses are judged.
        modes: the filter's, after the touch.
        standing: what vision said, as of now.
        searches: how many slices there were.
    """
    prior = None if standing is None else standing.as_prior()
    contacts = window.now if len(evidence.contacts) == len(window.now) else evidence.contacts
    evidence = dataclasses.replace(evidence, contacts=_with_forces(contacts, evidence.contacts), prior=prior)
    near = evidence
    if searches % 2:
        near = dataclasses.replace(evidence, prior=None)
    search = SearchSlice(near, modes.X_PO, np.random.default_rng([params.seed, searches]))
    posterior = one_shot_posterior(model, params, evidence, search)
    if posterior is None:
        return modes
    X_PO, weights = posterior.mixture.X_PO, posterior.mixture.weights
    log_weight = np.log(np.maximum(weights, 1e-300)) - past_cost(model, params, window, X_PO)
    kept = np.flatnonzero(log_weight > log_weight.max() + math.log(params.mixture.least_share))
    kept = kept[np.argsort(-log_weight[kept], kind="stable")][: params.mixture.max_modes]
    joined = _match(model, params, evidence, reading, posterior, kept, modes, standing)
    return dataclasses.replace(joined, log_weight=log_weight[kept])


def past_cost(model: ObjectModel, params: PoseTrackerParams, window: TouchWindow, X_PO: FloatArray) -> FloatArray:
    """The cost of poses (n, 3, 4) by the touches of the past, shape (n,).

    One of them may be of before a slip that nobody noticed: each is a mixture of what it says and of saying nothing.
    The hand's calibration is the same at all times: of so many touches each counts by the effective sample size.
    """
    if window.count == 1:
        return np.zeros(len(X_PO))
    touch = SurfaceContact(model.grid, window.contacts)
    residuals = touch.residuals(np.ascontiguousarray(X_PO)).reshape(len(X_PO), len(window.contacts), -1)
    costs = np.zeros((window.count, len(X_PO)))
    np.add.at(costs, window.keyframe, 0.5 * np.square(residuals).sum(axis=2).T)
    numbers = np.bincount(window.keyframe) * (1 if window.contacts.n_PC is None else 3)
    limits = 0.5 * numbers - math.log(params.window.slip_probability)
    share = 1.0 / (1.0 + (window.count - 1) * params.window.lasting_share)
    total: FloatArray = share * np.minimum(costs, limits[:, None])[1:].sum(axis=0)
    return total


def _match(
    model: ObjectModel,
    params: PoseTrackerParams,
    evidence: Evidence,
    reading: ContactReading,
    posterior: Modes,
    kept: NDArray[np.intp],
    modes: TrackedModes,
    standing: PoseMeasurement | None,
) -> TrackedModes:
    """For each of the posterior's modes that are kept the filter's that it is, or a new one."""
    X_PO, information = posterior.mixture.X_PO[kept], inverses(posterior.mixture.covariance[kept])[0]
    new = _make_modes(model, params, reading, standing, X_PO).widened(posterior.mixture.covariance[kept])
    if not len(modes):
        return new
    problem = make_problem(model, evidence)
    cost = problem.objective.cost(np.ascontiguousarray(modes.X_PO))
    least = problem.objective.cost(np.ascontiguousarray(X_PO))
    images = compose(modes.X_PO[:, None], model.symmetry_poses[None])
    chosen: list[TrackedModes] = []
    free = np.ones(len(modes), dtype=np.bool_)
    for j in range(len(kept)):
        u = increments_between(X_PO[j], images.reshape(-1, 3, 4)).reshape(*images.shape[:2], 6)
        distance = np.einsum("msi,ij,msj->ms", u, information[j], u).min(axis=1)
        same = np.flatnonzero(free & (distance < params.mixture.same_sigmas**2))
        if not len(same):
            chosen.append(new.chosen([j]))
            continue
        i = int(same[np.argmin(cost[same])])
        free[i] = False
        if cost[i] < least[j] + params.relocalisation.least_gain:
            chosen.append(modes.chosen([i]))
        else:
            chosen.append(new.chosen([j]).after(modes.chosen([i])))
    joined = chosen[0]
    for other in chosen[1:]:
        joined = joined.joined(other)
    return joined


def _with_forces(contacts: Contacts, measured: Contacts) -> Contacts:
    """Contacts with the forces of now."""
    return dataclasses.replace(contacts, f_PC=measured.f_PC, sigma_force=measured.sigma_force)


def _make_modes(
    model: ObjectModel,
    params: PoseTrackerParams,
    reading: ContactReading,
    near: PoseMeasurement | None,
    X_start: FloatArray,
) -> TrackedModes:
    """Modes at poses (n, 3, 4), of which all is known by the touch and what vision said."""
    n = len(X_start)
    if near is None:
        problem = make_problem(model, Evidence(reading.contacts))
        spread = np.asarray(np.linalg.inv(problem.space.information), dtype=np.float64)
        priors = TrackedModes.independent(X_start, np.tile(spread, (n, 1, 1)), len(reading.sources))
    else:
        X_PO, covariance = np.tile(near.X_PO, (n, 1, 1)), np.tile(near.covariance, (n, 1, 1))
        priors = TrackedModes.independent(X_PO, covariance, len(reading.sources))
    # How rough the surface is where they touch is known once they have been there.
    roughness = np.zeros_like(priors.roughness)
    first = update_with_contacts(model, params, reading, priors, X_start)
    roughness[:, reading.source] = first.roughness
    priors = dataclasses.replace(priors, roughness=roughness)
    update = update_with_contacts(model, params, reading, priors, X_start)
    return dataclasses.replace(
        priors, X_PO=X_start, covariance=update.covariance, cross_covariance=update.cross_covariance
    )
