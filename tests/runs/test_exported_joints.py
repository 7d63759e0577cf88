"""Joints in other formats: their units in a table's head, and the links that calibrated ones move."""

import dataclasses
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from pydrake.common.schema import Rotation, Transform
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix

from tactopose_drake.hand.calibration_file import (
    FingerCalibration,
    HandCalibration,
    MeasuredNumber,
    MeasuredVector,
    save_calibration,
)
from tactopose_drake.hand.hand_in_plant import make_hand_plant
from tactopose_drake.runs import csv_export
from tactopose_drake.station.scenario import Scenario
from tests import held_cube
from tests.hand.grippers import write_bending_gripper, write_gripper


def test_joints_that_slide_have_columns_in_metres(tmp_path: Path) -> None:
    for path, joint, unit in (
        (write_gripper(tmp_path), "left_slide", "m"),
        (write_bending_gripper(tmp_path, 2), "f0_j0", "rad"),
    ):
        run = SimpleNamespace(manifest=SimpleNamespace(scenario=Scenario(hand=str(path))), joints=(joint,))
        assert csv_export._columns("joint_positions", run, ()) == (f"joint/{joint}_{unit}",)  # type: ignore[arg-type]


def test_a_calibrated_hand_is_in_tf_where_it_is(tmp_path: Path) -> None:
    mcap_export = pytest.importorskip("tactopose_drake.runs.mcap_export")
    path, offset = write_bending_gripper(tmp_path, 2), np.radians(4.0)
    save_calibration(tmp_path / "calibration.yaml", HandCalibration(joint_offsets={"f0_j0": MeasuredNumber(value=4.0)}))
    calibrated = tmp_path / "calibrated.hand.yaml"
    calibrated.write_text(f"{path.read_text()}calibration: calibration.yaml\n")
    found = []
    for hand, read in ((path, 0.3), (calibrated, 0.3 + offset)):
        scenario = dataclasses.replace(held_cube.scenario(), hand=str(hand))
        plant, _ = make_hand_plant(scenario.hand_config())
        q = np.zeros(plant.num_positions())
        q[plant.GetJointByName("f0_j0").position_start()] = read
        run = SimpleNamespace(manifest=SimpleNamespace(scenario=scenario))
        found.append({child: X for _, child, X in mcap_export._Hand(run).links(q)})  # type: ignore[arg-type]
    assert found[0].keys() == found[1].keys()
    assert all(X.IsNearlyEqualTo(found[1][link], 1e-9) for link, X in found[0].items())


def test_a_hand_is_in_tf_as_its_joints_are_where_the_scenario_has_its_base(tmp_path: Path) -> None:
    mcap_export = pytest.importorskip("tactopose_drake.runs.mcap_export")
    turn, q = Rotation(value=Rotation.Rpy(deg=[50, 20, 70])), np.array([0.3, -0.2, 0.1, 0.4])
    scenario = held_cube.scenario()
    scenario.hand = str(write_bending_gripper(tmp_path, 2))
    scenario.X_WBase = Transform(translation=[0.3, 0.2, 1.0], rotation=turn)
    hand = mcap_export._Hand(SimpleNamespace(manifest=SimpleNamespace(scenario=scenario)))
    plant, parts = make_hand_plant(scenario.hand_config())
    context, base = plant.CreateDefaultContext(), plant.GetFrameByName(parts.config.base_link)
    plant.SetPositions(context, q)
    X_WBase = RigidTransform(RollPitchYaw(*np.radians([50.0, 20.0, 70.0])), [0.3, 0.2, 1.0])
    links = {child: X for parent, child, X in hand.links(q) if parent == "world"}
    assert len(links) >= 5
    for link, X_WL in links.items():
        X_BaseL = plant.CalcRelativeTransform(context, base, plant.GetFrameByName(link))
        assert X_WL.IsNearlyEqualTo(X_WBase @ X_BaseL, 1e-9)


def test_sensors_are_in_tf_where_a_calibration_has_found_them(tmp_path: Path) -> None:
    """Wrenches are named to be in these frames; the hand's model has its own beside them."""
    mcap_export = pytest.importorskip("tactopose_drake.runs.mcap_export")
    path = write_bending_gripper(tmp_path, 2)
    found = FingerCalibration(
        rotation_deg=MeasuredVector(value=[0.0, 20.0, 0.0]), translation=MeasuredVector(value=[0.0, 0.003, 0.0])
    )
    save_calibration(tmp_path / "calibration.yaml", HandCalibration(fingers={"f0": found}))
    path.write_text(f"{path.read_text()}calibration: calibration.yaml\n")
    scenario = dataclasses.replace(held_cube.scenario(), hand=str(path))
    hand = mcap_export._Hand(SimpleNamespace(manifest=SimpleNamespace(scenario=scenario)))
    plant, _ = make_hand_plant(scenario.hand_config())
    frames = {child: (parent, X) for parent, child, X in hand.links(np.zeros(plant.num_positions()))}
    parent, X_LS = frames[hand.sensor_frames["f0"]]
    assert parent == "f0_tip"
    X = RigidTransform(RotationMatrix.MakeYRotation(np.radians(20.0)), [0.0, 0.003, 0.0])
    assert X_LS.IsNearlyEqualTo(X, 1e-12)
    assert hand.sensor_frames["f1"] == "f1_tip"
