"""Relocalisation: where the modes may be that a belief lacks, the search for them, and how probable they are.

Either the object jumped, or the belief was wrong all along: too sure of its best mode, or without the right one from
the start. What jumped may be anywhere within the Gaussian in which is searched, and a mode that foretold the touch is
rightly far more probable. A belief that was wrong has no right to that: what is found is then weighed among itself.

A proposed mode is one minimum of a wide Gaussian with the touch of this instant, just as an old one is of its
prediction with the touch; so the masses of both compare. That an object is suddenly elsewhere has a small prior
probability.
"""

import dataclasses
import math
from typing import NamedTuple

import numpy as np

from tactopose_drake.core.evidence.evidence import Evidence
from tactopose_drake.core.evidence.gaussian_prior import GaussianPrior
from tactopose_drake.core.poses import retract
from tactopose_drake.core.posterior.hypotheses import find_modes
from tactopose_drake.core.posterior.plausibility import explain_touch
from tactopose_drake.core.searches.pair_search import PairSearch
from tactopose_drake.core.searches.patch_searches import patch_search
from tactopose_drake.core.searches.pose_problem import make_problem
from tactopose_drake.core.shape.free_spin import turn_toward
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.tracking.contact_update import update_with_contacts
from tactopose_drake.core.tracking.frame import ContactReading, PoseMeasurement
from tactopose_drake.core.tracking.measurement_update import MeasurementUpdate
from tactopose_drake.core.tracking.pose_belief import PoseBelief
from tactopose_drake.core.tracking.tracked_modes import TrackedModes
from tactopose_drake.core.tracking.tracker_params import PoseTrackerParams, RelocalisationParams
from tactopose_drake.core.validation import FloatArray


class SearchRegion(NamedTuple):
    """Where modes are searched for.

    Attributes:
        near: a Gaussian; None for anywhere.
        probability: that the object is there and no mode has it, a priori.
        jumped: whether it would have jumped there; otherwise the belief was wrong.
    """

    near: PoseMeasurement | None
    probability: float
    jumped: bool


def choose_region(
    belief: PoseBelief,
    modes: TrackedModes,
    vision: PoseMeasurement | None,
    prior: GaussianPrior | None,
    params: PoseTrackerParams,
    *,
    is_urgent: bool,
) -> SearchRegion:
    """Where vision or a prior says, near the best mode, or anywhere.

    Args:
        belief: as of now, but for the touch.
        modes: after the touch, by falling weight.
        vision: what it says now.
        prior: of a belief that has no pose yet.
        params: what is assumed.
        is_urgent: whether the modes do not explain the touch or contradict it.
    """
    near, time, settings = vision, belief.time, params.relocalisation
    if near is None:
        local_time = settings.local_share * params.lost_time
        if not len(modes):
            near = None if prior is None else PoseMeasurement.from_prior(prior, time)
        elif time > belief.touch_time + params.lost_time:
            near = PoseMeasurement(time, belief.modes.X_PO[0], belief.modes.covariance[0])
        # It slips before it is anywhere: that is asked when near the best there is no explanation.
        elif time < belief.explained_time + local_time if is_urgent else belief.searches % settings.global_interval > 0:
            near = _slipped(modes.X_PO[0], time, settings)
    if near is None:
        return SearchRegion(None, settings.unnoticed_jump_probability, True)
    jumped = is_urgent or vision is not None
    return SearchRegion(near, settings.jump_probability if jumped else settings.wrong_probability, jumped)


def _slipped(X_PO: FloatArray, time: float, settings: RelocalisationParams) -> PoseMeasurement:
    """The Gaussian about a pose in which an object is that has slipped."""
    variances = math.radians(settings.sigma_rotation_deg) ** 2, settings.sigma_translation**2
    return PoseMeasurement(time, X_PO, np.diag(np.repeat(variances, 3)))


def propose_modes(
    model: ObjectModel,
    params: PoseTrackerParams,
    evidence: Evidence,
    reading: ContactReading,
    near: PoseMeasurement | None,
    generator: np.random.Generator,
) -> TrackedModes:
    """Modes that explain the touch, weighed among themselves and against predictions by the same touch.

    Args:
        model: the object.
        params: what is assumed.
        evidence: the touch and what bounds the pose; a prior in it is left out.
        reading: the touch by its sources.
        near: where to search, as a Gaussian; None for anywhere.
        generator: of the search's random numbers.
    """
    evidence = dataclasses.replace(evidence, prior=None if near is None else near.as_prior())
    problem = make_problem(model, evidence)
    search = patch_search(model, evidence.felt, evidence.contacts) if evidence.felt else None
    found = (search or PairSearch(model=model, contacts=evidence.contacts)).minimize(
        problem.objective, problem.space, generator
    )
    if near is None:
        X_found = turn_toward(found.X_PO, found.X_PO[0], model.symmetries)
        found = found._replace(X_PO=X_found, cost=problem.objective.cost(X_found)).ranked()
    modes = find_modes(
        found,
        problem.determining.normal_equations(found.X_PO).hessian,
        problem.space.information,
        model.symmetry_poses,
        model.size,
        params.mixture.max_modes,
    )
    X_start = modes.mixture.X_PO[explain_touch(model, evidence, modes.mixture.X_PO, params.plausibility)]
    if not len(X_start):
        return TrackedModes.empty(len(reading.sources))

    spread = np.asarray(np.linalg.inv(problem.space.information), dtype=np.float64)
    first = _refine_proposals(model, params, reading, _wide_priors(X_start, near, spread, reading), X_start)
    X_start = np.concatenate([first.X_PO, _beside(first, params, model.size)])
    proposed = _refine_proposals(model, params, reading, _wide_priors(X_start, near, spread, reading), X_start)
    ranked = proposed.chosen(np.argsort(-proposed.log_weight, kind="stable"))
    return ranked.distinct(model.symmetry_poses, params.mixture.same_sigmas)


def _wide_priors(
    X_start: FloatArray, near: PoseMeasurement | None, spread: FloatArray, reading: ContactReading
) -> TrackedModes:
    """The Gaussian in which is searched, once for each start (n, 3, 4); or about each start one of a spread (6, 6)."""
    n = len(X_start)
    if near is None:
        return TrackedModes.independent(X_start, np.tile(spread, (n, 1, 1)), len(reading.sources))
    X_PO, covariance = np.tile(near.X_PO, (n, 1, 1)), np.tile(near.covariance, (n, 1, 1))
    return TrackedModes.independent(X_PO, covariance, len(reading.sources))


def _refine_proposals(
    model: ObjectModel,
    params: PoseTrackerParams,
    reading: ContactReading,
    priors: TrackedModes,
    X_start: FloatArray,
) -> TrackedModes:
    """Modes near poses (n, 3, 4), of the touch with their priors."""
    # How rough the surface is where they touch is known once they have been there.
    roughness = np.zeros_like(priors.roughness)
    first = update_with_contacts(model, params, reading, priors, X_start)
    roughness[:, reading.source] = first.roughness
    priors = dataclasses.replace(priors, roughness=roughness)
    update = update_with_contacts(model, params, reading, priors, X_start)
    log_likelihood = -0.5 * update.nis
    return dataclasses.replace(
        priors,
        X_PO=update.X_PO,
        covariance=update.covariance,
        cross_covariance=update.cross_covariance,
        log_prior=update.log_likelihood - log_likelihood,
        log_likelihood=log_likelihood,
        frames=np.ones(len(priors)),
    )


def _beside(modes: TrackedModes, params: PoseTrackerParams, size: float) -> FloatArray:
    """Poses (4 n, 3, 4) at both sides of modes, along the two directions in which each is widest.

    A wide mode may hide others, which the search found alike or not at all.
    """
    scale = np.repeat([params.lever_arm * size, 1.0], 3)
    variances, axes = np.linalg.eigh(modes.covariance * scale[:, None] * scale)
    out = params.relocalisation.beside_sigmas
    steps = (out * np.sqrt(variances)[:, None, :] * axes / scale[:, None])[:, :, -2:]
    increments = np.concatenate([steps, -steps], axis=2).transpose(2, 0, 1)
    return np.concatenate([retract(modes.X_PO, increment) for increment in increments])


def add_proposals(update: MeasurementUpdate, proposed: TrackedModes, region: SearchRegion) -> TrackedModes:
    """The modes and those that were proposed by the same touch, with what the best has felt before.

    Args:
        update: the modes after the touch.
        proposed: those of a search.
        region: where it was, and how probable it is that the object is there and no mode has it.
    """
    if not len(proposed):
        return update.modes
    log_likelihood = update.log_likelihood if region.jumped else np.logaddexp.reduce(proposed.log_weight)
    total = np.logaddexp.reduce(update.modes.log_weight) + math.log(region.probability)
    weight = total + proposed.log_weight - log_likelihood
    log_touch = update.log_before + update.frame_weight * proposed.log_likelihood
    frames = np.full(len(proposed), update.modes.frames[0])
    proposed = dataclasses.replace(proposed, log_prior=weight - log_touch, log_likelihood=log_touch, frames=frames)
    return update.modes.joined(proposed)
