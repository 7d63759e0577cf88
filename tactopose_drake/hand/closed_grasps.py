"""Synthetic grasps by kinematics alone: the fingers of a hand with known errors close on an object.

They serve studies and tests that need many grasps, and predict what grasps of an object would tell about a hand. There
is no physics: other links may pass through the object, and forces are drawn at random within their friction cones.
"""

import dataclasses
import math
from typing import NamedTuple

import numpy as np
from pydrake.multibody.plant import MultibodyPlant

from tactopose_drake.core.parameter_checks import check_numbers, params_of
from tactopose_drake.core.poses import compose, exp_so3, inverse, make_poses, random_rotations, transform_points
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.surfaces import Surface
from tactopose_drake.core.validation import MOST_FRICTION, FloatArray, finite_array
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.hand.contact_gains import thicker
from tactopose_drake.hand.encoder_offsets import SLIDE
from tactopose_drake.hand.hand_errors import FingertipErrors, HandErrors
from tactopose_drake.hand.hand_in_plant import Hand, measured_joints
from tactopose_drake.hand.joint_matrices import joint_offsets
from tactopose_drake.hand.kinematics import HandKinematics
from tactopose_drake.hand.recorded_grasps import RecordedGrasp
from tactopose_drake.hand.shared_joints import shared_joints

_POSTURES = 400  # sampled postures of a finger, of which those near the object are used
_SAMPLES = 60  # points on a fingertip's surface
_NEAR = (-0.002, 0.004)  # gap between fingertip and object from which the contact is solved for, m
_TRIES = 200  # sampled poses of the object
_FINGER_TRIES = 8
_CLOSE = 1e-8  # largest residual of a contact, in rad and `_LENGTH`
_ITERATIONS = 15  # of Newton's method for a contact
_STEP = 1e-6  # of the finite differences, in rad and `_LENGTH`
_LONGEST = 0.2  # longest step of Newton's method
_BENT = (-1.0, 1.6)  # range of sampled joint positions, within the joints' limits, rad; of prismatic joints, m
_LENGTH = 0.01  # length that counts as a radian in the search for a contact, m


@dataclasses.dataclass(kw_only=True, slots=True)
class ClosedGraspParams:
    """How synthetic grasps are generated; noises are standard deviations."""

    least_fingers: int = 4  # fingers that touch, or all fingers of a hand that has fewer
    shift: float = 0.01  # largest shift of the object's middle from the grip region's, along each axis, m
    least_force: float = 0.5  # smallest normal force of a contact, N
    most_force: float = 2.5  # largest normal force of a contact, N
    friction: float = 0.4  # largest ratio of friction to normal force
    local_torque: float = 0.0005  # about the normal, standard deviation, N m
    noise_moment: float = 0.0  # of each component of the moment, N m
    noise_force: float = 0.0  # of each component of the force, N
    # Of each joint's reading, independent in each grasp, deg; for a prismatic joint, 1 deg stands for 1 mm.
    noise_joint_deg: float = 0.0
    noise_surface: float = 0.0  # of the object's surface along its normal, at each contact, m
    noise_normal_deg: float = 0.0  # of the object's normal at each contact, about each axis, deg

    def validate(self) -> None:
        """Raises InvalidInputError if a value is out of its range."""
        zero = {field.name for field in dataclasses.fields(self)} - {"least_fingers", "least_force", "most_force"}
        check_numbers("ClosedGraspParams", self, may_be_zero=zero, most={"friction": MOST_FRICTION})
        if self.most_force < self.least_force:
            raise InvalidInputError(
                f"ClosedGraspParams.most_force must be at least least_force, {self.least_force:g} N, not "
                f"{self.most_force:g}."
            )


@dataclasses.dataclass(frozen=True, eq=False)
class ClosedGrasp:
    """A synthetic grasp and its ground truth.

    Attributes:
        recorded: the hand's readings.
        X_PO: true pose of the object, shape (3, 4), m.
    """

    recorded: RecordedGrasp
    X_PO: FloatArray


class GraspCloser:
    """Generates grasps of a hand with known errors."""

    def __init__(
        self,
        plant: MultibodyPlant,
        hand: Hand,
        errors: HandErrors,
        vector: FloatArray,
        params: ClosedGraspParams | None = None,
    ) -> None:
        """Keeps a reference to the plant.

        Args:
            plant: finalized plant of the hand alone.
            hand: the hand in it, as described by its files.
            errors: the layout of the error vector.
            vector: the true hand's errors, shape (d,), SI units.
            params: how grasps are generated.

        Raises:
            InvalidInputError: if fingers share a joint, since they are closed independently, or a number is out of its
                range.
        """
        for joint, fingers in shared_joints(hand.config).items():
            raise InvalidInputError(
                f"hand must have fingers with separate joints, but {joint} moves {', '.join(fingers)}."
            )
        self._params = params_of(ClosedGraspParams, params)
        self._plant, self._hand, self._errors = plant, hand, errors
        self._vector = finite_array("vector", vector, (len(errors.sigma),))
        self._least = min(self._params.least_fingers, len(errors.fingers))
        self._kinematics = HandKinematics(plant, hand.palm_frame)
        self._gains = errors.gains(plant, hand)
        self._constant = joint_offsets(plant, hand, measured_joints(plant, hand))
        joints = [plant.GetJointByName(name, hand.model_instance) for name in errors.joints]
        limits = np.array([[j.position_lower_limits()[0], j.position_upper_limits()[0]] for j in joints])
        self._low, self._high = np.clip(limits, *_BENT).T
        self._rest = np.clip(0.0, self._low, self._high)
        self._noise_joint = math.radians(self._params.noise_joint_deg) * np.where(errors.slides, SLIDE, 1.0)
        draw = np.random.default_rng(0)
        self._postures: dict[str, tuple[FloatArray, FloatArray]] = {}  # of each finger's joints, and X_PM at them
        for finger in errors.fingers:
            moves = np.isin(errors.joints, hand.config.finger(finger).joints)
            positions = np.where(moves, draw.uniform(self._low, self._high, (_POSTURES, len(moves))), self._rest)
            self._postures[finger] = positions, np.array([self._X_PM(finger, row) for row in positions])

    def grasp(self, model: ObjectModel, generator: np.random.Generator, time: float | None = None) -> ClosedGrasp:
        """Generates a grasp of an object at a random pose in the hand.

        Args:
            model: the object.
            generator: source of the pose, of the contacts and of all noise.
            time: time since the biases were those of the error vector, s; None if they do not drift.

        Raises:
            InvalidInputError: if the hand's file has no grip region, the fingers do not reach the object, or the time
                is no finite number.
        """
        time = None if time is None else float(finite_array("time", time, ()))
        config = self._hand.config
        if not config.grip_low or not config.grip_high:
            raise InvalidInputError(
                "hand must have grip_low and grip_high, the corners of the grip region in P, m, but its file lacks "
                "them."
            )
        middle = 0.5 * (np.array(config.grip_low) + np.array(config.grip_high))
        for _ in range(_TRIES):
            R_PO = random_rotations(generator, 1)[0]
            shift = generator.uniform(-1.0, 1.0, 3) * self._params.shift
            X_PO = np.column_stack([R_PO, middle + shift - R_PO @ model.middle])
            positions, contacts = self._close(model, X_PO, generator)
            if len(contacts) >= self._least:
                wrenches = {f: self._wrench(f, contact, time or 0.0, generator) for f, contact in contacts.items()}
                noise = self._noise_joint * generator.normal(size=len(positions))
                readings = positions + self._errors.offsets(self._vector) + noise
                named = dict(zip(self._errors.joints, readings.tolist(), strict=True))
                return ClosedGrasp(RecordedGrasp(model, named, wrenches, time=time), X_PO)
        raise InvalidInputError(f"{model.name}: the hand's fingers do not reach it in {_TRIES} tries.")

    def _close(
        self, model: ObjectModel, X_PO: FloatArray, generator: np.random.Generator
    ) -> tuple[FloatArray, dict[str, "_Contact"]]:
        """True positions of the measured joints, and the contact of each finger that touches."""
        positions, fingers = self._rest, self._errors.fingers
        contacts: dict[str, _Contact] = {}
        for left, finger in zip(range(len(fingers), 0, -1), fingers, strict=True):
            if len(contacts) + left < self._least:
                break
            surface = thicker(self._hand.surfaces[finger], self._own(finger).radius)
            p_SQ = surface.sample(generator, _SAMPLES)
            of_finger, X_PM = self._postures[finger]
            gaps = model.grid.distance(transform_points(compose(inverse(X_PO), X_PM), p_SQ))
            least = gaps.min(axis=1)
            near = np.flatnonzero((least > _NEAR[0]) & (least < _NEAR[1]))
            for k in generator.permutation(near)[:_FINGER_TRIES]:
                start = p_SQ[int(np.argmin(gaps[k]))]
                found = self._contact(finger, surface, of_finger[k], start, model, X_PO, generator)
                if found is not None:
                    positions = np.where(found.positions != self._rest, found.positions, positions)
                    contacts[finger] = found
                    break
        return positions, contacts

    def _contact(
        self,
        finger: str,
        surface: Surface,
        near: FloatArray,
        start: FloatArray,
        model: ObjectModel,
        X_PO: FloatArray,
        generator: np.random.Generator,
    ) -> "_Contact | None":
        """The contact of a finger that closes from a posture near the object; None if none is found."""
        way = np.where(near != self._rest, generator.uniform(0.3, 1.0, len(near)), 0.0)
        layer = self._hand.layers.get(finger)
        depth = 0.0 if layer is None else self._push(generator) / layer.stiffness
        gap = self._params.noise_surface * generator.normal()
        turn = exp_so3(math.radians(self._params.noise_normal_deg) * generator.normal(size=3))
        X_OP, x = inverse(X_PO), np.concatenate([[0.0], start / _LENGTH])

        def residuals(share: float, points: FloatArray) -> FloatArray:
            X_OM, p = compose(X_OP, self._X_PM(finger, near + share * way)), _LENGTH * points
            n = surface.normal(p)
            phi, n_O = model.grid.distance_and_normal(transform_points(X_OM, p - depth * n))
            facing = n_O @ turn.T + n @ X_OM[:, :3].T
            return np.column_stack([surface.value(p), (phi - gap) / _LENGTH, facing])

        for _ in range(_ITERATIONS):
            steps = np.concatenate([np.zeros((1, 3)), _STEP * np.eye(3)])
            at = residuals(x[0], x[1:] + steps)
            if np.abs(at[0]).max() < _CLOSE:
                break
            by_share = residuals(x[0] + _STEP, x[None, 1:])[0] - at[0]
            J = np.column_stack([by_share, *(at[1:] - at[0])]) / _STEP
            step = np.linalg.lstsq(J, -at[0], rcond=1e-9)[0]
            x += step * min(1.0, _LONGEST / np.abs(step).max())
        else:
            return None
        positions, p_SQ = near + x[0] * way, _LENGTH * x[1:]
        if np.any((positions < self._low) | (positions > self._high)):
            return None
        if (surface.X_SF[:, :3].T @ (p_SQ - surface.X_SF[:, 3]))[2] < surface.shape[5]:  # below the touchable part
            return None
        n_S = surface.normal(p_SQ[None])[0]
        return _Contact(positions, p_SQ - depth * n_S, n_S, None if layer is None else depth * layer.stiffness)

    def _X_PM(self, finger: str, positions: FloatArray) -> FloatArray:
        """True pose of the sensor with its fingertip in the palm, shape (3, 4)."""
        self._kinematics.move(self._gains @ positions + self._constant)
        X_PS = self._kinematics.poses({finger: self._hand.sensor_frames[finger]})[finger].GetAsMatrix34()
        mounting = self._own(finger).mounting
        return compose(X_PS, make_poses(exp_so3(mounting[:3]), mounting[3:]))

    def _push(self, generator: np.random.Generator) -> float:
        """Draws a contact's normal force, N."""
        return generator.uniform(self._params.least_force, self._params.most_force)

    def _wrench(self, finger: str, contact: "_Contact", time: float, generator: np.random.Generator) -> FloatArray:
        """The sensor's reading, shape (6,), N m and N."""
        params, own, p, n = self._params, self._own(finger), contact.p_SC, contact.n_S
        push = self._push(generator) if contact.push is None else contact.push
        across = np.cross(n, generator.normal(size=3))
        across *= generator.uniform(0.0, params.friction) * push / np.linalg.norm(across)
        force = across - push * n
        moment = np.cross(p, force) + params.local_torque * generator.normal() * n
        noise = generator.normal(size=6) * np.repeat([params.noise_moment, params.noise_force], 3)
        wrench: FloatArray = np.concatenate([moment, force]) + own.bias + time * own.drift + noise
        return wrench

    def _own(self, finger: str) -> FingertipErrors:
        return self._errors.of_finger(self._vector, finger)


class _Contact(NamedTuple):
    """A finger's contact.

    Attributes:
        positions: joint positions, shape (k,); joints of other fingers are at 0 or the limit nearest to it.
        p_SC: the contact point on the deformed soft layer, shape (3,), m.
        n_S: the fingertip's outward normal there, shape (3,).
        push: the normal force, N; None without a soft layer, as the point then does not depend on it.
    """

    positions: FloatArray
    p_SC: FloatArray
    n_S: FloatArray
    push: float | None
