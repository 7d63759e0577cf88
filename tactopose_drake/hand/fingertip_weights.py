"""What the fingertips weigh at their sensors, for any position of the joints."""

import copy
from typing import Any

import numpy as np
from pydrake.math import RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame, Joint, RigidBody, WeldJoint

from tactopose_drake.core.sensing.force_torque import GRAVITY_W, weight_matrix
from tactopose_drake.core.validation import FloatArray
from tactopose_drake.hand.hand_in_plant import Hand
from tactopose_drake.hand.kinematics import HandKinematics


def fingertip_mass(plant: MultibodyPlant, weld: Joint, sensor_frame: Frame) -> tuple[float, FloatArray]:
    """Mass, kg, and centre of mass p_STipcm, shape (3,), m, of the fingertip behind a weld and what is fixed on it.

    Args:
        plant: finalized plant that holds the hand.
        weld: joint between finger (parent) and fingertip (child); S is on the fingertip if it moves.
        sensor_frame: S, fixed on the finger or on the fingertip.
    """
    bodies = [body.index() for body in _bodies_fixed_on(plant, weld.child_body())]
    inertia = plant.CalcSpatialInertia(plant.CreateDefaultContext(), sensor_frame, bodies)
    return float(inertia.get_mass()), inertia.get_com()


class FingertipWeights:
    """The fingertips' weights, with the masses of the hand's model."""

    def __init__(self, plant: MultibodyPlant, hand: Hand, R_WBase: RotationMatrix) -> None:
        """Keeps a reference to the plant.

        Args:
            plant: finalized plant of the hand alone.
            hand: the hand in it.
            R_WBase: how the hand's base stands in the real world, whose z points up, where it does not turn.
        """
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
        """The weight of each fingertip about the origin of its sensor's frame S, in S, by finger.

        Args:
            q: positions of the hand's joints, shape (nq,), rad; NaN where not known. What is far beyond its limits is
                not known either.
            R_WP: how the palm is turned in the real world, of a hand that an arm moves; None: as its base stands.

        Returns:
            Shape (6,) each, N m and N; NaN where a joint that turns the sensor is not known: in the palm where that is
            given, and otherwise on the base.
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
    """A body and those that fixed joints carry on it, outwards."""
    joints = [plant.get_joint(index) for index in plant.GetJointIndices()]
    welds = [joint for joint in joints if isinstance(joint, WeldJoint)]
    bodies = [body]
    for parent in bodies:  # which grows
        bodies += [weld.child_body() for weld in welds if weld.parent_body().index() == parent.index()]
    return bodies
