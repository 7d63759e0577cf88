"""Recursive estimation of a hand's encoder offsets from the residuals of a run's touches.

A touch by five fingers gives fifteen numbers, six of which determine its pose; the rest says little about offsets, but
adds up over touches in different postures. Each touch is used once, as a linear measurement: the residuals at the best
pose are r = J u + B b + e, where u is the error of the pose, of which nothing is assumed, and b the remaining offsets.
Moving a contact's point and turning its normal is equivalent to moving the object the other way, so B follows from J
and the fingers' Jacobians. Other errors of contacts are treated as noise, although they persist between touches;
therefore no offset's standard deviation falls below a floor, and a touch that contradicts the estimate is ignored.
"""

import dataclasses
import math
from typing import Self

import numpy as np

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.objectives.surface_contact import SurfaceContact, along_normals
from tactopose_drake.core.parameter_checks import check_numbers
from tactopose_drake.core.poses import ANY_POSE, skew
from tactopose_drake.core.posterior.chi_square import chi_square_limit
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import FloatArray

_LEAST_CONTACTS = 3  # with normals: a pose explains nearly all that fewer measure


@dataclasses.dataclass(kw_only=True, slots=True)
class OffsetRefinementParams:
    """How cautiously offsets are refined."""

    period: float = 0.05  # time between two updates from the belief, s
    least_frames: int = 6  # least number of frames in the mean of a touch, before it is used
    least_probability: float = 0.98  # least one of the best mode; its width does not matter: the pose is estimated too
    least_turn_deg: float = 10.0  # least rotation of any joint since the last touch used or the hand let go, deg
    let_go_time: float = 0.2  # time without touch after which the hand has let go, s: sensors drop out for less
    least_sigma_deg: float = 0.2  # floor of an offset's standard deviation, deg; of a sliding joint 1 deg is 1 mm
    least_noise_share: float = 0.1  # least share of a contact's variance that does not come from the joints
    chance: float = 1e-3  # p-value of the residuals below which a touch is ignored

    def validate(self) -> None:
        """Raises InvalidInputError if a number is out of its range."""
        shares = dict.fromkeys(("least_probability", "least_noise_share", "chance"), 1.0)
        check_numbers("OffsetRefinementParams", self, most=shares)


@dataclasses.dataclass(frozen=True, eq=False)
class JointOffsets:
    """The estimate of k encoder offsets.

    Attributes:
        mean: offsets that encoders show too much, shape (k,), rad.
        covariance: shape (k, k), rad^2.
        touches: number of touches used.
    """

    mean: FloatArray
    covariance: FloatArray
    touches: int = 0

    @classmethod
    def of_sigma(cls, sigma: FloatArray) -> Self:
        """The prior with standard deviations (k,), rad."""
        return cls(np.zeros(len(sigma)), np.diag(np.square(sigma)))

    @property
    def sigma(self) -> FloatArray:
        """Standard deviations, shape (k,), rad."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))


def refine_offsets(
    model: ObjectModel,
    params: OffsetRefinementParams,
    contacts: Contacts,
    gains: FloatArray,
    X_PO: FloatArray,
    left: JointOffsets,
) -> JointOffsets:
    """Updates the offsets with a touch; returns them unchanged if it carries no information.

    Args:
        model: the object.
        params: how much a touch counts.
        contacts: n of them, with their told uncertainty.
        gains: derivatives of each contact's point and of a rotation of its normal, in P, by the encoders' errors, shape
            (n, 6, k), per rad.
        X_PO: the best pose, shape (3, 4).
        left: the estimate of the offsets that remain in these contacts.
    """
    n, n_PC = len(contacts), contacts.n_PC
    if n < _LEAST_CONTACTS or n_PC is None:
        return left
    residuals, jacobian = SurfaceContact(model.grid, contacts).rows_of_contacts(X_PO[None])
    r, J = along_normals(n_PC @ X_PO[:, :3], residuals[0, :, :4], jacobian[0, :, :4])
    by_contact = -J @ _moves_of_the_object(contacts.p_PC, X_PO)
    told = np.repeat(contacts.variances, 3, axis=1)
    of_joints = np.einsum("kij,jl,kil->ki", gains, left.covariance, gains)
    other = np.maximum(told - of_joints, params.least_noise_share * told)
    noise, each = np.zeros((n, 3, n, 3)), np.arange(n)
    noise[each, :, each] = np.einsum("kri,ki,ksi->krs", by_contact, other, by_contact)
    B = (by_contact @ gains).reshape(-1, len(left.mean))
    return _update(params, r.reshape(-1), J.reshape(-1, 6), B, noise.reshape(len(B), len(B)), left)


def _moves_of_the_object(points: FloatArray, X_PO: FloatArray) -> FloatArray:
    """Maps (k, 6, 6) from motions of contacts, displacements and rotations at points (k, 3), to pose increments."""
    moves = np.zeros((len(points), 6, 6))
    moves[:, :3, 3:] = X_PO[:, :3].T
    moves[:, 3:, :3] = np.eye(3)
    moves[:, 3:, 3:] = -skew(X_PO[:, 3] - points)
    return moves


def _update(
    params: OffsetRefinementParams, r: FloatArray, J: FloatArray, B: FloatArray, noise: FloatArray, left: JointOffsets
) -> JointOffsets:
    """Kalman update by residuals (m,) with Jacobians J of the pose and B of the offsets; the pose is marginalised."""
    S = noise + (J * ANY_POSE**2) @ J.T + B @ left.covariance @ B.T
    innovation = r - B @ left.mean
    weighed = np.linalg.solve(S, np.column_stack([innovation, B @ left.covariance]))
    if innovation @ weighed[:, 0] > chi_square_limit(len(r) - 6, params.chance):
        return left
    gain = weighed[:, 1:].T
    covariance = left.covariance - gain @ B @ left.covariance
    covariance = 0.5 * (covariance + covariance.T)
    floor = np.minimum(np.diag(left.covariance), math.radians(params.least_sigma_deg) ** 2)
    covariance += np.diag(np.maximum(floor - np.diag(covariance), 0.0))
    return JointOffsets(left.mean + gain @ innovation, covariance, left.touches + 1)
