"""A hand's links in each other are found in any posture."""

import gc
import re
from pathlib import Path

import numpy as np
import pytest

from tactopose_drake.hand.hand_config import load_hand_config
from tactopose_drake.hand.self_collision import SelfCollision
from tests.hand.grippers import YAML, write_gripper


def test_fingers_that_meet_are_in_each_other(tmp_path: Path) -> None:
    touches_itself = SelfCollision(load_hand_config(write_gripper(tmp_path)))
    # Between the balls at zero: 12 cm less two radii of 12 mm.
    assert not touches_itself({})
    assert not touches_itself({"left": np.array([0.045])})
    assert not touches_itself({"left": np.array([0.045]), "right": np.array([0.045])})
    near = SelfCollision(load_hand_config(write_gripper(tmp_path, yaml=YAML + "rest_positions: {right_slide: 0.06}\n")))
    assert not near({"left": np.array([0.035])})
    assert near({"left": np.array([0.037])})
    assert not near({"left": np.array([0.037]), "right": np.array([0.05])})


@pytest.mark.parametrize(("ratio", "meet"), [(1.2, False), (2.0, True)])
def test_coupled_joints_follow(tmp_path: Path, ratio: float, meet: bool) -> None:
    mimic = f'<mimic joint="left_slide" multiplier="{ratio}"/>'
    coupling = f"couplings: [{{joint: right_slide, follows: left_slide, ratio: {ratio}}}]"
    yaml = YAML.replace("joints: [right_slide]", f"joints: [left_slide]\n  {coupling}")
    touches_itself = SelfCollision(load_hand_config(write_gripper(tmp_path, mimic=mimic, yaml=yaml)))
    assert touches_itself({"left": np.array([0.035]), "right": np.array([0.035])}) is meet


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="/proc says how much memory a process has")
def test_what_it_made_is_freed() -> None:
    config = load_hand_config("shadow_like")

    def memory_after(repeats: int) -> int:
        """Memory of the process that is in no file, kB."""
        for _ in range(repeats):
            SelfCollision(config)
            gc.collect()
        return int(re.findall(r"RssAnon:\s+(\d+)", Path("/proc/self/status").read_text())[0])

    before = memory_after(3)
    assert memory_after(20) - before < 3000  # A diagram that stays takes 450 kB.
