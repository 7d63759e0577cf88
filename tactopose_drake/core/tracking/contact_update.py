"""The update of pose modes by contacts whose errors are in part the same at all times.

A contact's error has a part of its own at each time, which averages out over frames, and a part that stays: the
calibration of the hand's kinematics, a shift of the fingertip and a turn of its normal. A belief that takes all of it
for new at each frame shrinks without end. Therefore the stable part of each fingertip is carried along as six biases b
of known covariance B that are considered, not estimated [S66]: a mode keeps the pose's covariance P and its covariance
with the biases C. An update is that of pose and biases together; then what it says of the biases is forgotten: their
mean is again zero, their covariance B. P and C are those of the joint update,

    [P C; C^T B]^-1 -> [P C; C^T B]^-1 + J^T J,

which is why the pose is as if the biases were estimated from this frame, and why nothing shrinks that should not: N
frames of one grasp, each with own error covariance R, give P = B + R / N in the coordinates of the contacts, exactly
(from nothing known: P = B + R, C = -B; then the innovation's covariance is P + B + 2 C + R = 2 R, the gain 1 / 2).

What a contact says of the pose is regressed over the spread of the mode [G15] rather than read off a tangent. Tangents
at one estimate after the other are all different, by bends, facets and edges, and together claim to know what none
does. Where the spread reaches over bends and edges, though, the middle of what is regressed may lie beside the surface
as it is: there the pose is the minimum of prior and contacts themselves. What slopes leave over is the surface's
roughness about the contact. It stays while the contact stays, and so do most errors of the normal that is
expected near an edge: roughness adds to the variances B, by mode and source. So does what the one-shot estimate doubts:
noise that seems larger than told, and contacts that seem false, for as long as they seem so. What single frames err is
seen from frame to frame; what they are off beyond that, lasts.

What neither sees, because a mode that is narrow sees little of the surface, is counted at each frame anew, and a mode
that learns from it grows sure of a pose beside the truth. So do slopes that differ a little from one frame to the next,
which tell biases and pose apart where nothing does: a filter that is linearised at other states each time gains
information that there is none of [H08]. Therefore in no direction does a frame make a mode surer than it was before, or
than the touch of now could make it were it felt for ever, whichever is more: biases do not average out. Nor does it
become surer than the last search, which samples the posterior as it is, and the window's other touches leave it: slopes
at one place do not know how far a valley leads that bends.

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
from tactopose_drake.core.evidence.evidence import Evidence
from tactopose_drake.core.kernels import gain_kernels
from tactopose_drake.core.kernels.joint_state_kernels import ContactArrays, ModePriors
from tactopose_drake.core.kernels.matrix_kernels import eigenpairs, inverses
from tactopose_drake.core.kernels.refinement_kernels import refine_modes
from tactopose_drake.core.kernels.regression_kernels import Regression, regress_modes
from tactopose_drake.core.kernels.sigma_point_kernels import RegressionSettings
from tactopose_drake.core.objectives.surface_contact import SurfaceContact
from tactopose_drake.core.plain_values import copied
from tactopose_drake.core.posterior.hypotheses import increments_of_one_metre
from tactopose_drake.core.searches.pose_problem import make_problem
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.tracking.contact_errors import BiasModel
from tactopose_drake.core.tracking.frame import PoseMeasurement
from tactopose_drake.core.tracking.tracked_modes import TrackedModes
from tactopose_drake.core.tracking.tracker_params import PoseTrackerParams
from tactopose_drake.core.validation import FloatArray


class ContactUpdate(NamedTuple):
    """Of n modes.

    Attributes:
        X_PO: the minima, shape (n, 3, 4).
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
    """Updates modes, each a Gaussian of the increments from its pose and of the biases.

    Args:
        model: the object.
        params: what is assumed of the biases, and how much work goes into it.
        reading: the contacts in P; their standard deviations are of the whole error, of which the calibration is a
            part.
        modes: as they are predicted.
        X_start: where to start from, shape (n, 3, 4), where that is not the prediction.
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
    # A frame tells little that is new: what holds over the prediction's whole spread, not about the minimum alone.
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
    """The joint Gaussians of modes and of biases with these variances (n, 6 s)."""
    count, size = len(modes), 6 + variances.shape[1]
    information = np.empty((count, size, size))
    gain = np.ascontiguousarray(modes.cross_covariance / variances[:, None])
    left = modes.covariance - gain @ np.swapaxes(modes.cross_covariance, 1, 2)
    gain_kernels.join_information(inverses(left)[0], gain, variances, information)
    return ModePriors(read_only(modes.X_PO), read_only(information))


def update_modes(
    model: ObjectModel, params: PoseTrackerParams, reading: ContactReading, modes: TrackedModes
) -> TrackedModes:
    """The modes, at least one, after a frame's contacts; those that hardly count are left as they were predicted.

    Args:
        model: the object.
        params: what is assumed.
        reading: what is touched.
        modes: as they are predicted, by falling weight.
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
    """What the touch tells of the modes, and what it tells when only what lasts of its errors is left, (n, 6, 6) each.

    As in a keyframe, what is new at each time averages out over some frames, and not further: contacts roll on.

    Args:
        model: the object.
        params: what is assumed.
        reading: what is touched.
        modes: as they are predicted.
    """
    contacts = reading.contacts
    lasting = BiasModel.from_params(params).variances + modes.roughness[:, reading.source]
    variances = lasting + reading.parts.new / params.window.max_frames
    jacobian = SurfaceContact(model.grid, contacts).rows_of_contacts(modes.X_PO)[1]
    now, most = np.empty((2, len(modes), 6, 6))
    gain_kernels.inform(jacobian, np.ascontiguousarray(reading.parts.told / variances), now, most)
    return now, most


def limit_gain(before: FloatArray, most: FloatArray, after: FloatArray) -> FloatArray:
    """Covariances (n, 6, 6) after an update that are no narrower, in any direction, than a touch can make them.

    Where the touch tells less than was known before, they are no narrower than they were.

    Args:
        before: covariances, shape (n, 6, 6).
        most: information of the touch, however often it is felt, shape (n, 6, 6).
        after: covariances that the update claims, shape (n, 6, 6).
    """
    bounded = np.array(after, order="C")
    gain_kernels.bound_covariances(np.ascontiguousarray(before), np.ascontiguousarray(most), bounded)
    return bounded


def only_as_told(
    model: ObjectModel, params: PoseTrackerParams, information: FloatArray, before: FloatArray, after: FloatArray
) -> FloatArray:
    """The covariances (n, 6, 6) after an update, as wide as before it in directions of which the touch tells nothing.

    What is regressed over a wide spread finds the ends of a family of poses, at which the contacts would leave the
    surface that they slide along. These are no news at the next frame, and within them the touch tells nothing.

    Args:
        model: the object.
        params: from which spread on the touch tells nothing.
        information: what it tells of the modes, by tangents, shape (n, 6, 6).
        before: covariances, shape (n, 6, 6).
        after: likewise.
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
    """The modes when some sources (k,) touch a surface of this roughness (n, k, 2), and are doubted.

    A bias is the sum of the hand's and the surface's. Where the latter's variance grows, the pose knows nothing of what
    is added. Where the sum's falls from T to t, of the bias a share t / T is expected to be left.
    """
    after, cross = np.array(modes.roughness, order="C"), np.array(modes.cross_covariance, order="C")
    variances, gain = BiasModel.from_params(params).variances, params.contact_update.roughness_gain
    gain_kernels.follow_roughness(roughness, reading.parts.excess, reading.source, variances, gain, after, cross)
    return copied(modes, cross_covariance=cross, roughness=after)


def follow_lasting_errors(
    modes: TrackedModes, before: ContactReading, after: ContactReading, params: PoseTrackerParams
) -> TrackedModes:
    """The modes when what lasts of the contacts' errors is found to be larger or smaller than it was taken for."""
    roughness = modes.roughness.copy()
    least = after.parts.excess
    changed = roughness[:, after.source] + least - before.parts.excess
    roughness[:, after.source] = np.maximum(changed, least)
    return modes.with_roughness(roughness, BiasModel.from_params(params).variances)


def _regression_settings(params: PoseTrackerParams, size: float) -> RegressionSettings:
    """Those for an object of a size, m."""
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
    """Modes as a posterior knows them, near a pose if there is one; of their biases is known what the touch tells."""
    n, sources = len(X_PO), len(reading.sources)
    if not n:
        return TrackedModes.empty(sources)
    X_near, spread = X_PO, np.linalg.inv(make_problem(model, Evidence(reading.contacts)).space.information)
    if near is not None:
        X_near, spread = np.tile(near.X_PO, (n, 1, 1)), near.covariance
    priors = TrackedModes.independent(X_near, np.tile(spread, (n, 1, 1)), sources)
    update = update_with_contacts(model, params, reading, priors, X_PO)
    # How rough the surface is where they touch is known once they have been there.
    roughness = np.zeros_like(priors.roughness)
    roughness[:, reading.source] = update.roughness + reading.parts.excess
    # Where that leaves less of a bias than it was taken for, of what the pose shares with it as much less is left.
    variances = BiasModel.from_params(params).variances
    left = np.repeat(np.minimum(1.0 + roughness / variances, 1.0), 3, axis=2).reshape(n, 1, 6 * sources)
    cross_covariance = left * update.cross_covariance
    new = copied(priors, X_PO=X_PO, covariance=update.covariance, roughness=roughness)
    return copied(new, cross_covariance=cross_covariance).fitted(covariance)
