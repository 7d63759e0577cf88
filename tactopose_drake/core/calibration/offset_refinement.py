"""What a hand's encoders show too much, found slowly from what the touches of a run leave unexplained.

Of one touch by five fingers fifteen numbers tell, and six of these its pose; what the rest says of offsets is little,
and adds up over touches in other postures. Each counts once, as a linear measurement: the residuals at the best pose
are r = J u + B b + e, where u is what the pose is off by, of which nothing is taken for known, and b what is left of
the offsets. To move a contact's point and turn its normal is to move the object the other way, so B follows from J and
from the fingers' Jacobians. What else contacts are off by is noise here, though it stays from touch to touch; therefore
no offset is ever known better than to a least standard deviation, and a touch that does not fit what is known so far
says nothing.
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

_LEAST_CONTACTS = 3  # with normals: whatever fewer measure, a pose explains nearly all of it


@dataclasses.dataclass(kw_only=True, slots=True)
class OffsetRefinementParams:
    """How slowly offsets are refined."""

    period: float = 0.05  # s between two looks at the belief
    least_frames: int = 6  # that a touch is the mean of, before it tells
    least_probability: float = 0.98  # of the best mode; however wide it is, for the pose is looked for along
    least_turn_deg: float = 10.0  # of any joint since the last touch that told, unless the hand let go since
    let_go_time: float = 0.2  # s without touch after which the hand has let go: sensors drop out for less
    least_sigma_deg: float = 0.2  # to which an offset may come to be known, deg; of a joint that slides 1 deg is 1 mm
    least_noise_share: float = 0.1  # of a contact's variance, that is of other things than the joints
    chance: float = 1e-3  # with which residuals of what is known so far are as large; a rarer touch says nothing

    def validate(self) -> None:
        """Raises InvalidInputError if a number is out of its range."""
        shares = dict.fromkeys(("least_probability", "least_noise_share", "chance"), 1.0)
        check_numbers("OffsetRefinementParams", self, most=shares)


@dataclasses.dataclass(frozen=True, eq=False)
class JointOffsets:
    """What is known of k offsets.

    Attributes:
        mean: what each encoder shows too much, shape (k,), rad.
        covariance: shape (k, k), rad^2.
        touches: by how many they were found.
    """

    mean: FloatArray
    covariance: FloatArray
    touches: int = 0

    @classmethod
    def of_sigma(cls, sigma: FloatArray) -> Self:
        """Nothing found yet; standard deviations (k,), rad."""
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
    """What is known of offsets after a touch; the same where it tells nothing.

    Args:
        model: the object.
        params: how much a touch counts.
        contacts: n of them, as sure as they are told.
        gains: what errors of a radian of each encoder move each contact's point by, and turn its normal by, in P, shape
            (n, 6, k).
        X_PO: the best pose, shape (3, 4).
        left: what is known of the offsets that are left in these contacts.
    """
    n, n_PC = len(contacts), contacts.n_PC
    if n < _LEAST_CONTACTS or n_PC is None:
        return left
    residuals, jacobian = SurfaceContact(model.grid, contacts).rows_of_contacts(X_PO[None])
    r, J = along_normals(n_PC @ X_PO[:, :3], residuals[0, :, :4], jacobian[0, :, :4])
    by_contact = -J @ _moves_of_the_object(contacts.p_PC, X_PO)
    told = np.repeat(np.square(np.stack([contacts.sigma_position, contacts.sigma_normal], axis=1)), 3, axis=1)
    of_joints = np.einsum("kij,jl,kil->ki", gains, left.covariance, gains)
    other = np.maximum(told - of_joints, params.least_noise_share * told)
    noise, each = np.zeros((n, 3, n, 3)), np.arange(n)
    noise[each, :, each] = np.einsum("kri,ki,ksi->krs", by_contact, other, by_contact)
    B = (by_contact @ gains).reshape(-1, len(left.mean))
    return _update(params, r.reshape(-1), J.reshape(-1, 6), B, noise.reshape(len(B), len(B)), left)


def _moves_of_the_object(points: FloatArray, X_PO: FloatArray) -> FloatArray:
    """Increments (k, 6, 6) of the pose that move the object as contacts (k, 3) move and turn about their points."""
    moves = np.zeros((len(points), 6, 6))
    moves[:, :3, 3:] = X_PO[:, :3].T
    moves[:, 3:, :3] = np.eye(3)
    moves[:, 3:, 3:] = -skew(X_PO[:, 3] - points)
    return moves


def _update(
    params: OffsetRefinementParams, r: FloatArray, J: FloatArray, B: FloatArray, noise: FloatArray, left: JointOffsets
) -> JointOffsets:
    """By residuals (m,) with the derivatives J by the pose and B by the offsets."""
    S = noise + (J * ANY_POSE**2) @ J.T + B @ left.covariance @ B.T
    weighed = np.linalg.solve(S, np.column_stack([r, B @ left.covariance]))
    if r @ weighed[:, 0] > chi_square_limit(len(r) - 6, params.chance):
        return left
    gain = weighed[:, 1:].T
    covariance = left.covariance - gain @ B @ left.covariance
    covariance = 0.5 * (covariance + covariance.T)
    floor = np.minimum(np.diag(left.covariance), math.radians(params.least_sigma_deg) ** 2)
    covariance += np.diag(np.maximum(floor - np.diag(covariance), 0.0))
    return JointOffsets(left.mean + gain @ r, covariance, left.touches + 1)
