"""The palm's pose in the world, from a plant's body poses."""

from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.multibody.tree import Frame
from pydrake.systems.framework import Context

from tactopose_drake.core.validation import instance_of
from tactopose_drake.systems.collectable_system import CollectableSystem
from tactopose_drake.systems.ports import eval_input


class PalmPose(CollectableSystem):
    """Selects the palm's pose from those of all bodies.

    .. pydrake_system::

        name: PalmPose
        input_ports:
        - body_poses
        output_ports:
        - palm_pose

    - body_poses: list of `RigidTransform` X_WB, the plant's port of that name.
    - palm_pose: `RigidTransform` X_WP; changes with it.
    """

    def __init__(self, palm_frame: Frame) -> None:
        """Takes numbers from the frame P of a finalized plant; keeps no reference to it."""
        super().__init__()
        instance_of("palm_frame", palm_frame, Frame)
        self._body, self._X_BP = int(palm_frame.body().index()), palm_frame.GetFixedPoseInBodyFrame()
        self._body_poses = self.DeclareAbstractInputPort("body_poses", AbstractValue.Make([RigidTransform()]))
        self.declare_output("palm_pose", RigidTransform(), self._palm_pose, {self._body_poses.ticket()})

    def _palm_pose(self, context: Context) -> RigidTransform:
        return eval_input(self._body_poses, context, list)[self._body] @ self._X_BP
