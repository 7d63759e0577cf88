"""The order of a hand's joints in its own positions, velocities and actuators, whatever else is in the plant.

Also the arms by which joints that slide are compared with those that turn.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import NDArray
from pydrake.multibody.plant import MultibodyPlant

from tactopose_drake.core.grasping.serial_chain import SLIDING_ARM
from tactopose_drake.core.validation import FloatArray
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.hand.hand_config import Coupling
from tactopose_drake.hand.hand_in_plant import Hand, joints_of, sliding_joints


@dataclasses.dataclass(frozen=True, eq=False)
class HandJoints:
    """The order of a hand's joints.

    Attributes:
        position: index of each moving joint's position among the hand's, by the joint's name.
        velocity: likewise for velocities.
        actuated: names of the joints that the hand's actuators drive, in the order of the actuation port.
    """

    position: Mapping[str, int]
    velocity: Mapping[str, int]
    actuated: tuple[str, ...]

    @classmethod
    def of(cls, plant: MultibodyPlant, hand: Hand) -> HandJoints:
        """The order in a finalized plant that holds the hand.

        Raises:
            InvalidInputError: if the hand is in another plant.
        """
        if hand.palm_frame.GetParentPlant() is not plant:
            raise InvalidInputError("hand must be in this plant, but is in another.")
        joints = joints_of(plant, hand)
        moving = [joint for joint in joints if joint.num_positions() > 0]
        # Joints of bodies that are attached to a finger may be between the hand's joints in the plant.
        q = plant.GetPositionsFromArray(hand.model_instance, np.arange(float(plant.num_positions()))).tolist()
        v = plant.GetVelocitiesFromArray(hand.model_instance, np.arange(float(plant.num_velocities()))).tolist()
        actuators = plant.GetJointActuatorIndices(hand.model_instance)
        return cls(
            {joint.name(): q.index(joint.position_start()) for joint in moving},
            {joint.name(): v.index(joint.velocity_start()) for joint in moving},
            tuple(plant.get_joint_actuator(index).joint().name() for index in actuators),
        )

    def positions(self, joints: Iterable[str]) -> NDArray[np.int64]:
        """Indices of the given joints' positions, shape (k,)."""
        return np.array([self.position[name] for name in joints], dtype=np.int64)

    def with_followers(self, q: FloatArray, couplings: Mapping[str, Coupling]) -> FloatArray:
        """The hand's positions (nq,), with each coupled joint set from the joint that it follows."""
        followed = q.copy()
        for joint, coupling in couplings.items():
            followed[self.position[joint]] = coupling.ratio * q[self.position[coupling.follows]] + coupling.offset
        return followed

    def velocities(self, joints: Iterable[str]) -> NDArray[np.int64]:
        """Indices of the given joints' velocities, shape (k,)."""
        return np.array([self.velocity[name] for name in joints], dtype=np.int64)


def joint_arms(plant: MultibodyPlant, hand: Hand, joints: Iterable[str]) -> FloatArray:
    """The motion of each of the hand's joints that counts as 1 rad, shape (k,): 1, or `SLIDING_ARM` if it slides."""
    sliding = sliding_joints(plant, hand)
    return np.array([SLIDING_ARM if name in sliding else 1.0 for name in joints])
