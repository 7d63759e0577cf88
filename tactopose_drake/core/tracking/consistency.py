"""The consistency test of a mode: whether the touch of the last frames is what it predicts, with a forgetting factor.

The NIS test asks whether innovations are larger than noise makes them: their squared lengths less what is expected,
summed, in units of the sum's standard deviation. The drift test asks whether corrections go one way: with a prediction
of covariance P- and an update to P+, a correction has the covariance P- - P+ and is independent of the next, so the
squared length of their sum is chi-square with six degrees of freedom at most. Slow slip hides from the first test and
shows in the second. A mode that was just found still goes to where the filter wants it: its first frames do not count.

Source: [B01] Y. Bar-Shalom et al., Estimation with Applications to Tracking and Navigation, 2001, section 5.4
(consistency of a filter; the normalised innovation squared, NIS, over a time that fades).
"""

import dataclasses

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.poses import increments_between
from tactopose_drake.core.tracking.contact_update import ContactUpdate
from tactopose_drake.core.tracking.tracked_modes import TrackedModes
from tactopose_drake.core.tracking.tracker_params import ConsistencyParams


def record_innovations(
    predicted: TrackedModes, update: ContactUpdate, degrees: int, params: ConsistencyParams
) -> TrackedModes:
    """The modes after an update, with the sums of the tests.

    Args:
        predicted: the modes before.
        update: theirs, by contacts.
        degrees: how many numbers these measured.
        params: of the tests.
    """
    factor, wandering = params.forgetting_factor, 1.0 + params.process_share
    correction = increments_between(predicted.X_PO, update.X_PO)
    excess = np.stack([update.nis - degrees, np.full(len(predicted), 2.0 * degrees)], axis=1)
    updated = dataclasses.replace(
        predicted,
        X_PO=update.X_PO,
        covariance=update.covariance,
        cross_covariance=update.cross_covariance,
        frames=predicted.frames + 1.0,
        nis_excess=predicted.nis_excess * [factor, factor**2] + excess,
        drift=factor * predicted.drift + correction,
        drift_covariance=factor**2 * predicted.drift_covariance + wandering * predicted.covariance - update.covariance,
    )
    return restart_test(updated, updated.frames <= params.first_frame)


def are_inconsistent(modes: TrackedModes, params: ConsistencyParams) -> NDArray[np.bool_]:
    """Which of the modes the touch contradicts, shape (n,)."""
    excess = modes.nis_excess[:, 0] / np.sqrt(np.maximum(modes.nis_excess[:, 1], 1.0))
    # By the mode's own covariance: of that each frame's wandering is the least which is expected, also where a turn of
    # the tangent space from frame to frame seems to take it away.
    unit = np.linalg.inv(np.linalg.cholesky(modes.covariance))
    values, vectors = np.linalg.eigh(unit @ modes.drift_covariance @ np.swapaxes(unit, 1, 2))
    along = np.einsum("nij,nik,nk->nj", vectors, unit, modes.drift)
    values = np.maximum(values, params.process_share)
    drift = np.sum(along**2 / values, axis=1)
    inconsistent: NDArray[np.bool_] = (excess > params.nis_threshold) | (drift > params.drift_threshold)
    return inconsistent


def restart_test(modes: TrackedModes, which: NDArray[np.bool_]) -> TrackedModes:
    """The modes without the sums of the tests, for those of them (n,) that are to begin anew."""
    kept = ~which
    return dataclasses.replace(
        modes,
        nis_excess=modes.nis_excess * kept[:, None],
        drift=modes.drift * kept[:, None],
        drift_covariance=modes.drift_covariance * kept[:, None, None],
    )
