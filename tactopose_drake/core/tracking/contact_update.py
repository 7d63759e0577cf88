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
does. What slopes leave over is the surface's roughness about the contact. It stays while the contact stays, and so do
most errors of the normal that is expected near an edge: roughness adds to the variances B, by mode and source.

Sources: [G15] A. Garcia-Fernandez et al., Posterior linearization filter: principles and implementation using sigma
points, IEEE Trans. Signal Processing, 2015; [S66] S. Schmidt, Application of state-space methods to navigation
problems, 1966 (the consider filter).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from tactopose_drake.core.compilation import read_only
from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.kernels.joint_state_kernels import ContactArrays, ModePriors
from tactopose_drake.core.kernels.refinement_kernels import refine_modes
from tactopose_drake.core.kernels.regression_kernels import Regression, regress_modes
from tactopose_drake.core.kernels.sigma_point_kernels import RegressionSettings
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.tracking.frame import ContactReading
from tactopose_drake.core.tracking.tracked_modes import TrackedModes
from tactopose_drake.core.tracking.tracker_params import PoseTrackerParams
from tactopose_drake.core.validation import FloatArray


class BiasModel(NamedTuple):
    """Standard deviations of what never changes: of each coordinate of a position, m, and about each axis, rad.

    Attributes:
        calibration: of the hand, which is a part of what the contacts say of their errors.
        surface: how far the model's surface is from the object's where it is touched; contacts do not know of it.
    """

    calibration: tuple[float, float]
    surface: tuple[float, float]

    @classmethod
    def from_params(cls, params: PoseTrackerParams) -> BiasModel:
        """What the parameters say."""
        return cls(
            (params.calibration_position, math.radians(params.calibration_normal_deg)),
            (params.surface_position, math.radians(params.surface_normal_deg)),
        )

    @property
    def variances(self) -> FloatArray:
        """Of a bias of the position, m^2, and of the normal, rad^2, shape (2,)."""
        return np.square(self.calibration) + np.square(self.surface)

    def with_roughness(self, roughness: FloatArray) -> FloatArray:
        """Variances of the biases of s sources, shape (n, 6 s), on surfaces of a roughness (n, s, 2)."""
        variances = np.repeat(self.variances, 3) + np.repeat(roughness, 3, axis=2)
        return variances.reshape(len(roughness), -1)


class ContactUpdate(NamedTuple):
    """Of n modes.

    Attributes:
        X_PO: the minima, shape (n, 3, 4).
        covariance: of the increments there, shape (n, 6, 6).
        cross_covariance: of the increments with the biases, shape (n, 6, 6 s).
        nis: normalised innovation squared, the squared length of the whitened innovation, shape (n,): chi-square with
            as many degrees of freedom as the contacts are numbers.
        roughness: of the surface about each of k contacts: variances of its distance, m^2, and of its normal about
            each axis, rad^2, shape (n, k, 2).
    """

    X_PO: FloatArray
    covariance: FloatArray
    cross_covariance: FloatArray
    nis: FloatArray
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
    contacts, settings, bias = reading.contacts, params.contact_update, BiasModel.from_params(params)
    variances = bias.with_roughness(modes.roughness)
    information = _joint_information(modes.covariance, modes.cross_covariance, variances)
    count, size = information.shape[:2]
    weights = _noise_weights(contacts, bias, settings.least_noise_share)
    grid = model.grid.nodes
    n_PC = np.zeros_like(contacts.p_PC) if contacts.n_PC is None else contacts.n_PC
    arrays = ContactArrays(*map(read_only, (contacts.p_PC, n_PC, *weights, reading.source)))
    priors = ModePriors(read_only(modes.X_PO), read_only(information))
    X_PO, hessian = np.array(modes.X_PO if X_start is None else X_start), np.empty((count, size, size))
    refine_modes(grid, arrays, priors, X_PO, settings.max_iterations, settings.tolerance, hessian)
    if X_start is None:
        # A frame tells little that is new: what holds over the prediction's whole spread, not about the minimum alone.
        hessian[:] = information
    regression = Regression(np.empty(count), np.empty(count), hessian, np.zeros((count, len(contacts), 2)))
    regress_modes(grid, arrays, priors, _regression_settings(params, model.size), X_PO, regression)
    joint = np.linalg.solve(hessian, np.broadcast_to(np.eye(size, 6), (count, size, 6)))
    P = np.asarray(joint[:, :6], dtype=np.float64)
    return ContactUpdate(
        X_PO,
        0.5 * (P + np.swapaxes(P, 1, 2)),
        np.swapaxes(joint[:, 6:], 1, 2),
        2.0 * (regression.cost - regression.log_determinant),
        regression.roughness,
    )


def degrees_of_freedom(contacts: Contacts) -> int:
    """How many numbers the contacts measure: a distance each, and the two angles of a normal."""
    return len(contacts) * (1 if contacts.n_PC is None else 3)


def _noise_weights(contacts: Contacts, bias: BiasModel, least_share: float) -> tuple[FloatArray, FloatArray]:
    """One over the standard deviations of what is new at each time, of points and of normals, shape (k,) each.

    Normals that there are none of have the weight 0.
    """
    position, normal = (
        1.0 / np.sqrt(np.maximum(np.square(sigma) - lasting**2, np.square(least_share * np.asarray(sigma))))
        for sigma, lasting in zip((contacts.sigma_position, contacts.sigma_normal), bias.calibration, strict=True)
    )
    return position, normal * (contacts.n_PC is not None)


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


def _joint_information(P: FloatArray, C: FloatArray, variances: FloatArray) -> FloatArray:
    """The inverse of [P C; C^T B] by its Schur complement, shape (n, m, m).

    Of B the diagonals are given, shape (n, m - 6).
    """
    count, biases = len(P), C.shape[2]
    gain = C / variances[:, None]
    A = np.linalg.inv(P - gain @ np.swapaxes(C, 1, 2))
    information = np.empty((count, 6 + biases, 6 + biases))
    information[:, :6, :6] = 0.5 * (A + np.swapaxes(A, 1, 2))
    information[:, :6, 6:] = -A @ gain
    information[:, 6:, :6] = np.swapaxes(information[:, :6, 6:], 1, 2)
    information[:, 6:, 6:] = np.swapaxes(gain, 1, 2) @ A @ gain
    at = np.arange(6, 6 + biases)
    information[:, at, at] += 1.0 / variances
    return information
