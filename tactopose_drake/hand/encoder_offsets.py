"""The encoders of a hand: their joints, the uncertainty of their offsets, and the joints that each one moves."""

import math
from typing import NamedTuple

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import PrismaticJoint

from tactopose_drake.core.validation import FloatArray
from tactopose_drake.hand.hand_config import HandUncertainty
from tactopose_drake.hand.hand_in_plant import Hand, measured_joints, sliding_joints
from tactopose_drake.hand.joint_matrices import joint_matrix

SLIDE = 0.001 / math.radians(1.0)  # m of a prismatic joint that count as a radian, so that 1 mm counts as 1 degree


def radian_units(plant: MultibodyPlant) -> FloatArray:
    """The amount of each of a plant's positions that counts as a radian, shape (nq,): `SLIDE` m if prismatic."""
    units = np.ones(plant.num_positions())
    for joint in (plant.get_joint(index) for index in plant.GetJointIndices()):
        if isinstance(joint, PrismaticJoint):
            units[joint.position_start()] = SLIDE
    return units


class EncoderGains(NamedTuple):
    """The encoders of a hand.

    Attributes:
        joints: names of the joints that have one.
        gains: derivative of the plant's positions by each encoder's error in rad, shape (nq, k); for a prismatic joint,
            1 degree stands for 1 mm.
    """

    joints: tuple[str, ...]
    gains: FloatArray


def encoder_gains(plant: MultibodyPlant, hand: Hand) -> EncoderGains:
    """The encoders of a hand: one on each joint that is not coupled to another.

    Args:
        plant: finalized plant of the hand alone.
        hand: the hand in it.
    """
    names, sliding = measured_joints(plant, hand), sliding_joints(plant, hand)
    units = np.array([SLIDE if name in sliding else 1.0 for name in names])
    return EncoderGains(names, joint_matrix(plant, hand, names) * units)


def offset_sigmas(plant: MultibodyPlant, hand: Hand, uncertainty: HandUncertainty) -> FloatArray:
    """Standard deviations of the encoders' offsets, shape (k,), rad; for prismatic joints as in `EncoderGains`.

    For an offset that the hand's calibration has found, this is its remaining uncertainty, for others the declared one.

    Args:
        plant: finalized plant of the hand alone.
        hand: the hand in it.
        uncertainty: the declared uncertainty.
    """
    names, sliding = measured_joints(plant, hand), sliding_joints(plant, hand)
    sigma = np.full(len(names), math.radians(uncertainty.encoder_offset_deg))
    found = {} if hand.calibration is None else hand.calibration.joint_offsets
    for k, name in enumerate(names):
        if name in found:
            sigma[k] = found[name].sigma / SLIDE if name in sliding else math.radians(found[name].sigma)
    return sigma
