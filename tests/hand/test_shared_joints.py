"""Joints that several fingers have in common."""

import numpy as np
import pytest

from tactopose_drake.core.grasping.finger_reach import ReachParams
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.hand.closed_grasps import GraspCloser
from tactopose_drake.hand.finger_chain import finger_chain
from tactopose_drake.hand.hand_config import FingerConfig, HandConfig, HandUncertainty, load_hand_config
from tactopose_drake.hand.hand_errors import HandErrors
from tactopose_drake.hand.hand_in_plant import make_hand_plant
from tactopose_drake.hand.hand_reach import make_hand_reach
from tactopose_drake.hand.shared_joints import held_joints, shared_joints, with_held_joints


def one_motor() -> HandConfig:
    """The Shadow-like hand as if the joint that spreads its first finger belonged to the middle finger too."""
    config = load_hand_config("shadow_like")
    config.finger("middle").joints = ["FFJ4", "MFJ4", "MFJ3", "MFJ2"]
    config.rest_positions["FFJ4"] = 0.2
    return config


def test_a_joint_of_two_fingers_rests_where_a_grasp_is_planned() -> None:
    config = one_motor()
    plant, hand = make_hand_plant(config)
    chain = finger_chain(plant, hand, "first")
    held = with_held_joints(chain, config, "first")
    assert held.lower[0] == held.upper[0] == 0.2
    np.testing.assert_array_equal(held.lower[1:], chain.lower[1:])
    for q in ([0.0, 0.3, 0.4], [-0.3, 0.3, 0.4]):
        at_rest = chain.sensor_poses(np.array([[0.2, *q[1:]]]))
        np.testing.assert_allclose(held.sensor_poses(np.array([q])), at_rest, atol=1e-12)
    reach = make_hand_reach(config, ReachParams())
    q = reach.fingers["first"].geometry.chain.lower
    assert q[0] == 0.2
    np.testing.assert_array_equal(reach.fingers["middle"].geometry.chain.upper[0], 0.2)


def test_a_rest_position_beyond_the_limits_is_at_the_limit() -> None:
    config = one_motor()
    config.rest_positions["FFJ4"] = 2.0
    plant, hand = make_hand_plant(config)
    chain = finger_chain(plant, hand, "first")
    assert with_held_joints(chain, config, "first").lower[0] == chain.upper[0]


def test_what_one_motor_closes_is_not_held() -> None:
    config = one_motor()
    assert shared_joints(config) == held_joints(config) == {"FFJ4": ["first", "middle"]}
    jaws = HandConfig(fingers=[FingerConfig(name=name, joints=["motor"]) for name in ("left", "right")])
    assert shared_joints(jaws) == {"motor": ["left", "right"]}
    assert held_joints(jaws) == {}
    assert held_joints(load_hand_config("shadow_like")) == {}


def test_no_grasp_is_made_up_of_fingers_that_share_a_joint() -> None:
    config = one_motor()
    plant, hand = make_hand_plant(config)
    errors = HandErrors.of(plant, hand, HandUncertainty())
    with pytest.raises(
        InvalidInputError, match="hand must have fingers with separate joints, but FFJ4 moves first, middle"
    ):
        GraspCloser(plant, hand, errors, np.zeros(len(errors.sigma)))
