"""Estimates how large the errors of the hand's calibration are, relative to what is told of them.

Calibration errors do not change over time. The mean of the contacts' residuals over some frames therefore mostly
consists of them, and the part of it that no pose explains tells their size: nine numbers for five contacts with
normals. The scale has a prior over doublings of the variances of points and of normals; its posterior is summed over
this grid, with the pose integrated out, as the one-shot estimate does it for the noise. A wrong pose leaves larger
residuals than the hand's errors do, so all modes are evaluated, and weighted by their probability.
"""

from __future__ import annotations

import functools
import math
from typing import NamedTuple

import numpy as np

from tactopose_drake.core.evidence.contact_reading import ContactReading, ErrorScales
from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.objectives.surface_contact import SurfaceContact, along_normals
from tactopose_drake.core.poses import ANY_POSE
from tactopose_drake.core.posterior.modes import Modes
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.tracking.contact_errors import BiasModel
from tactopose_drake.core.tracking.tracker_params import CalibrationScaleParams, PoseTrackerParams
from tactopose_drake.core.validation import FloatArray

# Contacts that are inliers with less than this probability are left out.
_LEAST_BELIEVED = 0.25
# Modes of less probability are left out.
_LEAST_WEIGHT = 0.01
_LEAST_CONTACTS = 3  # with normals: a pose explains nearly all that fewer measure


class _Scales(NamedTuple):
    """Factors of the variances of points and normals, shape (g, 2), and their log prior probabilities, shape (g,)."""

    factors: FloatArray
    log_prior: FloatArray


@functools.cache
def _scales(halvings: int, doublings: int, more: float, apart: float) -> _Scales:
    """The grid of doublings: each costs the factor `more` of probability, each difference of the two `apart`."""
    points, normals = (k.ravel() for k in np.meshgrid(*2 * [np.arange(-halvings, doublings + 1)], indexing="ij"))
    larger = np.maximum(np.abs(points), np.abs(normals))
    log_prior = larger * math.log(more) + np.abs(points - normals) * math.log(apart)
    factors = np.exp2(np.stack([points, normals], axis=1), dtype=np.float64)
    return _Scales(factors, log_prior - np.logaddexp.reduce(log_prior))


def estimate_scale(
    model: ObjectModel,
    params: PoseTrackerParams,
    reading: ContactReading,
    mean: Contacts,
    frames: int,
    modes: Modes,
    inlier_probability: FloatArray,
) -> FloatArray | None:
    """Estimates factors of the variances of points and of normals, shape (2,); None if there is too little data.

    They are the geometric mean, over the modes, of the factors' posterior expectations.

    Args:
        model: the object.
        params: what is told of the calibration.
        reading: the current contacts.
        mean: the mean of the same k contacts over the frames in which they stayed.
        frames: the number of these frames.
        modes: of the pose, n of them.
        inlier_probability: of the contacts if the object is at the mode, shape (n, k).
    """
    settings = params.calibration_scale
    if mean.n_PC is None or frames < settings.least_frames:
        return None
    scales = _scales(settings.halvings, settings.doublings, settings.doubling_share, settings.apart_share)
    bias, parts = BiasModel.from_params(params), reading.parts
    lasting = scales.factors[:, None] * (bias.of_calibration + parts.declared)
    variances = ((lasting + np.square(bias.surface) + parts.new / frames) / parts.told)[..., [0, 1, 1]]
    X_PO, weights = modes.mixture.X_PO, modes.mixture.weights
    residuals, jacobian = SurfaceContact(model.grid, mean).rows_of_contacts(X_PO)
    log_factors, total = np.zeros(2), 0.0
    for j in np.flatnonzero(weights > _LEAST_WEIGHT):
        felt = np.flatnonzero(inlier_probability[j] > _LEAST_BELIEVED)
        if len(felt) < _LEAST_CONTACTS:
            continue
        r, J = along_normals(mean.n_PC[felt] @ X_PO[j, :, :3], residuals[j, felt, :4], jacobian[j, felt, :4])
        log_weight = scales.log_prior + _log_evidence(r, J, variances[:, felt])
        expected = np.exp(log_weight - np.logaddexp.reduce(log_weight)) @ scales.factors
        log_factors += weights[j] * np.log(expected)
        total += weights[j]
    return np.exp(log_factors / total) if total > 0.0 else None


def follow_scale(errors: ErrorScales, now: FloatArray, params: CalibrationScaleParams) -> ErrorScales:
    """Updates the running geometric mean of the factors with another estimate of them, shape (2,)."""
    share = max(1.0 / (1.0 + errors.estimates), params.least_share)
    mean = np.exp((1.0 - share) * np.log(errors.calibration) + share * np.log(now))
    return errors._replace(calibration=mean, estimates=errors.estimates + 1)


def _log_evidence(residuals: FloatArray, jacobian: FloatArray, variances: FloatArray) -> FloatArray:
    """Log marginal likelihood of residuals (k, 3) with variances (g, k, 3) over all poses, shape (g,)."""
    J, r = jacobian.reshape(-1, 6), residuals.reshape(-1)
    flat = variances.reshape(len(variances), -1)
    weighted = J.T / flat[:, None]
    information = weighted @ J + np.diag(ANY_POSE**-2)
    slope = weighted @ r
    explained = np.einsum("gi,gi->g", slope, np.linalg.solve(information, slope[..., None])[..., 0])
    spread = np.log(flat).sum(axis=1) + np.linalg.slogdet(information)[1]
    return np.asarray(-0.5 * (spread + (r**2 / flat).sum(axis=1) - explained))
