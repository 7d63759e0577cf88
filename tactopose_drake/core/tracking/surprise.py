"""Whether the touch still is what a mode predicts: two tests over the last frames, which fade away.

The misfit test asks whether innovations are larger than noise makes them: their squared lengths less what is expected,
summed, in units of the sum's standard deviation. The drift test asks whether corrections go one way: with a prediction
of covariance P- and an update to P+, a correction has the covariance P- - P+ and is independent of the next, so the
squared length of their sum is chi-square with six degrees of freedom at most. Slow slip hides from the first test and
shows in the second.
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
_MISFIT, _DRIFT = 6.0, 6.0


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
        misfit=before.misfit * [_FADE, _FADE**2]
        + np.stack([update.misfit - degrees, np.full(len(before), 2.0 * degrees)], axis=1),
        drift=_FADE * before.drift + correction,
        drift_covariance=_FADE**2 * before.drift_covariance + (1.0 + _WANDER) * before.covariance - update.covariance,
    )


def is_surprised(modes: ModeSet) -> NDArray[np.bool_]:
    """Which of the modes the touch contradicts, shape (n,)."""
    misfit = modes.misfit[:, 0] / np.sqrt(np.maximum(modes.misfit[:, 1], 1.0))
    # By the mode's own covariance: of that each frame's wandering is the least which is expected, also where a turn of
    # the tangent space from frame to frame seems to take it away.
    unit = np.linalg.inv(np.linalg.cholesky(modes.covariance))
    values, vectors = np.linalg.eigh(unit @ modes.drift_covariance @ np.swapaxes(unit, 1, 2))
    along = np.einsum("nij,nik,nk->nj", vectors, unit, modes.drift)
    values = np.maximum(values, _WANDER)
    surprised: NDArray[np.bool_] = (misfit > _MISFIT) | (np.sum(along**2 / values, axis=1) > _DRIFT)
    return surprised


def calmed(modes: ModeSet) -> ModeSet:
    """The modes without what surprised them."""
    return dataclasses.replace(
        modes,
        misfit=np.zeros_like(modes.misfit),
        drift=np.zeros_like(modes.drift),
        drift_covariance=np.zeros_like(modes.drift_covariance),
    )
