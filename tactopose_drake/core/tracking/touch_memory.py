"""For how long the touch is remembered: of the pose, and of which mode is right.

Errors of a contact last: the hand's calibration, and what the surface does about the contact beside its slope. The
first are the biases of `contact_update`, the second's part that the regression sees adds to their variances. What it
does not see, because a mode that is narrow sees little of the surface, is counted at each frame anew, and a mode that
learns from it grows sure of a pose beside the truth. Therefore what the touch told of the pose fades.

Which mode is right is asked by the mean of what frames say. Where a share s of a variance B + R = B / s stays, N frames
together have the variance B + R / N: they are worth N / (1 + (N - 1) s) frames. A sum of so many, the latest, has the
same expectation but all of their noise.
"""

import dataclasses

import numpy as np

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.objectives.surface_contact import SurfaceContact
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.tracking.mode_set import ModeSet
from tactopose_drake.core.validation import FloatArray

# So many frames make up the mean: about as many as it takes until a fingertip is elsewhere on the surface.
_FRAMES = 50.0
# A direction fades by half of the share where a frame tells of it this part of what is known: where the touch was all
# that told of it, a frame tells about the share that stays, some three tenths.
_HALF = 0.1


def fade(model: ObjectModel, contacts: Contacts, modes: ModeSet, share: float) -> ModeSet:
    """The modes before an update, wider in the directions of which the touch tells.

    Args:
        model: the object.
        contacts: the touch, by which what a frame tells is measured.
        modes: as they are predicted.
        share: of the variance, by which a direction that only the touch determines grows.
    """
    told = SurfaceContact(model.grid, contacts).normal_equations(np.ascontiguousarray(modes.X_PO)).hessian
    root = np.linalg.cholesky(modes.covariance)
    values, vectors = np.linalg.eigh(np.swapaxes(root, 1, 2) @ told @ root)
    axes = root @ vectors
    growth = share * values / (values + _HALF)
    covariance = modes.covariance + (axes * growth[:, None]) @ np.swapaxes(axes, 1, 2)
    return dataclasses.replace(modes, covariance=covariance)


def remember(modes: ModeSet, log_evidence: FloatArray, stays: float) -> ModeSet:
    """The modes with what a frame says for each, shape (n,), where a share of the contacts' variances stays."""
    frames = np.minimum(modes.frames + 1.0, _FRAMES)
    mean = modes.log_touch / _worth(np.maximum(modes.frames, 1.0), stays)
    log_touch = _worth(frames, stays) * (mean + (log_evidence - mean) / frames)
    return dataclasses.replace(modes, log_touch=log_touch, frames=frames)


def worth_of_a_frame(modes: ModeSet, stays: float) -> FloatArray:
    """By how much the latest frame's evidence is in the modes' weights, shape (n,)."""
    return _worth(modes.frames, stays) / modes.frames


def _worth(frames: FloatArray, stays: float) -> FloatArray:
    worth: FloatArray = frames / (1.0 + (frames - 1.0) * stays)
    return worth
