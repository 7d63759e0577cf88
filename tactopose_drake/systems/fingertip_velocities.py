"""The fingertips' velocities in the palm, as a system."""

from collections.abc import Mapping

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame
from pydrake.systems.framework import Context

from tactopose_drake.core.validation import FloatArray, instance_of
from tactopose_drake.systems.collectable_system import CollectableSystem
from tactopose_drake.systems.hand_kinematics import declare_kinematics


class FingertipVelocities(CollectableSystem):
    """Computes the velocities of the fingertips in the palm from the hand's Jacobians.

    .. pydrake_system::

        name: FingertipVelocities
        input_ports:
        - joint_positions
        - joint_velocities
        output_ports:
        - tip_velocities

    - joint_positions: measured positions of the hand's joints, shape (nq,) of the hand's own plant, rad.
    - joint_velocities: of the same joints, shape (nv,), rad/s; may stay unconnected.
    - tip_velocities: dict of spatial velocities [w, v] in P by finger, shape (6,) each, rad/s and m/s; v is that of the
      fingertip's point at the origin of P. None while a position or velocity is unknown. Changes with either input.
    """

    def __init__(self, plant: MultibodyPlant, tip_frames: Mapping[str, Frame], palm_frame: Frame) -> None:
        """Keeps a reference to the plant.

        Args:
            plant: finalized plant of the hand alone, for kinematics; not the simulator's.
            tip_frames: a frame on each finger's tip, by finger.
            palm_frame: P.
        """
        super().__init__()
        instance_of("plant", plant, MultibodyPlant)
        instance_of("tip_frames", tip_frames, Mapping)
        instance_of("palm_frame", palm_frame, Frame)
        self._tip_frames = dict(tip_frames)
        self._positions = self.DeclareVectorInputPort("joint_positions", plant.num_positions())
        self._velocities = self.DeclareVectorInputPort("joint_velocities", plant.num_velocities())
        self._kinematics = declare_kinematics(self, plant, palm_frame, self._positions)
        needs = {self._kinematics.ticket(), self._velocities.ticket()}
        self.declare_output("tip_velocities", None, self._tip_velocities, needs)

    def _tip_velocities(self, context: Context) -> dict[str, FloatArray] | None:
        v = np.array([np.nan])
        if self._velocities.HasValue(context):
            v = self._velocities.Eval(context)
        kinematics = self._kinematics.Eval(context)
        if not (kinematics.knows_all and np.all(np.isfinite(v))):
            return None
        with np.errstate(over="ignore", invalid="ignore"):  # Readers of the port reject what is not finite.
            return {finger: kinematics.velocity(frame, v) for finger, frame in self._tip_frames.items()}
