"""Covariance of the poses of a hand's tactile arrays that results from the hand's own errors.

To first order, an array is moved by the joints' offsets through the finger's Jacobian, and by its mounting error. All
cells of an array share one shift and one rotation. The effects of a joint on arrays of two fingers that share it are
treated as independent.
"""

import math

import numpy as np
from pydrake.multibody.plant import MultibodyPlant

from tactopose_drake.core.sensing.tactile_layout import TactileLayout
from tactopose_drake.core.validation import FloatArray
from tactopose_drake.hand.encoder_offsets import encoder_gains, offset_sigmas
from tactopose_drake.hand.hand_config import HandUncertainty
from tactopose_drake.hand.hand_in_plant import Hand
from tactopose_drake.hand.kinematics import HandKinematics


class PadUncertainty:
    """Computes the covariance of the poses of a hand's tactile arrays from its declared errors."""

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
