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

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.tracking.regression_kernels import regress_modes
from tactopose_drake.core.tracking.tracking_kernels import refine_modes
from tactopose_drake.core.validation import FloatArray


class Stable(NamedTuple):
    """Standard deviations of what never changes: of each coordinate of a position, m, and about each axis, rad.

    Attributes:
        hand: the calibration of the hand, which is a part of what the contacts say of their errors.
        surface: how far the model's surface is from the object's where it is touched; contacts do not know of it.
    """

    hand: tuple[float, float]
    surface: tuple[float, float]

    @property
    def variances(self) -> FloatArray:
        """Of the six biases of a source."""
        return np.repeat(np.square(self.hand) + np.square(self.surface), 3)


# Steps that move a mode, and the decrease of the cost that is worth one.
_STEPS, _TOLERANCE = 12, 1e-4
# A turn moves the surface as far as it does at this share of the object's size from O; sigma points move it by no more
# than so many m, and each mode is regressed so often.
_ARM, _REACH, _ROUNDS = 0.25, 0.008, 2
# At least this share of a contact's standard deviation is its own.
_OWN = 0.3


class ContactUpdate(NamedTuple):
    """Of n modes.

    Attributes:
        X_PO: the minima, shape (n, 3, 4).
        covariance: of the increments there, shape (n, 6, 6).
        cross: covariance of the increments with the biases, shape (n, 6, 6 s).
        log_evidence: of the contacts by each mode, up to a constant of all modes, shape (n,).
        misfit: squared length of the whitened innovation, shape (n,): chi-square with as many degrees of freedom as the
            contacts are numbers.
        roughness: of the surface about each of k contacts: variances of its distance, m^2, and of its normal about
            each axis, rad^2, shape (n, k, 2).
        stays: the share of the contacts' variances that is the same at all times.
    """

    X_PO: FloatArray
    covariance: FloatArray
    cross: FloatArray
    log_evidence: FloatArray
    misfit: FloatArray
    roughness: FloatArray
    stays: float


def update_with_contacts(
    model: ObjectModel,
    contacts: Contacts,
    source: NDArray[np.intp],
    stable: Stable,
    X_prior: FloatArray,
    covariance: FloatArray,
    cross: FloatArray,
    roughness: FloatArray,
    X_start: FloatArray | None = None,
) -> ContactUpdate:
    """Updates modes, each a Gaussian of the increments from its pose.

    Args:
        model: the object.
        contacts: in P; the standard deviations are of the whole error, of which the calibration is a part.
        source: which of the s sources each contact is of, shape (k,).
        stable: of what the biases are.
        X_prior: the modes, shape (n, 3, 4).
        covariance: of their increments, shape (n, 6, 6).
        cross: covariances of the increments with the biases, shape (n, 6, 6 s).
        roughness: by which the surface adds to the biases' variances: of positions, m^2, and of normals, rad^2, shape
            (n, s, 2).
        X_start: where to start from, shape (n, 3, 4), where that is not the prior's pose.
    """
    count, size = len(X_prior), 6 + cross.shape[2]
    own = (stable.variances + np.repeat(roughness, 3, axis=2)).reshape(count, size - 6)
    information, log_determinant = _joint_information(covariance, cross, own)
    weights = [
        1.0 / np.sqrt(np.maximum(np.square(sigma) - part**2, np.square(_OWN * np.asarray(sigma))))
        for sigma, part in zip((contacts.sigma_position, contacts.sigma_normal), stable.hand, strict=True)
    ]
    n_PC = np.zeros_like(contacts.p_PC) if contacts.n_PC is None else contacts.n_PC
    X_PO = np.array(X_prior if X_start is None else X_start)
    cost, spread, hessian = np.empty(count), np.empty(count), np.empty((count, size, size))
    problem = (
        model.grid.values,
        model.grid.origin,
        1.0 / model.grid.spacing,
        np.ascontiguousarray(contacts.p_PC),
        np.ascontiguousarray(n_PC),
        np.ascontiguousarray(weights[0]),
        np.ascontiguousarray(weights[1] * (contacts.n_PC is not None)),
        source,
        np.ascontiguousarray(X_prior),
        information,
        X_PO,
    )
    felt = np.zeros((count, len(contacts), 2))
    refine_modes(*problem, _STEPS, _TOLERANCE, hessian)
    if X_start is None:
        # A frame tells little that is new: what holds over the prediction's whole spread, not about the minimum alone.
        hessian[:] = information
    regress_modes(*problem, _ARM * model.size, _REACH, _ROUNDS, cost, spread, hessian, felt)
    joint = np.linalg.solve(hessian, np.broadcast_to(np.eye(size, 6), (count, size, 6)))
    P = joint[:, :6]
    return ContactUpdate(
        X_PO,
        0.5 * (P + np.swapaxes(P, 1, 2)),
        np.swapaxes(joint[:, 6:], 1, 2),
        0.5 * (log_determinant - np.linalg.slogdet(hessian)[1]) - cost,
        2.0 * (cost - spread),
        felt,
        _share_that_stays(own.reshape(count, -1, 6)[:, source], weights, contacts.n_PC is not None),
    )


def _joint_information(covariance: FloatArray, cross: FloatArray, own: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The inverse of [P C; C^T B] by its Schur complement (n, m, m), and the logarithm of its determinant (n,).

    Of B the diagonals `own` are given, shape (n, m - 6).
    """
    count, biases = len(covariance), cross.shape[2]
    gain = cross / own[:, None]
    A = np.linalg.inv(covariance - gain @ np.swapaxes(cross, 1, 2))
    information = np.empty((count, 6 + biases, 6 + biases))
    information[:, :6, :6] = 0.5 * (A + np.swapaxes(A, 1, 2))
    information[:, :6, 6:] = -A @ gain
    information[:, 6:, :6] = np.swapaxes(information[:, :6, 6:], 1, 2)
    information[:, 6:, 6:] = np.swapaxes(gain, 1, 2) @ A @ gain
    at = np.arange(6, 6 + biases)
    information[:, at, at] += 1.0 / own
    return information, np.linalg.slogdet(A)[1] - np.sum(np.log(own), axis=1)


def _share_that_stays(own: FloatArray, weights: list[FloatArray], has_normals: bool) -> float:
    """The mean of B / (B + R) over what contacts measure, by variances B (n, k, 6) and 1 / sqrt(R), (k,) each."""
    distance, normal = (own[:, :, at] * weight**2 for at, weight in zip((0, 3), weights, strict=True))
    share = float(np.mean(distance / (1.0 + distance)))
    return (share + 2.0 * float(np.mean(normal / (1.0 + normal)))) / 3.0 if has_normals else share


def number_of_numbers(contacts: Contacts) -> int:
    """How many the contacts measure: a distance each, and the two angles of a normal."""
    return len(contacts) * (1 if contacts.n_PC is None else 3)
