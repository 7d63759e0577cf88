"""The palm's pose in the world, from an arm or from a fixed base."""

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Context

from tactopose_drake.hand.hand_in_plant import Hand
from tactopose_drake.systems.collectable_system import CollectableSystem
from tactopose_drake.systems.hand_kinematics import declare_kinematics
from tactopose_drake.systems.ports import eval_optional_input


class PalmOnBase(CollectableSystem):
    """Passes on the palm's pose if it is connected, and else computes it from the measured joints and a fixed base.

    .. pydrake_system::

        name: PalmOnBase
        input_ports:
        - joint_positions
        - palm_pose
        output_ports:
        - palm_pose

    - joint_positions: measured positions of the hand's joints, shape (nq,) of the hand's own plant, rad.
    - palm_pose (input): `RigidTransform` X_WP of a hand that an arm moves; may stay unconnected if the base is fixed.
    - palm_pose (output): `RigidTransform` X_WP; computed from the base, its position is NaN while a joint between base
      and palm is unknown.
    """

    def __init__(self, plant: MultibodyPlant, hand: Hand, X_WBase: RigidTransform) -> None:
        """Keeps a reference to the plant.

        Args:
            plant: finalized plant of the hand alone, for kinematics.
            hand: the hand in it.
            X_WBase: pose of its base in the world, unless an arm moves it.
        """
        super().__init__()
        self._X_WBase, self._palm = X_WBase, {"palm": hand.palm_frame}
        base = plant.GetFrameByName(hand.config.base_link, hand.model_instance)
        positions = self.DeclareVectorInputPort("joint_positions", plant.num_positions())
        self._known = self.DeclareAbstractInputPort("palm_pose", AbstractValue.Make(RigidTransform()))
        self._kinematics = declare_kinematics(self, plant, base, positions)
        needs = {self._kinematics.ticket(), self._known.ticket()}
        self.declare_output("palm_pose", RigidTransform(), self._palm_pose, needs)

    def _palm_pose(self, context: Context) -> RigidTransform:
        known = eval_optional_input(self._known, context, RigidTransform)
        if known is not None:
            return known
        poses = self._kinematics.Eval(context).poses(self._palm)
        return self._X_WBase @ poses["palm"] if poses else RigidTransform(np.full(3, np.nan))
