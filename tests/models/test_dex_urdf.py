"""The LEAP and Inspire hands of the repository dexsuite/dex-urdf, whose clone `TACTOPOSE_DEX_URDF` names."""

import os
from pathlib import Path

import numpy as np
import pytest

from tactopose_drake.hand.finger_chain import finger_chain
from tactopose_drake.hand.hand_check import check_hand
from tactopose_drake.hand.hand_config import load_hand_config
from tactopose_drake.hand.hand_in_plant import make_hand_plant

LEAP = """model: {root}/robots/hands/leap_hand/leap_hand_right.urdf
base_link: base
palm_frame: palm_lower
fingers:
- name: index
  joints: ["1", "0", "2", "3"]
  sensor_frame: fingertip
  weld: "3"
  surface: &fingertip !CapsuleSurface
    radius: 0.0108
    length: 0.02
    X_SF: {{translation: [-0.0008, -0.0293, 0.0145], rotation: !Rpy {{deg: [90, 0, 0]}}}}
- {{name: middle, joints: ["5", "4", "6", "7"], sensor_frame: fingertip_2, weld: "7", surface: *fingertip}}
- {{name: ring, joints: ["9", "8", "10", "11"], sensor_frame: fingertip_3, weld: "11", surface: *fingertip}}
"""

INSPIRE = """model: {root}/robots/hands/inspire_hand/inspire_hand_right.urdf
base_link: base
palm_frame: hand_base_link
fingers:
- name: index
  joints: [index_proximal_joint]
  couplings: [{{joint: index_intermediate_joint, follows: index_proximal_joint, ratio: 1.06399, offset: -0.04545}}]
  sensor_frame: index_intermediate
  weld: index_intermediate_joint
  surface: !CapsuleSurface
    radius: 0.005
    length: 0.014
    X_SF: {{translation: [-0.0018, 0.0332, -0.005], rotation: !Rpy {{deg: [-90, 0, 0]}}}}
- name: thumb
  joints: [thumb_proximal_yaw_joint, thumb_proximal_pitch_joint]
  couplings:
  - {{joint: thumb_intermediate_joint, follows: thumb_proximal_pitch_joint, ratio: 1.334}}
  - {{joint: thumb_distal_joint, follows: thumb_proximal_pitch_joint, ratio: 0.667}}
  sensor_frame: thumb_distal
  weld: thumb_distal_joint
  surface: !CapsuleSurface
    radius: 0.0055
    length: 0.012
    X_SF: {{translation: [0.013, 0.006, -0.006], rotation: !Rpy {{deg: [-90, 0, -45]}}}}
"""


@pytest.fixture(params=[LEAP, INSPIRE], ids=["leap", "inspire"])
def hand(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    root = Path(os.environ.get("TACTOPOSE_DEX_URDF", "no such folder"))
    if not (root / "robots" / "hands").is_dir():
        pytest.skip("TACTOPOSE_DEX_URDF does not name a clone of dexsuite/dex-urdf")
    path = tmp_path / "hand.yaml"
    path.write_text(request.param.format(root=root))
    return path


def test_its_files_have_no_fault(hand: Path) -> None:
    found = check_hand(hand).findings
    # A joint of a finger that the file leaves out follows another, which the file then does not say.
    assert not [finding for finding in found if finding.verdict == "fault"]
    assert any(finding.part == "grip" for finding in found)


def test_chains_agree_with_the_plant(hand: Path) -> None:
    plant, parts = make_hand_plant(load_hand_config(hand))
    context = plant.CreateDefaultContext()
    for finger in parts.config.fingers:
        chain = finger_chain(plant, parts, finger.name)
        q = np.random.default_rng(0).uniform(chain.lower, chain.upper)
        for name, angle in zip(finger.joints, q, strict=True):
            plant.GetJointByName(name).set_angle(context, angle)
        for coupling in finger.couplings:
            leader = plant.GetJointByName(coupling.follows).get_angle(context)
            plant.GetJointByName(coupling.joint).set_angle(context, coupling.ratio * leader + coupling.offset)
        X_PS = plant.CalcRelativeTransform(context, parts.palm_frame, parts.sensor_frames[finger.name])
        np.testing.assert_allclose(chain.sensor_poses(q[None])[0], X_PS.GetAsMatrix34(), atol=1e-9)
