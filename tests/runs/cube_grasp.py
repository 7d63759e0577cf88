"""The scenario of a run on simulated devices, in files: a hand that stands still is touched by a cube."""

from pathlib import Path

import numpy as np
import yaml

from tactopose_drake.core.poses import quaternion_from_matrix
from tactopose_drake.hand.fingertip_weights import FingertipWeights
from tactopose_drake.hand.hand_config import load_hand_config
from tactopose_drake.hand.hand_in_plant import make_hand_plant
from tactopose_drake.station.scenario import load_scenario
from tests import held_cube

# The samples may be old: whether they come in time is not the question here, and a machine may be busy.
SCENARIO = """
hand: shadow_like
object: cube
duration: 1.0
senses: !CanSenses
  buses:
    left: {{interface: virtual, channel: "left {folder}"}}
    right: {{interface: virtual, channel: "right {folder}"}}
  fingers:
    first: {{bus: left, base: 0x20, max_age: 5.0}}
    middle: {{bus: left, base: 0x21, max_age: 5.0}}
    ring: {{bus: left, base: 0x22, max_age: 5.0}}
    little: {{bus: right, base: 0x20, max_age: 5.0}}
    thumb: {{bus: right, base: 0x21, calibration: 2, max_age: 5.0}}
  joints: !JointFile {{path: {folder}/joints.csv}}
  prior: {folder}/prior.yaml
  tare_samples: 10
  simulated: {{folder: {folder}}}
X_WBase: {{rotation: !Rpy {{deg: [180, -90, 0]}}}}
estimation:
  use_hand_volume: false
  check_collisions: false
"""


def write_grasp(folder: Path) -> None:
    """Writes `cube.scenario.yaml` with the files that it needs: the touch begins after 0.3 s."""
    (folder / "cube.scenario.yaml").write_text(SCENARIO.format(folder=folder))
    plant, hand = make_hand_plant(load_hand_config("shadow_like"))
    R_WBase = load_scenario("shadow_like").X_WBase.GetDeterministicValue().rotation()
    weights = FingertipWeights(plant, hand, R_WBase).wrenches(held_cube.Q)
    for finger, F_S in held_cube.WRENCHES.items():
        rows = [np.append(0.0, weights[finger]), np.append(0.3, F_S + weights[finger])]
        np.savetxt(folder / f"{finger}.csv", rows, delimiter=",", header="time, m_x, m_y, m_z, f_x, f_y, f_z")
    joints = [plant.get_joint(index) for index in plant.GetJointIndices()]
    names = [joint.name() for joint in joints if joint.num_positions() == 1]
    order = [plant.GetJointByName(name).position_start() for name in names]
    rows = np.column_stack([[0.0, 0.5], np.tile(held_cube.Q[order], (2, 1))])
    np.savetxt(folder / "joints.csv", rows, delimiter=",", header=", ".join(["time", *names]), comments="")
    X_PO = held_cube.prior().mean
    pose = {"translation": X_PO[:, 3].tolist(), "quaternion_wxyz": quaternion_from_matrix(X_PO[:, :3]).tolist()}
    prior = {"X_PO": pose, "sigma_translation": 0.02, "sigma_rotation_deg": 11.0}
    (folder / "prior.yaml").write_text(yaml.safe_dump(prior))
