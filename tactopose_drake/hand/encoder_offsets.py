"""Which joints of a hand have encoders, how far these may be off, and what an error of one moves."""

import math
from typing import NamedTuple

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import PrismaticJoint

from tactopose_drake.core.validation import FloatArray
from tactopose_drake.hand.hand_config import HandUncertainty
from tactopose_drake.hand.hand_in_plant import Hand, measured_joints
from tactopose_drake.hand.joint_matrices import joint_matrix

SLIDE = 0.001 / math.radians(1.0)  # m of a sliding joint that count as a radian


def radian_units(plant: MultibodyPlant) -> FloatArray:
    """How much of each of a plant's positions counts as a radian, shape (nq,): of what slides, `SLIDE` m."""
    units = np.ones(plant.num_positions())
    for joint in (plant.get_joint(index) for index in plant.GetJointIndices()):
        if isinstance(joint, PrismaticJoint):
            units[joint.position_start()] = SLIDE
    return units


class EncoderGains(NamedTuple):
    """The encoders of a hand.

    Attributes:
        joints: that have one, by name.
        gains: what an error of a radian of each adds to the plant's positions, shape (nq, k); of a joint that slides, 1
            degree counts as 1 mm.
    """

    joints: tuple[str, ...]
    gains: FloatArray


def encoder_gains(plant: MultibodyPlant, hand: Hand) -> EncoderGains:
    """The encoders: one on each joint that follows no other.

    Args:
        plant: finalized plant of the hand alone.
        hand: the hand in it.
    """
    names = measured_joints(plant, hand)
    joints = [plant.GetJointByName(name, hand.model_instance) for name in names]
    units = np.array([SLIDE if isinstance(joint, PrismaticJoint) else 1.0 for joint in joints])
    return EncoderGains(names, joint_matrix(plant, hand, names) * units)


def offset_sigmas(plant: MultibodyPlant, hand: Hand, uncertainty: HandUncertainty) -> FloatArray:
    """How far each encoder may be off, standard deviations, shape (k,), rad; of a joint that slides as `EncoderGains`.

    That is what the hand's calibration has left of its offset, where it has found one, and what is declared of others.

    Args:
        plant: finalized plant of the hand alone.
        hand: the hand in it.
        uncertainty: what is declared.
    """
    names = measured_joints(plant, hand)
    sigma = np.full(len(names), math.radians(uncertainty.encoder_offset_deg))
    found = {} if hand.calibration is None else hand.calibration.joint_offsets
    for k, name in enumerate(names):
        if name in found:
            slides = isinstance(plant.GetJointByName(name, hand.model_instance), PrismaticJoint)
            sigma[k] = found[name].sigma / SLIDE if slides else math.radians(found[name].sigma)
    return sigma
