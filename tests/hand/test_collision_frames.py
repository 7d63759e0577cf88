"""In whose frame poses are checked against a hand's volume."""

import dataclasses
from pathlib import Path

import numpy as np
from pydrake.math import RigidTransform, RollPitchYaw

from tactopose_drake.hand.collision import check_collisions
from tests.hand.test_collision import CAPSULE, box_model
from tests.hands import write_hand


def test_poses_are_in_the_palm_s_frame_wherever_that_is_on_its_link(tmp_path: Path) -> None:
    capsule, wall = write_hand(tmp_path, CAPSULE), box_model(0.12, 0.12, 0.04)
    frame = '<frame name="P" attached_to="palm"><pose>0.01 -0.02 0.03 0.3 -0.2 0.5</pose></frame>'
    path, X_BP = tmp_path / "moved.sdf", RigidTransform(RollPitchYaw(0.3, -0.2, 0.5), [0.01, -0.02, 0.03])
    path.write_text(Path(capsule.model).read_text().replace("</model>", f"{frame}</model>"))
    moved = dataclasses.replace(capsule, model=str(path), palm_frame="P")
    X_BO = [RigidTransform(RollPitchYaw(0.1, 0.2, 0.0), [0.0, 0.0, z]) for z in np.linspace(-0.06, 0.06, 13)]
    by_link = check_collisions(capsule, wall, [0.01], np.array([X.GetAsMatrix34() for X in X_BO])).depth
    by_palm = check_collisions(
        moved, wall, [0.01], np.array([(X_BP.inverse() @ X).GetAsMatrix34() for X in X_BO])
    ).depth
    assert np.any((by_link > 1e-3) & (by_link < 8e-3))
    np.testing.assert_allclose(by_palm, by_link, atol=5e-5)
