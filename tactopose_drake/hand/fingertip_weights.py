"""The fingertips' weights at their sensors, for any joint positions."""

import copy
from typing import Any

import numpy as np
from pydrake.math import RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame, Joint, RigidBody, WeldJoint

from tactopose_drake.core.sensing.force_torque import GRAVITY_W, weight_matrix
from tactopose_drake.core.validation import FloatArray, instance_of
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.hand.finger_chain import welded_bodies
from tactopose_drake.hand.hand_in_plant import Hand
from tactopose_drake.hand.kinematics import HandKinematics


def fingertip_mass(plant: MultibodyPlant, weld: Joint, sensor_frame: Frame) -> tuple[float, FloatArray]:
    """Mass, kg, and centre of mass p_STipcm, shape (3,), m, of the fingertip behind a weld and all bodies fixed to it.

    Args:
        plant: finalized plant that holds the hand.
        weld: joint between finger (parent) and fingertip (child); S is on the fingertip if it moves.
        sensor_frame: S, fixed on the finger or on the fingertip.

    Raises:
        InvalidInputError: as `check_sensor_frame`.
    """
    check_sensor_frame(plant, weld, sensor_frame)
    bodies = [body.index() for body in _bodies_fixed_on(plant, weld.child_body())]
    inertia = plant.CalcSpatialInertia(plant.CreateDefaultContext(), sensor_frame, bodies)
    return float(inertia.get_mass()), inertia.get_com()


def check_sensor_frame(plant: MultibodyPlant, weld: Joint, sensor_frame: Frame) -> None:
    """Raises InvalidInputError if a sensor frame is not fixed to the link behind its weld, whose load it measures."""
    bodies = [plant.get_body(index) for index in sorted(welded_bodies(plant, weld.frame_on_child()))]
    if sensor_frame.body().index() not in {body.index() for body in bodies}:
        links = ", ".join(body.name() for body in bodies)
        raise InvalidInputError(
            f"the sensor frame {sensor_frame.name()!r} of the weld {weld.name()!r} must be on one of the links "
            f"{links}, not on {sensor_frame.body().name()!r}."
        )


class FingertipWeights:
    """The fingertips' weights, from the masses in the hand's model."""

    def __init__(self, plant: MultibodyPlant, hand: Hand, R_WBase: RotationMatrix) -> None:
        """Keeps a reference to the plant.

        Args:
            plant: finalized plant of the hand alone.
            hand: the hand in it.
            R_WBase: orientation of a fixed base in the real world, whose z points up.
        """
        instance_of("plant", plant, MultibodyPlant)
        instance_of("hand", hand, Hand)
        instance_of("R_WBase", R_WBase, RotationMatrix)
        base = plant.GetFrameByName(hand.config.base_link, hand.model_instance)
        self._on_base, self._frames = HandKinematics(plant, base), hand.sensor_frames
        self._on_palm = HandKinematics(plant, hand.palm_frame)
        self._g_Base = R_WBase.inverse() @ GRAVITY_W
        self._per_gravity: dict[str, FloatArray] = {}  # (6, 3): the weight's wrench is this times gravity in S
        for finger, weld in hand.welds.items():
            mass, p_STipcm = fingertip_mass(plant, weld, self._frames[finger])
            self._per_gravity[finger] = weight_matrix(mass, p_STipcm)

    def __deepcopy__(self, memo: Any) -> "FingertipWeights":
        copied = copy.copy(self)
        copied._on_base, copied._on_palm = copy.deepcopy((self._on_base, self._on_palm), memo)
        return copied

    def wrenches(self, q: FloatArray, R_WP: RotationMatrix | None = None) -> dict[str, FloatArray]:
        """The wrench of each fingertip's weight about the origin of its sensor's frame S, in S, by finger.

        Args:
            q: positions of the hand's joints, shape (nq,), rad; NaN where unknown. A position far beyond its limits
                counts as unknown, too.
            R_WP: orientation of the palm in the real world, of a hand that an arm moves; None: the base is fixed.

        Returns:
            Shape (6,) each, N m and N; NaN if a joint between the sensor and the palm (without R_WP: the base) is
            unknown.
        """
        on, gravity = self._on_base, self._g_Base
        if R_WP is not None:
            on, gravity = self._on_palm, R_WP.inverse() @ GRAVITY_W
        on.move_to_readings(q)
        wrenches = {finger: np.full(6, np.nan) for finger in self._frames}
        for finger, X_S in on.poses(self._frames).items():
            wrenches[finger] = self._per_gravity[finger] @ (X_S.rotation().matrix().T @ gravity)
        return wrenches


def _bodies_fixed_on(plant: MultibodyPlant, body: RigidBody) -> list[RigidBody]:
    """A body and the bodies that fixed joints attach to it, outwards."""
    joints = [plant.get_joint(index) for index in plant.GetJointIndices()]
    welds = [joint for joint in joints if isinstance(joint, WeldJoint)]
    bodies = [body]
    for parent in bodies:  # The list grows during the loop.
        bodies += [weld.child_body() for weld in welds if weld.parent_body().index() == parent.index()]
    return bodies
