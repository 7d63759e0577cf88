"""The measurement update of the modes by one frame's contacts: poses, covariances, and whether they are consistent.

Errors of a contact last: the hand's calibration, and what the surface does about the contact beside its slope. The
first are the biases of `contact_update`, the second's part that the regression sees adds to their variances. What it
does not see, because a mode that is narrow sees little of the surface, is counted at each frame anew, and a mode that
learns from it grows sure of a pose beside the truth. Therefore what the touch told of the pose is forgotten, by a
factor for each direction, as in directional forgetting [K87].

Source: [K87] R. Kulhavy, Restricted exponential forgetting in real-time identification, Automatica, 1987.
"""

import dataclasses
from typing import NamedTuple

import numpy as np

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.objectives.surface_contact import SurfaceContact
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.tracking.consistency import are_inconsistent, record_innovations, restart_test
from tactopose_drake.core.tracking.contact_update import BiasModel, degrees_of_freedom, update_with_contacts
from tactopose_drake.core.tracking.frame import ContactReading
from tactopose_drake.core.tracking.tracked_modes import TrackedModes
from tactopose_drake.core.tracking.tracker_params import PoseTrackerParams
from tactopose_drake.core.validation import FloatArray


class MeasurementUpdate(NamedTuple):
    """Modes, at least one, after a frame's contacts.

    Attributes:
        modes: in the order that they had.
        is_inconsistent: whether the touch contradicts the first.
    """

    modes: TrackedModes
    is_inconsistent: bool


def update_modes(
    model: ObjectModel, params: PoseTrackerParams, reading: ContactReading, modes: TrackedModes, duration: float
) -> MeasurementUpdate:
    """Updates modes, at least one, with a frame's contacts.

    Args:
        model: the object.
        params: what is assumed.
        reading: what is touched.
        modes: as they are predicted.
        duration: since the last frame, s.
    """
    forgotten = min(1.0, duration / params.forgetting.time)
    modes = forget(model, reading.contacts, modes, forgotten, params.forgetting.half_information)
    update = update_with_contacts(model, params, reading, modes)
    modes = record_innovations(modes, update, degrees_of_freedom(reading.contacts), params.consistency)
    modes = follow_roughness(modes, reading, update.roughness, params)
    inconsistent = bool(are_inconsistent(modes.chosen([0]), params.consistency)[0])
    if inconsistent:
        modes = restart_test(modes, np.ones(len(modes), dtype=np.bool_))
    return MeasurementUpdate(modes, inconsistent)


def forget(
    model: ObjectModel, contacts: Contacts, modes: TrackedModes, forgotten: float, half_information: float
) -> TrackedModes:
    """The modes before an update, wider in the directions of which the touch tells.

    Args:
        model: the object.
        contacts: the touch, by which what a frame tells is measured.
        modes: as they are predicted.
        forgotten: the share of its variance by which a direction that only the touch determines grows.
        half_information: of a frame over what is known of a direction; then it grows by half of that.
    """
    information = SurfaceContact(model.grid, contacts).normal_equations(np.ascontiguousarray(modes.X_PO)).hessian
    root = np.linalg.cholesky(modes.covariance)
    values, vectors = np.linalg.eigh(np.swapaxes(root, 1, 2) @ information @ root)
    axes = root @ vectors
    growth = forgotten * values / (values + half_information)
    covariance = modes.covariance + (axes * growth[:, None]) @ np.swapaxes(axes, 1, 2)
    return dataclasses.replace(modes, covariance=covariance)


def follow_roughness(
    modes: TrackedModes, reading: ContactReading, roughness: FloatArray, params: PoseTrackerParams
) -> TrackedModes:
    """The modes when some sources (k,) touch a surface of this roughness (n, k, 2).

    A bias is the sum of the hand's and the surface's. Where the latter's variance grows, the pose knows nothing of what
    is added. Where the sum's falls from T to t, of the bias a share t / T is expected to be left.
    """
    variances = BiasModel.from_params(params).variances
    after = modes.roughness.copy()
    after[:, reading.source] += params.contact_update.roughness_gain * (roughness - after[:, reading.source])
    left = np.minimum(1.0, (variances + after) / (variances + modes.roughness))
    cross = modes.cross_covariance * np.repeat(left, 3, axis=2).reshape(len(modes), 1, -1)
    return dataclasses.replace(modes, cross_covariance=cross, roughness=after)
