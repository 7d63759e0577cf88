"""How large the errors of the hand's calibration are, beside what is told of them.

What a calibration is off by stays. The mean of contacts' residuals over some frames is therefore mostly that, and what
of it no pose explains tells how large it is: of five contacts with normals nine numbers. The scale has a prior over
doublings of the variances, of points and of normals, and is summed over as the one-shot estimate does it with the
noise; the pose is integrated out of each.
"""

from __future__ import annotations

import functools
import math
from typing import NamedTuple

import numpy as np

from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.tracking.contact_errors import BiasModel, declared_excess
from tactopose_drake.core.tracking.frame import ContactReading, SeemingErrors
from tactopose_drake.core.tracking.slip_detection import SlipTest, contact_rows_at
from tactopose_drake.core.tracking.tracker_params import CalibrationScaleParams, PoseTrackerParams
from tactopose_drake.core.validation import FloatArray

# Nothing is known of the pose, rad and m.
_ANY_POSE = np.repeat([3.0, 0.3], 3)
_LEAST_CONTACTS = 3


class _Scales(NamedTuple):
    """Factors of the variances of points and of normals, shape (g, 2), and logarithms of their prior, shape (g,)."""

    factors: FloatArray
    log_prior: FloatArray


@functools.cache
def _scales(halvings: int, doublings: int, more: float, apart: float) -> _Scales:
    """All pairs of so many doublings: each is less probable by a factor, and so is a difference."""
    points, normals = (k.ravel() for k in np.meshgrid(*2 * [np.arange(-halvings, doublings + 1)], indexing="ij"))
    larger = np.maximum(np.abs(points), np.abs(normals))
    log_prior = larger * math.log(more) + np.abs(points - normals) * math.log(apart)
    factors = np.exp2(np.stack([points, normals], axis=1), dtype=np.float64)
    return _Scales(factors, log_prior - np.logaddexp.reduce(log_prior))


def estimate_scale(
    model: ObjectModel, params: PoseTrackerParams, reading: ContactReading, test: SlipTest, X_PO: FloatArray
) -> FloatArray | None:
    """Expected factors of the variances of points and of normals, shape (2,); None where too little tells.

    Args:
        model: the object.
        params: what is told of the calibration.
        reading: the contacts of now.
        test: the residuals of the last frames at the pose.
        X_PO: of the best mode, shape (3, 4).
    """
    contacts, settings = reading.contacts, params.calibration_scale
    if test.residuals.shape[1] < len(reading.sources):
        return None
    history = test.residuals[:, reading.source]
    counts = np.count_nonzero(~np.isnan(history[..., 0]), axis=0)
    felt = np.flatnonzero(counts >= settings.least_frames)
    if len(felt) < _LEAST_CONTACTS or contacts.n_PC is None:
        return None
    mean = np.nansum(history[:, felt], axis=0) / counts[felt, None]
    jacobian = contact_rows_at(model, reading, X_PO[None])[1][0][felt]
    residuals, jacobian = _along_normals(contacts.n_PC[felt] @ X_PO[:, :3], mean, jacobian)
    told = np.stack([contacts.sigma_position, contacts.sigma_normal], axis=1)[felt] ** 2
    scales = _scales(settings.halvings, settings.doublings, settings.doubling_share, settings.apart_share)
    lasting = np.square(BiasModel.from_params(params).calibration) + declared_excess(contacts, params)[felt]
    surface = np.square(BiasModel.from_params(params).surface)
    new = np.array(test.noise) / counts[felt, None]
    variances = ((scales.factors[:, None] * lasting + surface) / told + new)[..., [0, 1, 1]]
    log_weight = scales.log_prior + _log_evidence(residuals, jacobian, variances)
    weights = np.exp(log_weight - np.logaddexp.reduce(log_weight))
    return np.asarray(weights @ scales.factors)


def follow_scale(errors: SeemingErrors, now: FloatArray | None, params: CalibrationScaleParams) -> SeemingErrors:
    """The errors whose factors are a geometric mean over estimates, with another one, shape (2,), if there is one."""
    if now is None:
        return errors
    share = max(1.0 / (1.0 + errors.estimates), params.least_share)
    mean = np.exp((1.0 - share) * np.log(errors.calibration) + share * np.log(now))
    return errors._replace(calibration=mean, estimates=errors.estimates + 1)


def _along_normals(n_O: FloatArray, mean: FloatArray, jacobian: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Distances, and the two components of the differences of normals across them: (k, 3) and (k, 3, 6)."""
    least = np.eye(3)[np.argmin(np.abs(n_O), axis=1)]
    first = np.cross(n_O, least)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    across = np.stack([first, np.cross(n_O, first)], axis=1)
    rows = np.zeros((len(n_O), 3, 4))
    rows[:, 0, 0], rows[:, 1:, 1:] = 1.0, across
    return np.einsum("kab,kb->ka", rows, mean), rows @ jacobian


def _log_evidence(residuals: FloatArray, jacobian: FloatArray, variances: FloatArray) -> FloatArray:
    """Of residuals (k, 3) with variances (g, k, 3), whatever the pose is, shape (g,)."""
    J, r = jacobian.reshape(-1, 6), residuals.reshape(-1)
    flat = variances.reshape(len(variances), -1)
    weighted = J.T / flat[:, None]
    information = weighted @ J + np.diag(_ANY_POSE**-2)
    slope = weighted @ r
    explained = np.einsum("gi,gi->g", slope, np.linalg.solve(information, slope[..., None])[..., 0])
    spread = np.log(flat).sum(axis=1) + np.linalg.slogdet(information)[1]
    return np.asarray(-0.5 * (spread + (r**2 / flat).sum(axis=1) - explained))
