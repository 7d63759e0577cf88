"""How rods lie in a hand."""

from pathlib import Path

import numpy as np

from tactopose_drake.core.grasping.finger_reach import ReachParams
from tactopose_drake.core.grasping.rod_direction import rod_direction
from tactopose_drake.hand.hand_config import load_hand_config
from tactopose_drake.hand.hand_reach import make_hand_reach
from tests.hand.grippers import write_gripper


def test_a_rod_lies_across_the_ways_of_two_sliding_fingers(tmp_path: Path) -> None:
    reach = make_hand_reach(load_hand_config(write_gripper(tmp_path)), ReachParams())

    def found(first: np.ndarray) -> np.ndarray:
        return rod_direction(first, reach.fingers, reach.palm_spheres, reach.grip_low, reach.grip_high)

    # Along the ways of the fingers there is nothing to close on; across them the expectation stands.
    assert abs(found(np.array([1.0, 0.0, 0.0]))[0]) < 0.1
    np.testing.assert_array_equal(found(np.array([0.0, 1.0, 0.0])), [0.0, 1.0, 0.0])
