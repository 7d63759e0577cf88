"""The contacts of recorded grasps as functions of the hand's errors, with Jacobians."""

import dataclasses
from collections import Counter
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from pydrake.multibody.plant import MultibodyPlant

from tactopose_drake.core.calibration.surface_residuals import ContactSigmas, GraspContacts
from tactopose_drake.core.poses import exp_so3, skew
from tactopose_drake.core.sensing.contact_noise import NANO17_SIGMA_FORCE, NANO17_SIGMA_MOMENT, contact_covariance
from tactopose_drake.core.sensing.intrinsic_contact import solve_contacts
from tactopose_drake.core.validation import FloatArray
from tactopose_drake.hand.contact_gains import contact_gains, thicker
from tactopose_drake.hand.hand_errors import FingertipErrors, HandErrors
from tactopose_drake.hand.hand_in_plant import Hand
from tactopose_drake.hand.kinematics import HandKinematics
from tactopose_drake.hand.named_joints import NamedJoints
from tactopose_drake.hand.recorded_grasps import READING_NOISE, RecordedGrasp


@dataclasses.dataclass(frozen=True)
class _Finger:
    """The contacts of one finger: their rows and grasps, wrenches (k, 6), N m and N, and times (k,), s."""

    rows: NDArray[np.int64]
    grasp: NDArray[np.int64]
    wrenches: FloatArray
    times: FloatArray

    def without(self, own: FingertipErrors) -> FloatArray:
        """The wrenches minus the sensor's bias and drift, shape (k, 6)."""
        return self.wrenches - own.bias - self.times[:, None] * own.drift


class FeltGrasps:
    """The contacts of grasps as functions of the hand's errors.

    Attributes:
        grasp: index of each contact's grasp, shape (n,).
        finger: index of each contact's finger in the errors' fingers, shape (n,).
        times: times of the grasps relative to the middle of the recording, shape (g,), s.
    """

    def __init__(self, plant: MultibodyPlant, hand: Hand, errors: HandErrors, grasps: Sequence[RecordedGrasp]) -> None:
        """Keeps a reference to the plant.

        Args:
            plant: finalized plant of the hand alone.
            hand: the hand in it, as described by its files.
            errors: the layout of its errors.
            grasps: the recorded grasps, which `check_grasps` has checked.
        """
        self._errors, self._hand = errors, hand
        self._kinematics = HandKinematics(plant, hand.palm_frame)
        self._gains = errors.gains(plant, hand)
        named = NamedJoints(plant, hand)
        # Missing readings are of joints that move no fingertip, see `check_grasps`.
        readings = [named.positions("joint_positions", dict(g.joint_positions)) for g in grasps]
        self._readings = np.nan_to_num(np.array(readings))
        self.times = np.array([0.0 if g.time is None else g.time for g in grasps])
        self.times -= 0.5 * (self.times.min() + self.times.max())
        touching = [(i, finger) for i, g in enumerate(grasps) for finger in errors.fingers if finger in g.wrenches]
        self.grasp = np.array([i for i, _ in touching], dtype=np.int64)
        self.finger = np.array([errors.fingers.index(finger) for _, finger in touching], dtype=np.int64)
        self._fingers: dict[str, _Finger] = {}
        for k, finger in enumerate(errors.fingers):
            rows = np.flatnonzero(self.finger == k)
            wrenches = np.array([grasps[i].wrenches[finger] for i in self.grasp[rows]], dtype=float).reshape(-1, 6)
            self._fingers[finger] = _Finger(rows, self.grasp[rows], wrenches, self.times[self.grasp[rows]])

    def touches(self, unit: FloatArray) -> GraspContacts:
        """The contacts for given errors of the hand.

        Args:
            unit: the free errors in units of their standard deviations, shape (f,).
        """
        errors, count, vector = self._errors, len(self.grasp), self.vector(unit)
        p, n, J = np.zeros((count, 3)), np.tile([0.0, 0.0, 1.0], (count, 1)), np.zeros((count, 6, len(vector)))
        valid, in_sensor = np.zeros(count, dtype=np.bool_), np.zeros((count, 6))
        for finger, felt in self._fingers.items():
            own = errors.of_finger(vector, finger)
            F_S, surface = felt.without(own), thicker(self._hand.surfaces[finger], own.radius)
            solutions, by_point, by_turn = contact_gains(F_S, surface, self._hand.layers.get(finger))
            valid[felt.rows] = solutions.valid
            R_SM, p_SM = exp_so3(own.mounting[:3]), own.mounting[3:]
            turned = solutions.p_SC @ R_SM.T
            in_sensor[felt.rows] = np.column_stack([turned + p_SM, solutions.n_S @ R_SM.T])
            moved = np.concatenate([R_SM @ by_point, R_SM @ by_turn], axis=1)
            block = np.zeros((len(felt.rows), 6, len(vector)))
            block[:, :, errors.place(finger, "bias")] = -moved[:, :, :6]
            block[:, :, errors.place(finger, "drift")] = -felt.times[:, None, None] * moved[:, :, :6]
            block[:, :, errors.place(finger, "radius")] = moved[:, :, 6:]
            start = errors.place(finger, "mounting").start
            block[:, :3, start : start + 3] = -skew(turned)
            block[:, :3, start + 3 : start + 6] = np.eye(3)
            block[:, 3:, start : start + 3] = np.eye(3)
            J[felt.rows] = block
        q = self._readings - self._gains @ errors.offsets(vector)
        for g in np.unique(self.grasp[valid]):
            self._kinematics.move(q[g])
            X_P = self._kinematics.poses(self._hand.sensor_frames)
            for row in np.flatnonzero(valid & (self.grasp == g)):
                finger = errors.fingers[self.finger[row]]
                X, p_SC = X_P[finger].GetAsMatrix34(), in_sensor[row, :3]
                p[row], n[row] = X[:, :3] @ p_SC + X[:, 3], -(X[:, :3] @ in_sensor[row, 3:])
                J[row] = (X[:, :3] @ J[row].reshape(2, 3, -1)).reshape(6, -1)
                by_joints = self._kinematics.jacobian(self._hand.sensor_frames[finger], p_SC) @ self._gains
                J[row, :3, : len(errors.joints)], J[row, 3:, : len(errors.joints)] = -by_joints[3:], -by_joints[:3]
        J[~valid] = 0.0
        scaled = J[:, :, errors.free] * errors.sigma[errors.free]
        return GraspContacts(self.grasp, p, n / np.linalg.norm(n, axis=1, keepdims=True), scaled, valid)

    def without_contact(self, unit: FloatArray) -> dict[str, str]:
        """The fingers that touch but none of whose wrenches gives a contact, with the most common reason.

        Args:
            unit: the free errors in units of their standard deviations, shape (f,).
        """
        found, vector = {}, self.vector(unit)
        for finger, felt in self._fingers.items():
            own = self._errors.of_finger(vector, finger)
            surface = thicker(self._hand.surfaces[finger], own.radius)
            solutions = solve_contacts(felt.without(own), surface, layer=self._hand.layers.get(finger))
            if len(solutions) and not solutions.valid.any():
                found[finger] = Counter(solutions.reason.tolist()).most_common(1)[0][0]
        return found

    def vector(self, unit: FloatArray) -> FloatArray:
        """All errors in SI units, shape (d,), from the free errors in units of their standard deviations."""
        errors, vector = self._errors, np.zeros(len(self._errors.sigma))
        vector[errors.free] = errors.sigma[errors.free] * unit
        return vector

    def wrench_noise(self) -> ContactSigmas:
        """Standard deviations of the contacts' normals by the sensors' noise alone; the largest if there is no contact.

        Points get none: noise moves them along the fingertip's surface, where their distance to the object's surface
        hardly changes.
        """
        normal = np.full(len(self.grasp), np.nan)
        for finger, felt in self._fingers.items():
            surface, layer = self._hand.surfaces[finger], self._hand.layers.get(finger)
            solutions = solve_contacts(felt.wrenches, surface, layer=layer)
            noise = contact_covariance(
                solutions, surface, layer=layer, sigma_moment=NANO17_SIGMA_MOMENT, sigma_force=NANO17_SIGMA_FORCE
            )
            normal[felt.rows] = np.sqrt(0.5 * np.trace(noise.n, axis1=1, axis2=2))
        largest = float(np.nanmax(normal, initial=0.0))
        return ContactSigmas(np.zeros(len(normal)), np.where(np.isnan(normal), largest, normal))

    def readings(self, grasps: Sequence[RecordedGrasp]) -> tuple[FloatArray, FloatArray]:
        """Linear measurements of the biases by readings out of touch: whitened rows (m, f), and their values (m,).

        If the readings of a sensor scatter by more than its noise, their noise is increased accordingly.
        """
        errors, rows, values = self._errors, [], []
        for finger in errors.fingers:
            silent = [k for k, grasp in enumerate(grasps) if finger in grasp.out_of_touch]
            wrenches = np.array([grasps[k].out_of_touch[finger] for k in silent], dtype=float).reshape(-1, 6)
            noise = READING_NOISE * _scatter(
                self.times[silent], wrenches, bool(errors.sigma[errors.place(finger, "drift")].any())
            )
            for time, wrench in zip(self.times[silent], wrenches, strict=True):
                block = np.zeros((6, len(errors.sigma)))
                block[:, errors.place(finger, "bias")] = np.eye(6)
                block[:, errors.place(finger, "drift")] = time * np.eye(6)
                rows.append((block * errors.sigma)[:, errors.free] / noise[:, None])
                values.append(wrench / noise)
        if not rows:
            return np.zeros((0, len(errors.free))), np.zeros(0)
        return np.concatenate(rows), np.concatenate(values)


def _scatter(times: FloatArray, wrenches: FloatArray, drifts: bool) -> FloatArray:
    """Ratio of the scatter of a sensor's readings out of touch to its noise; at least 1, shape (6,).

    Args:
        times: times of the readings, shape (m,), s.
        wrenches: the readings, shape (m, 6), N m and N.
        drifts: whether the bias may drift linearly with time.
    """
    by_time = np.column_stack([np.ones(len(times)), times])[:, : 2 if drifts else 1]
    left = wrenches - by_time @ np.linalg.lstsq(by_time, wrenches, rcond=None)[0]
    freedom = len(times) - np.linalg.matrix_rank(by_time)
    if freedom < 1:
        return np.ones(6)
    of_kinds = np.sum((left / READING_NOISE) ** 2, axis=0).reshape(2, 3).sum(axis=1) / (3.0 * freedom)
    return np.repeat(np.sqrt(np.maximum(of_kinds, 1.0)), 3)
