"""The measurement update of the mixture by one frame's contacts: poses, weights, and whether they are consistent.

Errors of a contact last: the hand's calibration, and what the surface does about the contact beside its slope. The
first are the biases of `contact_update`, the second's part that the regression sees adds to their variances. What it
does not see, because a mode that is narrow sees little of the surface, is counted at each frame anew, and a mode that
learns from it grows sure of a pose beside the truth. Therefore what the touch told of the pose is forgotten, by a
factor for each direction, as in directional forgetting [K87].

Which mode is right is asked by the mean of what frames say. Where a share s of a variance B + R = B / s stays, N frames
together have the variance B + R / N: their effective sample size, as of N draws of which any two have the correlation
s, is N / (1 + (N - 1) s). A sum of so many, the latest, has the same expectation but all of their noise.

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
        modes: by falling weight.
        is_inconsistent: whether the touch contradicts the best.
        log_likelihood: of the touch by all of them together.
        log_before: of the best mode's `log_likelihood` the part that is of earlier frames.
        frame_weight: by how much this frame's likelihood is in the modes' weights.
    """

    modes: TrackedModes
    is_inconsistent: bool
    log_likelihood: float
    log_before: float
    frame_weight: float


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
    log_likelihood = float(np.logaddexp.reduce(modes.log_weight + update.log_likelihood))
    modes = record_innovations(modes, update, degrees_of_freedom(reading.contacts), params.consistency)
    modes = average_likelihood(modes, update.log_likelihood, update.lasting_share, params.forgetting.evidence_frames)
    modes = follow_roughness(modes, reading, update.roughness, params)
    order = np.argsort(-modes.log_weight, kind="stable")
    modes = modes.chosen(order)
    frame_weight = float(weight_of_a_frame(modes, update.lasting_share)[0])
    before = float(modes.log_likelihood[0] - frame_weight * update.log_likelihood[order[0]])
    inconsistent = bool(are_inconsistent(modes.chosen([0]), params.consistency)[0])
    if inconsistent:
        modes = restart_test(modes)
    return MeasurementUpdate(modes, inconsistent, log_likelihood, before, frame_weight)


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


def average_likelihood(
    modes: TrackedModes, log_likelihood: FloatArray, lasting_share: float, max_frames: float
) -> TrackedModes:
    """The modes with what one more frame says.

    Args:
        modes: before.
        log_likelihood: of the frame by each, shape (n,).
        lasting_share: of the contacts' variances, which is the same at all times.
        max_frames: the mean is over so many, at the most.
    """
    frames = np.minimum(modes.frames + 1.0, max_frames)
    mean = modes.log_likelihood / effective_frames(np.maximum(modes.frames, 1.0), lasting_share)
    total = effective_frames(frames, lasting_share) * (mean + (log_likelihood - mean) / frames)
    return dataclasses.replace(modes, log_likelihood=total, frames=frames)


def weight_of_a_frame(modes: TrackedModes, lasting_share: float) -> FloatArray:
    """By how much the latest frame's likelihood is in the modes' weights, shape (n,)."""
    return effective_frames(modes.frames, lasting_share) / modes.frames


def effective_frames(frames: FloatArray, lasting_share: float) -> FloatArray:
    """The effective sample size of frames of whose variance a share lasts."""
    effective: FloatArray = frames / (1.0 + (frames - 1.0) * lasting_share)
    return effective


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
