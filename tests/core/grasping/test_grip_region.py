"""Where a hand that does not say so is taken to hold things."""

from pathlib import Path

import numpy as np
import pytest

from tactopose_drake.core.grasping.finger_reach import FingerReach, ReachParams
from tactopose_drake.core.grasping.grip_region import find_grip_region
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.hand.hand_config import load_hand_config
from tactopose_drake.hand.hand_reach import make_hand_reach
from tests.hand.grippers import write_bending_gripper

NO_PALM = np.zeros((0, 3)), np.zeros(0)


def fingers_of(folder: Path, count: int, seed: int) -> dict[str, FingerReach]:
    """Fingers evenly about z, each of two links that bend inwards, by their samples of another seed."""
    reach = make_hand_reach(load_hand_config(write_bending_gripper(folder, count)), ReachParams())
    generator = np.random.default_rng(seed)
    return {
        name: FingerReach(finger.geometry, ReachParams(), generator, 2400) for name, finger in reach.fingers.items()
    }


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("count", [2, 3])
def test_fingers_evenly_about_an_axis_hold_things_there(tmp_path: Path, count: int, seed: int) -> None:
    low, high = find_grip_region(fingers_of(tmp_path, count, seed), NO_PALM, ReachParams())
    middle = 0.5 * (low + high)
    assert np.linalg.norm(middle[:2]) < 0.01
    # Not so near to the palm, which is at 0, that fingertips come there only after passing it.
    assert 0.05 < middle[2] < 0.09


def test_fingers_that_all_press_from_one_side_hold_nothing(tmp_path: Path) -> None:
    finger = fingers_of(tmp_path, 2, 0)["f0"]
    with pytest.raises(InvalidInputError, match="grip_low and grip_high must be given, as no place"):
        find_grip_region({"a": finger}, NO_PALM, ReachParams())
