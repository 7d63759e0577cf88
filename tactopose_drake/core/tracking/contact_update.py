"""The measurement update of pose modes by contacts whose errors are partly constant.

A contact's error has a part that is new at each time, which averages out over frames, and a part that stays: the
calibration of the hand's kinematics shifts the fingertip and turns its normal. A filter that takes all of it for white
noise shrinks its covariance without end. Therefore the constant part of each fingertip enters as six biases b of known
covariance B that are considered, not estimated [S66]: a mode keeps the pose's covariance P and its cross-covariance C
with the biases. An update is that of pose and biases together; afterwards the information on the biases is dropped:
their mean is zero and their covariance B again. P and C are those of the joint update,

    [P C; C^T B]^-1 -> [P C; C^T B]^-1 + J^T J,

so the pose is as if the biases were estimated from this frame, and no covariance shrinks that should not: N frames of
one grasp, each with its own error covariance R, give exactly P = B + R / N in the coordinates of the contacts (from no
prior knowledge: P = B + R, C = -B; then the innovation covariance is P + B + 2 C + R = 2 R, and the gain 1 / 2).

Contacts are linearised by statistical regression over the spread of the mode [G15] rather than by a tangent. Tangents
at successive estimates differ, by bends, facets and edges, and together claim information that none of them has. Where
the spread reaches over bends and edges, however, the regressed mean may lie off the actual surface: there the pose is
the minimum of prior and contacts themselves. The regression's residual is the surface's roughness about the contact. It
lasts while the contact does, and so do most errors of the normal expected near an edge: roughness is added to the
variances B, by mode and source. So is the doubt of the one-shot estimate, about noise that seems larger than told and
contacts that seem false, while it persists. Errors of single frames show from frame to frame; errors beyond that last.

A narrow mode sees little of the surface. What neither source covers would be counted anew at each frame, and the mode
would become sure of a wrong pose. Slopes that differ slightly between frames have the same effect, as they seem to tell
biases and pose apart: a filter that is linearised at a different state each time gains spurious information [H08].
Therefore the information of a mode after a frame is bounded, in each direction, by the larger of what it had before and
what the present touch would give if it were repeated for ever: biases do not average out. It is also bounded by what
the last search, which samples the exact posterior, and the other touches of the window give: slopes at one place do not
know how far a bent valley extends.

Sources: [G15] A. Garcia-Fernandez et al., Posterior linearization filter: principles and implementation using sigma
points, IEEE Trans. Signal Processing, 2015; [H08] G. Huang, A. Mourikis, S. Roumeliotis, Analysis and improvement of
the consistency of extended Kalman filter based SLAM, ICRA 2008; [S66] S. Schmidt, Application of state-space methods to
navigation problems, 1966 (the consider filter).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from tactopose_drake.core.compilation import read_only
from tactopose_drake.core.evidence.contact_reading import ContactReading
from tactopose_drake.core.kernels.matrix_kernels import eigenpairs, inverses
from tactopose_drake.core.objectives.surface_contact import SurfaceContact
from tactopose_drake.core.plain_values import copied
from tactopose_drake.core.posterior.modes import increments_of_one_metre
from tactopose_drake.core.searches.touch_space import TouchSpace
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.tracking import gain_kernels
from tactopose_drake.core.tracking.contact_errors import BiasModel
from tactopose_drake.core.tracking.frame import PoseMeasurement
from tactopose_drake.core.tracking.joint_state_kernels import ContactArrays, ModePriors
from tactopose_drake.core.tracking.refinement_kernels import refine_modes
from tactopose_drake.core.tracking.regression_kernels import Regression, regress_modes
from tactopose_drake.core.tracking.sigma_point_kernels import RegressionSettings
from tactopose_drake.core.tracking.tracked_modes import TrackedModes
from tactopose_drake.core.tracking.tracker_params import PoseTrackerParams
from tactopose_drake.core.validation import FloatArray


class ContactUpdate(NamedTuple):
    """Updated statistics of n modes.

    Attributes:
        X_PO: the poses, shape (n, 3, 4).
        covariance: of the increments there, shape (n, 6, 6).
        cross_covariance: of the increments with the biases, shape (n, 6, 6 s).
        roughness: of the surface about each of k contacts: variances of its distance, m^2, and of its normal about
            each axis, rad^2, shape (n, k, 2).
    """

    X_PO: FloatArray
    covariance: FloatArray
    cross_covariance: FloatArray
    roughness: FloatArray


def update_with_contacts(
    model: ObjectModel,
    params: PoseTrackerParams,
    reading: ContactReading,
    modes: TrackedModes,
    X_start: FloatArray | None = None,
) -> ContactUpdate:
    """Updates modes, each a joint Gaussian of the increments from its pose and of the biases.

    Args:
        model: the object.
        params: what is assumed of the biases, and how much work goes into the update.
        reading: the contacts in P; their standard deviations are of the whole error, including the calibration's.
        modes: the predicted modes.
        X_start: where the refinement starts, shape (n, 3, 4); the prediction if None.
    """
    contacts, settings, count = reading.contacts, params.contact_update, len(modes)
    priors = _make_priors(modes, BiasModel.from_params(params).with_roughness(modes.roughness))
    told = SurfaceContact(model.grid, contacts)
    weights = 1.0 / np.sqrt(reading.parts.new.T)
    weights[1] *= contacts.n_PC is not None
    weight_p, weight_n, source = map(read_only, (*weights, reading.source))
    arrays = ContactArrays(told.touch.p, told.touch.n, weight_p, weight_n, source)
    X_PO = np.array(modes.X_PO if X_start is None else X_start, order="C")
    hessian = np.empty(priors.information.shape)
    refine_modes(told.grid, arrays, priors, X_PO, settings.max_iterations, settings.tolerance, hessian)
    # A frame adds little information: the linearisation must hold over the predicted spread, not only at the minimum.
    spread = np.array(modes.covariance if X_start is None else np.linalg.inv(hessian)[:, :6, :6], order="C")
    roughness = np.zeros((count, len(contacts), 2))
    regression = Regression(roughness, spread, np.empty(modes.cross_covariance.shape))
    X_minimum = X_PO.copy()
    regress_modes(told.grid, arrays, priors, _regression_settings(params, model.size), X_PO, regression)
    cost = told.cost(np.concatenate([X_minimum, X_PO]))
    is_beside = cost[count:] > cost[:count] + settings.as_good
    X_PO[is_beside] = X_minimum[is_beside]
    return ContactUpdate(X_PO, spread, regression.cross_covariance, roughness)


def _make_priors(modes: TrackedModes, variances: FloatArray) -> ModePriors:
    """The joint Gaussians of the modes and of biases with variances (n, 6 s)."""
    count, size = len(modes), 6 + variances.shape[1]
    information = np.empty((count, size, size))
    gain = np.ascontiguousarray(modes.cross_covariance / variances[:, None])
    left = modes.covariance - gain @ np.swapaxes(modes.cross_covariance, 1, 2)
    gain_kernels.join_information(inverses(left)[0], gain, variances, information)
    return ModePriors(read_only(modes.X_PO), read_only(information))


def update_modes(
    model: ObjectModel, params: PoseTrackerParams, reading: ContactReading, modes: TrackedModes
) -> TrackedModes:
    """Updates the modes, at least one, with a frame's contacts; those of negligible weight stay as predicted.

    Args:
        model: the object.
        params: what is assumed.
        reading: the contacts.
        modes: the predicted modes, in descending order of weight.
    """
    count = np.count_nonzero(modes.log_weight >= modes.log_weight[0] + math.log(params.mixture.least_updated_share))
    first = min(int(count), params.mixture.max_updated)
    predicted = modes.chosen(slice(first))
    information, most = touch_information(model, params, reading, predicted)
    update = update_with_contacts(model, params, reading, predicted)
    covariance = limit_gain(predicted.covariance, most, update.covariance)
    covariance = limit_gain(predicted.covariance, predicted.most_information, covariance)
    covariance = only_as_told(model, params, information, predicted.covariance, covariance)
    updated = copied(predicted, X_PO=update.X_PO, covariance=covariance, cross_covariance=update.cross_covariance)
    updated = follow_roughness(updated, reading, update.roughness, params)
    return updated if first == len(modes) else updated.joined(modes.chosen(slice(first, None)))


def touch_information(
    model: ObjectModel, params: PoseTrackerParams, reading: ContactReading, modes: TrackedModes
) -> tuple[FloatArray, FloatArray]:
    """The information of the touch on the modes, now and in the limit of many frames, shape (n, 6, 6) each.

    In the limit only lasting errors remain; but as in a keyframe, new errors average out over a limited number of
    frames, since contacts roll on.

    Args:
        model: the object.
        params: what is assumed.
        reading: the contacts.
        modes: the predicted modes.
    """
    contacts = reading.contacts
    lasting = BiasModel.from_params(params).variances + modes.roughness[:, reading.source]
    variances = lasting + reading.parts.new / params.window.max_frames
    jacobian = SurfaceContact(model.grid, contacts).rows_of_contacts(modes.X_PO)[1]
    now, most = np.empty((2, len(modes), 6, 6))
    gain_kernels.inform(jacobian, np.ascontiguousarray(reading.parts.told / variances), now, most)
    return now, most


def limit_gain(before: FloatArray, most: FloatArray, after: FloatArray) -> FloatArray:
    """Widens covariances (n, 6, 6) after an update that claim more information than the touch can give.

    In no direction does the information exceed the larger of that before the update and that of the touch.

    Args:
        before: covariances, shape (n, 6, 6).
        most: upper bound on the information from the touch, however often it is measured, shape (n, 6, 6).
        after: covariances that the update claims, shape (n, 6, 6).
    """
    bounded = np.array(after, order="C")
    gain_kernels.bound_covariances(np.ascontiguousarray(before), np.ascontiguousarray(most), bounded)
    return bounded


def only_as_told(
    model: ObjectModel, params: PoseTrackerParams, information: FloatArray, before: FloatArray, after: FloatArray
) -> FloatArray:
    """Restores covariances (n, 6, 6) after an update to their former width in directions the touch does not determine.

    Regression over a wide spread finds the ends of a family of poses, at which contacts would leave the surface that
    they slide along. These are not new at the next frame, and between them the touch contains no information.

    Args:
        model: the object.
        params: the spread from which on a direction counts as undetermined.
        information: of the touch on the modes, by tangents, shape (n, 6, 6).
        before: covariances before the update, shape (n, 6, 6).
        after: covariances after it, shape (n, 6, 6).
    """
    units, least = increments_of_one_metre(model.size), 1.0 / (params.untold_share * model.size) ** 2
    squares = np.outer(units, units)
    values, rows = eigenpairs(information * squares)
    if values.min() >= least:
        return after
    free = rows * (values < least)[..., None]
    untold = np.swapaxes(free, 1, 2) @ free
    lost, rows = eigenpairs(untold @ ((before - after) / squares) @ untold)
    return after + np.swapaxes(rows, 1, 2) @ (np.maximum(lost, 0.0)[..., None] * rows) * squares


def follow_roughness(
    modes: TrackedModes, reading: ContactReading, roughness: FloatArray, params: PoseTrackerParams
) -> TrackedModes:
    """Updates the modes when k sources touch a surface of roughness (n, k, 2), and are doubted.

    A bias is the sum of the hand's and the surface's. Where its variance grows, the added part is uncorrelated with the
    pose. Where it falls from T to t, the share t / T of the bias is expected to remain.
    """
    after, cross = np.array(modes.roughness, order="C"), np.array(modes.cross_covariance, order="C")
    variances, gain = BiasModel.from_params(params).variances, params.contact_update.roughness_gain
    gain_kernels.follow_roughness(roughness, reading.parts.excess, reading.source, variances, gain, after, cross)
    return copied(modes, cross_covariance=cross, roughness=after)


def follow_lasting_errors(
    modes: TrackedModes, before: ContactReading, after: ContactReading, params: PoseTrackerParams
) -> TrackedModes:
    """Updates the modes when the lasting errors of the contacts turn out larger or smaller than assumed."""
    roughness = modes.roughness.copy()
    least = after.parts.excess
    changed = roughness[:, after.source] + least - before.parts.excess
    roughness[:, after.source] = np.maximum(changed, least)
    return modes.with_roughness(roughness, BiasModel.from_params(params).variances)


def _regression_settings(params: PoseTrackerParams, size: float) -> RegressionSettings:
    """The settings for an object of this size, m."""
    settings = params.contact_update
    return RegressionSettings(
        params.lever_arm * size,
        settings.max_displacement,
        settings.rounds,
        settings.bend_penalty,
        settings.lasting_normal_share,
        settings.new_normal_share,
    )


def begin_modes(
    model: ObjectModel,
    params: PoseTrackerParams,
    reading: ContactReading,
    near: PoseMeasurement | None,
    X_PO: FloatArray,
    covariance: FloatArray,
) -> TrackedModes:
    """New modes with a posterior's poses and covariances, correlated with biases by the touch and a pose if given."""
    n, sources = len(X_PO), len(reading.sources)
    if not n:
        return TrackedModes.empty(sources)
    X_near, spread = X_PO, np.linalg.inv(TouchSpace(model, reading.contacts).information)
    if near is not None:
        X_near, spread = np.tile(near.X_PO, (n, 1, 1)), near.covariance
    priors = TrackedModes.independent(X_near, np.tile(spread, (n, 1, 1)), sources)
    update = update_with_contacts(model, params, reading, priors, X_PO)
    # The roughness of the surface there is known from the update.
    roughness = np.zeros_like(priors.roughness)
    roughness[:, reading.source] = update.roughness + reading.parts.excess
    # Where the bias has become smaller than assumed, so has its covariance with the pose, by the same factor.
    variances = BiasModel.from_params(params).variances
    left = np.repeat(np.minimum(1.0 + roughness / variances, 1.0), 3, axis=2).reshape(n, 1, 6 * sources)
    cross_covariance = left * update.cross_covariance
    new = copied(priors, X_PO=X_PO, covariance=update.covariance, roughness=roughness)
    return copied(new, cross_covariance=cross_covariance).fitted(covariance)
