"""Where a hand's joints are among its own positions, velocities and actuators."""

from pathlib import Path

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import RevoluteJoint, SpatialInertia

from tactopose_drake.hand.hand_config import load_hand_config
from tactopose_drake.hand.hand_in_plant import add_hand
from tactopose_drake.hand.hand_joints import HandJoints
from tests.hand.grippers import write_gripper


def test_what_hangs_on_a_finger_by_a_joint_of_its_own_is_not_counted(tmp_path: Path) -> None:
    plant = MultibodyPlant(0.002)
    hand = add_hand(plant, load_hand_config(write_gripper(tmp_path)), RigidTransform())
    flap = plant.AddRigidBody("flap", plant.AddModelInstance("cover"), SpatialInertia.SolidSphereWithMass(0.01, 0.01))
    tip = plant.GetFrameByName("left_tip")
    plant.AddJoint(RevoluteJoint("hinge", tip, flap.body_frame(), [1.0, 0.0, 0.0]))
    plant.Finalize()
    starts = [plant.GetJointByName(name).position_start() for name in ("left_slide", "hinge", "right_slide")]
    assert starts == sorted(starts), "it stands between the hand's"
    joints = HandJoints.of(plant, hand)
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, np.arange(1.0, 4.0))
    plant.SetVelocities(context, np.arange(4.0, 7.0))
    q = plant.GetPositions(context, hand.model_instance)
    v = plant.GetVelocities(context, hand.model_instance)
    for name in ("left_slide", "right_slide"):
        joint = plant.GetJointByName(name)
        assert q[joints.position[name]] == joint.get_translation(context)
        assert v[joints.velocity[name]] == joint.get_translation_rate(context)
