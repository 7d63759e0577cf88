"""How far a hand's own errors move its contacts.

To first order: the joints' offsets move a contact by the finger's Jacobian; its fingertip is mounted elsewhere, and
thicker or thinner; and what the sensor errs moves it on the fingertip, see `core.sensing.contact_noise`. Errors of one
finger's parts are independent of each other and of other fingers'; what moves a contact's point and what turns its
normal by the same joint is one error.
"""

import math

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant

from tactopose_drake.core.poses import skew
from tactopose_drake.core.sensing.contact_noise import contact_covariance
from tactopose_drake.core.sensing.intrinsic_contact import ContactSolution
from tactopose_drake.core.validation import FloatArray
from tactopose_drake.hand.encoder_offsets import encoder_gains
from tactopose_drake.hand.hand_config import Hand, HandUncertainty
from tactopose_drake.hand.kinematics import HandKinematics


class ContactUncertainty:
    """How far a hand's contacts, and its surface, may be off by what its description says of its errors."""

    def __init__(self, plant: MultibodyPlant, hand: Hand, uncertainty: HandUncertainty) -> None:
        """Keeps no reference to the plant.

        Args:
            plant: finalized plant of the hand alone.
            hand: the hand in it.
            uncertainty: its errors.
        """
        uncertainty.validate()
        # What an offset of one standard deviation of each measured joint adds to the plant's positions, shape (nq, k).
        self._offsets = encoder_gains(plant, hand).gains * math.radians(uncertainty.encoder_offset_deg)
        self._frames, self._errors = hand.sensor_frames, uncertainty
        self._surfaces, self._layers = hand.surfaces, hand.layers

    def covariance(
        self, finger: str, solution: ContactSolution, X_PS: RigidTransform, kinematics: HandKinematics
    ) -> FloatArray:
        """Of a valid contact's point and a small rotation of its normal, in P, shape (6, 6), m and rad.

        Args:
            finger: whose it is.
            solution: the contact, in S.
            X_PS: where S is.
            kinematics: of the hand, moved to where the joints are.
        """
        errors, R = self._errors, X_PS.rotation().matrix()
        J = kinematics.jacobian(self._frames[finger], solution.p_SC) @ self._offsets
        by_joints = np.concatenate([J[3:], J[:3]])
        covariance: FloatArray = by_joints @ by_joints.T
        n = R @ solution.n_S
        covariance[:3, :3] += errors.mounting**2 * np.eye(3) + errors.fingertip_radius**2 * np.outer(n, n)
        by_sensor = contact_covariance(
            solution,
            self._surfaces[finger],
            layer=self._layers.get(finger),
            sigma_moment=errors.sensor_moment,
            sigma_force=errors.sensor_force,
        )
        turned = skew(n) @ R
        covariance[:3, :3] += R @ by_sensor.p @ R.T
        covariance[3:, 3:] += turned @ by_sensor.n @ turned.T
        return covariance

    def surface_sigma(self, kinematics: HandKinematics) -> float:
        """By how much the fingertips' surfaces are off along an axis, rms over the fingers, m.

        Args:
            kinematics: of the hand, moved to where the joints are.
        """
        moved = [
            kinematics.jacobian(frame, self._surfaces[finger].X_SF[:, 3])[3:] @ self._offsets
            for finger, frame in self._frames.items()
        ]
        by_joints = float(np.mean([np.sum(J**2) / 3.0 for J in moved])) if moved else 0.0
        return math.sqrt(by_joints + self._errors.mounting**2 + self._errors.fingertip_radius**2)
