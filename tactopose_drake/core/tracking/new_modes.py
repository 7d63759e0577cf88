"""New modes from the search: where else may the object be, by the touch of this instant?

A new mode is one minimum of a wide Gaussian with the touch, just as an old one is of its prediction with the touch; so
the masses of both compare. That an object is suddenly elsewhere has a small prior probability, which the caller gives.
"""

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.evidence.evidence import Evidence
from tactopose_drake.core.poses import retract
from tactopose_drake.core.posterior.hypotheses import find_modes
from tactopose_drake.core.posterior.plausibility import explain_touch
from tactopose_drake.core.searches.pair_search import PairSearch
from tactopose_drake.core.searches.patch_searches import patch_search
from tactopose_drake.core.searches.pose_problem import make_problem
from tactopose_drake.core.shape.free_spin import turn_toward
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.tracking.contact_update import Stable, update_with_contacts
from tactopose_drake.core.tracking.mode_set import ModeSet
from tactopose_drake.core.tracking.pose_measurement import PoseMeasurement
from tactopose_drake.core.validation import FloatArray

# A turn moves the surface as far as it does at this share of the object's size from O.
_ARM = 0.25
# Of a wide mode both sides are tried, so many standard deviations away.
_BESIDE = 1.5


def find_new_modes(
    model: ObjectModel,
    evidence: Evidence,
    near: PoseMeasurement | None,
    source: NDArray[np.intp],
    num_sources: int,
    stable: Stable,
    count: int,
    generator: np.random.Generator,
) -> ModeSet:
    """Modes that explain the touch, weighed among themselves and against predictions by the same touch.

    Args:
        model: the object.
        evidence: the touch and what bounds the pose; a prior in it is left out.
        near: where to look, as a Gaussian; None for anywhere.
        source: the source of each contact.
        num_sources: how many there are.
        stable: of what the biases are.
        count: how many modes, at the most.
        generator: of the search's random numbers.
    """
    evidence = dataclasses.replace(evidence, prior=None if near is None else near.as_prior())
    problem = make_problem(model, evidence)
    search = patch_search(model, evidence.felt, evidence.contacts) if evidence.felt else None
    found = (search or PairSearch(model=model, contacts=evidence.contacts)).minimize(
        problem.objective, problem.space, generator
    )
    X_found = found.X_PO
    if near is None:
        X_found = turn_toward(X_found, X_found[0], model.symmetries)
        found = found._replace(X_PO=X_found, cost=problem.objective.cost(X_found)).ranked()
    modes = find_modes(
        found,
        problem.determining.normal_equations(found.X_PO).hessian,
        problem.space.information,
        model.symmetry_poses,
        model.size,
        count,
    )
    X_start = modes.X_PO[explain_touch(model, evidence, modes.X_PO)]
    if not len(X_start):
        return ModeSet.empty(num_sources)

    spread = np.asarray(np.linalg.inv(problem.space.information), dtype=np.float64)
    prior: PoseMeasurement | FloatArray = spread if near is None else near

    def update(X_start: FloatArray) -> ModeSet:
        return _update(model, evidence.touch, source, num_sources, stable, prior, X_start)

    found_modes = update(X_start)
    beside = _beside(found_modes.X_PO, found_modes.covariance, model.size)
    all_modes = update(np.concatenate([found_modes.X_PO, beside]))
    return all_modes.chosen(np.argsort(-all_modes.log_weight, kind="stable")).distinct(model.symmetry_poses)


def _update(
    model: ObjectModel,
    contacts: Contacts,
    source: NDArray[np.intp],
    num_sources: int,
    stable: Stable,
    prior: PoseMeasurement | FloatArray,
    X_start: FloatArray,
) -> ModeSet:
    """Modes near poses (n, 3, 4): of the touch with a prior, or about each pose with its covariance (6, 6)."""
    n = len(X_start)
    if isinstance(prior, PoseMeasurement):
        X_prior, covariance = np.tile(prior.X_PO, (n, 1, 1)), np.tile(prior.covariance, (n, 1, 1))
    else:
        X_prior, covariance = X_start, np.tile(prior, (n, 1, 1))
    cross = np.zeros((n, 6, 6 * num_sources))
    # How rough the surface is where they touch is known once they have been there.
    roughness = np.zeros((n, num_sources, 2))
    first = update_with_contacts(model, contacts, source, stable, X_prior, covariance, cross, roughness, X_start)
    roughness[:, source] = first.roughness
    update = update_with_contacts(model, contacts, source, stable, X_prior, covariance, cross, roughness, X_start)
    log_touch = -0.5 * update.misfit
    modes = ModeSet.make(
        update.X_PO, update.covariance, update.cross, roughness, update.log_evidence - log_touch, log_touch
    )
    return dataclasses.replace(modes, frames=np.ones(n))


def _beside(X_PO: FloatArray, covariance: FloatArray, size: float) -> FloatArray:
    """Poses (4 n, 3, 4) at both sides of modes, along the two directions in which each is widest.

    A wide mode may hide others, which the search found alike or not at all.
    """
    scale = np.repeat([_ARM * size, 1.0], 3)
    variances, axes = np.linalg.eigh(covariance * scale[:, None] * scale)
    steps = (_BESIDE * np.sqrt(variances)[:, None, :] * axes / scale[:, None])[:, :, -2:]
    increments = np.concatenate([steps, -steps], axis=2).transpose(2, 0, 1)
    return np.concatenate([retract(X_PO, increment) for increment in increments])


def around(X_PO: FloatArray, sigma_translation: float, sigma_rotation: float, time: float) -> PoseMeasurement:
    """A Gaussian about a pose, m and rad."""
    return PoseMeasurement(time, X_PO, np.diag(np.repeat([sigma_rotation**2, sigma_translation**2], 3)))


SLIPPED = 0.012, math.radians(15.0)
"""How far an object has slipped when the touch first contradicts its prediction: standard deviations, m and rad."""
