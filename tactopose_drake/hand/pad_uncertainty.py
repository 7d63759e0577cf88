"""How far a hand's own errors misplace its tactile arrays.

To first order: the joints' offsets move an array by the finger's Jacobian, and it is mounted elsewhere and otherwise.
So all cells of an array are off together, by one shift and one turn. Of a joint that two fingers share, what it does
to both of their arrays is taken for two errors.
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
    """How far a hand's tactile arrays may be off by what its description says of its errors."""

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
        """Of an array's shift and its small turn about the mean of its cells, in P, shape (6, 6), m and rad.

        Args:
            pad: whose it is.
            layout: its cells.
            kinematics: of the hand, moved to where the joints are.
        """
        J = kinematics.jacobian(self._frames[pad], layout.p_TC.mean(axis=0)) @ self._offsets
        by_joints = np.concatenate([J[3:], J[:3]])
        covariance: FloatArray = by_joints @ by_joints.T + self._mounted
        return covariance
