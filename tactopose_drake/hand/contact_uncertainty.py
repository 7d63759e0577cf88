"""Covariances of a hand's contacts, and of its tactile arrays' poses, that result from the hand's own errors.

To first order, a contact is moved by the joints' offsets through the finger's Jacobian, by the mounting error of the
sensor with its fingertip, by the error of the fingertip's radius, and by the sensor's errors (see
`core.sensing.contact_noise`). These errors are independent of each other and between fingers; an offset moves a
contact's point and turns its normal jointly. An array is moved by the joints' offsets and its mounting error alone.

For a calibrated finger, the errors are those that remain after the calibration, with their correlations, and the noise
of a single contact that it found. Joints that its calibration does not list have the declared uncertainty.
"""

import math
from typing import NamedTuple

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant

from tactopose_drake.core.compilation import read_only
from tactopose_drake.core.poses import skew
from tactopose_drake.core.sensing.contact_noise import contact_covariance
from tactopose_drake.core.sensing.contact_noise_kernels import HandVariances, SensedContact, fill_hand_covariance
from tactopose_drake.core.sensing.intrinsic_contact import ContactSolution
from tactopose_drake.core.sensing.tactile_layout import TactileLayout
from tactopose_drake.core.validation import FloatArray
from tactopose_drake.hand.contact_gains import contact_gains, wrench_of
from tactopose_drake.hand.encoder_offsets import encoder_gains, offset_sigmas
from tactopose_drake.hand.hand_config import HandUncertainty
from tactopose_drake.hand.hand_in_plant import Hand, sliding_joints
from tactopose_drake.hand.joint_matrices import joint_matrix
from tactopose_drake.hand.kinematics import HandKinematics

# Covariance of a contact's point, m^2, and normal, rad^2, for a hand without errors.
LEAST_COVARIANCE = np.diag(np.repeat([1e-5**2, 1e-3**2], 3))


class ContactUncertainty:
    """Computes the covariance of a hand's contacts, and the error of its surface, from its declared errors."""

    def __init__(self, plant: MultibodyPlant, hand: Hand, uncertainty: HandUncertainty) -> None:
        """Keeps no reference to the plant.

        Args:
            plant: finalized plant of the hand alone.
            hand: the hand in it.
            uncertainty: its errors.
        """
        uncertainty.validate()
        joints, gains = encoder_gains(plant, hand)
        # Change of the plant's positions by one standard deviation of each measured joint's offset, shape (nq, k).
        self._offsets = gains * offset_sigmas(plant, hand, uncertainty)
        self._frames, self._errors = hand.sensor_frames, uncertainty
        self._variances = HandVariances(uncertainty.mounting**2, math.radians(uncertainty.mounting_deg) ** 2)
        self._surfaces, self._layers = hand.surfaces, hand.layers
        self._calibrated: dict[str, _Calibrated] = {}
        # Variance of each fingertip's surface along an axis, without the joints' offsets. A rotation moves the middle
        # of the surface in proportion to its distance from S, whose square counts by 2/3 along an axis.
        turned = {finger: 2.0 / 3.0 * float(np.sum(tip.X_SF[:, 3] ** 2)) for finger, tip in hand.surfaces.items()}
        moved, of_turn = uncertainty.mounting**2 + uncertainty.fingertip_radius**2, self._variances.turn
        self._tip_variance = {finger: moved + of_turn * arm for finger, arm in turned.items()}
        if hand.calibration is not None:
            self._noise, by_joint = hand.calibration.noise, joint_matrix(plant, hand, joints)
            sliding = sliding_joints(plant, hand)
            for finger, found in hand.calibration.fingers.items():
                units = [1.0 if joint in sliding else math.radians(1.0) for joint in found.joints]
                of_joints = [hand.calibration.joint_offsets[joint].sigma for joint in found.joints]
                sigma = np.concatenate([np.array(units) * of_joints, found.sigma])
                correlation = np.array(found.correlation) if found.correlation else np.eye(len(sigma))
                shift, turn = (float(np.mean(np.square(part))) for part in (found.sigma[10:], found.sigma[7:10]))
                self._tip_variance[finger] = shift + found.radius.sigma**2 + turn * turned[finger]
                listed = [joints.index(joint) for joint in found.joints]
                others = np.delete(self._offsets, listed, axis=1)
                self._calibrated[finger] = _Calibrated(
                    by_joint[:, listed], others, correlation * np.outer(sigma, sigma)
                )

    def covariance(
        self, finger: str, solution: ContactSolution, X_PS: RigidTransform, kinematics: HandKinematics
    ) -> FloatArray:
        """Covariance of a valid contact's point and a small rotation of its normal, in P, shape (6, 6), m and rad.

        Args:
            finger: the contact's finger.
            solution: the contact, in S.
            X_PS: pose of S.
            kinematics: the hand's kinematics at the current joint positions.
        """
        if finger in self._calibrated:
            return self._of_calibrated(finger, solution, X_PS, kinematics)
        by_joints = kinematics.jacobian(self._frames[finger], solution.p_SC) @ self._offsets
        by_sensor = contact_covariance(
            solution,
            self._surfaces[finger],
            layer=self._layers.get(finger),
            sigma_moment=self._errors.sensor_moment,
            sigma_force=self._errors.sensor_force,
            sigma_radius=self._errors.fingertip_radius,
        )
        X, covariance = np.ascontiguousarray(X_PS.GetAsMatrix34()), np.empty((6, 6))
        contact = SensedContact(solution.p_SC, solution.n_S, *map(read_only, by_sensor))
        fill_hand_covariance(X, contact, by_joints, self._variances, covariance)
        return covariance

    def surface_sigma(self, kinematics: HandKinematics) -> float:
        """Standard deviation of the fingertips' surfaces along an axis, rms over the fingers, m.

        Args:
            kinematics: the hand's kinematics at the current joint positions.
        """
        variances = []
        for finger, frame in self._frames.items():
            J = kinematics.jacobian(frame, self._surfaces[finger].X_SF[:, 3])[3:] @ self._offsets
            variances.append(float(np.sum(J**2)) / 3.0 + self._tip_variance[finger])
        if not variances:
            return math.hypot(self._errors.mounting, self._errors.fingertip_radius)
        return math.sqrt(sum(variances) / len(variances))

    def _of_calibrated(
        self, finger: str, solution: ContactSolution, X_PS: RigidTransform, kinematics: HandKinematics
    ) -> FloatArray:
        calibrated, noise, R = self._calibrated[finger], self._noise, X_PS.rotation().matrix()
        moved = kinematics.jacobian(self._frames[finger], solution.p_SC)
        by_joints, by_others = moved @ calibrated.gains, moved @ calibrated.others
        gains = contact_gains(wrench_of(solution)[None], self._surfaces[finger], self._layers.get(finger))
        by_contact = np.concatenate([R @ gains.point[0], R @ gains.turn[0]])
        by_mounting = np.block([[-R @ skew(solution.p_SC), R], [R, np.zeros((3, 3))]])
        # Offsets are subtracted from the readings, so that an error of an offset moves the contact the other way.
        by_offsets = -np.concatenate([by_joints[3:], by_joints[:3]])
        J = np.column_stack([by_offsets, -by_contact[:, :6], by_contact[:, 6:], by_mounting])
        covariance: FloatArray = J @ calibrated.covariance @ J.T
        by_others = np.concatenate([by_others[3:], by_others[:3]])
        covariance += by_others @ by_others.T
        by_noise = by_contact[:, :6] * np.repeat([noise.moment, noise.force], 3)
        covariance += by_noise @ by_noise.T
        covariance[:3, :3] += noise.position**2 * np.eye(3)
        covariance[3:, 3:] += math.radians(noise.normal_deg) ** 2 * np.eye(3)
        return 0.5 * (covariance + covariance.T)


class _Calibrated(NamedTuple):
    """Errors of a calibrated finger.

    Attributes:
        gains: derivative of the plant's positions by the listed joints, shape (nq, k).
        others: change of the plant's positions by one standard deviation of each other joint, shape (nq, l).
        covariance: covariance of the finger's errors.
    """

    gains: FloatArray
    others: FloatArray
    covariance: FloatArray


class PadUncertainty:
    """Computes the covariance of the poses of a hand's tactile arrays from its declared errors.

    All cells of an array share one shift and one rotation. The effects of a joint on arrays of two fingers that share
    it are treated as independent.
    """

    def __init__(self, plant: MultibodyPlant, hand: Hand, uncertainty: HandUncertainty) -> None:
        """Keeps no reference to the plant.

        Args:
            plant: finalized plant of the hand alone.
            hand: the hand in it.
            uncertainty: its errors.
        """
        uncertainty.validate()
        self._offsets = encoder_gains(plant, hand).gains * offset_sigmas(plant, hand, uncertainty)
        self._frames = hand.pad_frames
        mounted = np.repeat([uncertainty.mounting, math.radians(uncertainty.mounting_deg)], 3)
        self._mounted = np.diag(mounted**2)

    def covariance(self, pad: str, layout: TactileLayout, kinematics: HandKinematics) -> FloatArray:
        """Covariance of an array's shift and small rotation about the mean of its cells, in P, (6, 6), m and rad.

        Args:
            pad: name of the pad.
            layout: its cells.
            kinematics: the hand's kinematics at the current joint positions.
        """
        J = kinematics.jacobian(self._frames[pad], layout.p_TC.mean(axis=0)) @ self._offsets
        by_joints = np.concatenate([J[3:], J[:3]])
        covariance: FloatArray = by_joints @ by_joints.T + self._mounted
        return covariance
