"""What the fingertips weigh at their sensors, for any position of the joints."""

import numpy as np
from pydrake.math import RotationMatrix
from pydrake.multibody.plant import MultibodyPlant

from tactopose_drake.core.sensing.force_torque import weight_wrench
from tactopose_drake.core.validation import FloatArray
from tactopose_drake.hand.hand_config import Hand
from tactopose_drake.hand.kinematics import HandKinematics

_GRAVITY_W = np.array([0.0, 0.0, -9.81])  # m/s^2, Drake's default


class FingertipWeights:
    """The fingertips' weights, with the masses of the hand's model and a base that does not turn."""

    def __init__(self, plant: MultibodyPlant, hand: Hand, R_WBase: RotationMatrix) -> None:
        """Keeps a reference to the plant.

        Args:
            plant: finalized plant of the hand alone, its base welded to the world.
            hand: the hand in it.
            R_WBase: how the hand's base stands in the real world, whose z points up.
        """
        self._kinematics, self._frames = HandKinematics(plant, plant.world_frame()), hand.sensor_frames
        self._g_Base = R_WBase.inverse() @ _GRAVITY_W
        context = plant.CreateDefaultContext()
        self._per_gravity: dict[str, FloatArray] = {}  # (6, 3): the weight's wrench is this times gravity in S
        for finger, weld in hand.welds.items():
            tip = weld.child_body()
            X_STip = plant.CalcRelativeTransform(context, self._frames[finger], tip.body_frame())
            mass, p_STipcm = tip.get_mass(context), X_STip @ tip.CalcCenterOfMassInBodyFrame(context)
            self._per_gravity[finger] = np.column_stack([weight_wrench(mass, p_STipcm, axis) for axis in np.eye(3)])

    def wrenches(self, q: FloatArray) -> dict[str, FloatArray]:
        """The weight of each fingertip about the origin of its sensor's frame S, in S, by finger.

        Args:
            q: positions of the hand's joints, shape (nq,), rad; NaN where not known.

        Returns:
            Shape (6,) each, N m and N; NaN where a joint that turns the sensor is not known.
        """
        self._kinematics.move(q)
        wrenches = {finger: np.full(6, np.nan) for finger in self._frames}
        for finger, X_BaseS in self._kinematics.poses(self._frames).items():
            wrenches[finger] = self._per_gravity[finger] @ (X_BaseS.rotation().matrix().T @ self._g_Base)
        return wrenches
