"""Whether the touch still is what a mode predicts: two tests over the last frames, which fade away.

The misfit test asks whether innovations are larger than noise makes them: their squared lengths less what is expected,
summed, in units of the sum's standard deviation. The drift test asks whether corrections go one way: with a prediction
of covariance P- and an update to P+, a correction has the covariance P- - P+ and is independent of the next, so the
squared length of their sum is chi-square with six degrees of freedom at most. Slow slip hides from the first test and
shows in the second.

The evidence of frames that follow each other is in part the same, as their errors are. Where a share s of a variance
B + R = B / s stays, N frames together are worth no more than (B + R) / B = 1 / s of them: their mean has the variance
B + R / N. Therefore what the touch says for a mode fades by the share s a frame.
"""

import dataclasses

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.poses import increments_between
from tactopose_drake.core.tracking.contact_update import ContactUpdate
from tactopose_drake.core.tracking.mode_set import ModeSet

# What is left after one frame of the sums: half of them is of the last seven frames.
_FADE = 0.9
# The pose also wanders, where the touch tells nothing: a frame adds so much of its variance.
_WANDER = 0.1
# The misfit of so many standard deviations, and the squared drift, that say that the object slips. Motion noise is
# stated wider than it is, so the drift of an object that is held is far below six on average.
_MISFIT, _DRIFT = 6.0, 8.0


def watch(before: ModeSet, update: ContactUpdate, degrees: int) -> ModeSet:
    """The modes after an update, with their sums.

    Args:
        before: the predicted modes.
        update: theirs, by contacts.
        degrees: how many numbers these measured.
    """
    correction = increments_between(before.X_PO, update.X_PO)
    return dataclasses.replace(
        before,
        X_PO=update.X_PO,
        covariance=update.covariance,
        cross=update.cross,
        log_touch=(1.0 - update.stays) * before.log_touch + update.log_evidence,
        misfit=before.misfit * [_FADE, _FADE**2]
        + np.stack([update.misfit - degrees, np.full(len(before), 2.0 * degrees)], axis=1),
        drift=_FADE * before.drift + correction,
        drift_covariance=_FADE**2 * before.drift_covariance + (1.0 + _WANDER) * before.covariance - update.covariance,
    )


def is_surprised(modes: ModeSet) -> NDArray[np.bool_]:
    """Which of the modes the touch contradicts, shape (n,)."""
    misfit = modes.misfit[:, 0] / np.sqrt(np.maximum(modes.misfit[:, 1], 1.0))
    values, vectors = np.linalg.eigh(modes.drift_covariance)
    # Where next to nothing was to be corrected, only rounding was.
    values = np.maximum(values, np.array([1e-12]))
    along = np.einsum("nij,ni->nj", vectors, modes.drift)
    surprised: NDArray[np.bool_] = (misfit > _MISFIT) | (np.sum(along**2 / values, axis=1) > _DRIFT)
    return surprised


def calmed(modes: ModeSet) -> ModeSet:
    """The modes without what surprised them."""
    return ModeSet.make(modes.X_PO, modes.covariance, modes.cross, modes.roughness, modes.log_prior, modes.log_touch)
