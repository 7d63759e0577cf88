"""Paths in a scenario's file count from that file, wherever it is run from; own sensors reach the simulated station."""

import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml

from tactopose_drake.errors import InvalidFileError
from tactopose_drake.hand.tactile_pads import load_tactile_pad
from tactopose_drake.resources import model_path
from tactopose_drake.station.arms.arm import load_arm_config
from tactopose_drake.station.can_senses import CanSenses, JointFile
from tactopose_drake.station.message_channels import Ros2Publishing, Ros2Senses
from tactopose_drake.station.scenario import Scenario, load_scenario
from tactopose_drake.station.senses import RecordedSenses
from tactopose_drake.station.simulated import make_station
from tests.hand.grippers import YAML, write_gripper

PAD = """
pads:
- {name: base, frame: base, array: cells.yaml, alpha: 2.0e-8}
"""
CELLS = "pattern: !PointPattern {points: [[0, 0, 0.001], [0.004, 0, 0.001], [0.008, 0, 0.001]], cell: 0.003}"


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a hand, an object, sensors and a scenario in a folder of its own; run from elsewhere."""
    project = tmp_path / "project"
    for name in ("hands", "things", "scenarios"):
        (project / name).mkdir(parents=True)
    write_gripper(project / "hands", yaml=YAML + PAD)
    (project / "hands" / "cells.yaml").write_text(CELLS)
    for ending in ("sdf", "obj"):
        text = model_path("objects", f"cube.{ending}").read_text()
        (project / "things" / f"block.{ending}").write_text(text.replace("cube.obj", "block.obj"))
    sensor = yaml.safe_load(model_path("sensors", "nano17.yaml").read_text())
    sensor["calibrations"] = {"mine": sensor["calibrations"]["SI-12-0.12"]}
    (project / "scenarios" / "sensor.yaml").write_text(yaml.safe_dump(sensor))
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    monkeypatch.chdir(elsewhere)
    return project


OWN = """
hand: ../hands/two_finger.hand.yaml
object: ../things/block.sdf
sensor: {file: sensor.yaml, calibration: mine}
X_WBase: {rotation: !Rpy {deg: [90, 0, 90]}}
"""


def write(project: Path, text: str) -> Path:
    path = project / "scenarios" / "own.scenario.yaml"
    path.write_text(text)
    return path


def test_own_hand_object_sensors_and_arrays_reach_the_station(project: Path) -> None:
    scenario = load_scenario(Path("..") / "project" / "scenarios" / write(project, OWN).name)
    assert Path(scenario.hand) == project / "hands" / "two_finger.hand.yaml"
    assert scenario.object_mesh() == project / "things" / "block.obj"
    np.testing.assert_array_equal(scenario.sensor.model().range, Scenario().sensor.model().range)
    station = make_station(scenario)
    assert station.diagram.GetOutputPort("pressures_base").size() == 3
    assert station.diagram.GetOutputPort("wrench_left").size() == 6


def test_names_stay_names(project: Path) -> None:
    scenario = load_scenario(write(project, "hand: barrett_like\nobject: cube\nsensor: {file: nano17}\n"))
    assert (scenario.hand, scenario.object, scenario.sensor.file) == ("barrett_like", "cube", "nano17")
    made = load_scenario("shadow_like")
    assert (made.hand, made.object) == ("shadow_like", "wine_glass")
    assert load_tactile_pad("bh280_palm").layout.areas.sum() > 0.0


def test_every_other_path_counts_from_the_file_too(project: Path) -> None:
    scenarios = project / "scenarios"
    (scenarios / "joints.csv").write_text("time,left_slide\n0.0,0.01\n")
    (scenarios / "felt").mkdir()
    (scenarios / "prior.yaml").write_text("X_PO: {translation: [0, 0, 0], quaternion_wxyz: [1, 0, 0, 0]}\n")
    can = """
senses: !CanSenses
  buses: {fingers: {interface: virtual, channel: paths}}
  fingers: {left: {bus: fingers}}
  joints: !JointFile {path: joints.csv}
  prior: prior.yaml
  simulated: {folder: felt}
"""
    senses = load_scenario(write(project, OWN + can)).senses
    assert isinstance(senses, CanSenses)
    assert isinstance(senses.joints, JointFile)
    assert senses.simulated is not None
    found = senses.joints.path, senses.prior, senses.simulated.folder
    assert found == tuple(str(scenarios / name) for name in ("joints.csv", "prior.yaml", "felt"))
    senses = load_scenario(write(project, OWN + "senses: !RecordedSenses {folder: ../recording}")).senses
    assert isinstance(senses, RecordedSenses)
    assert senses.folder == str(project / "recording")
    ros = "senses: !Ros2Senses {wrenches: {left: /left}, config: dds.xml}\npublish: !Ros2Publishing {config: ''}"
    scenario = load_scenario(write(project, OWN + ros))
    assert isinstance(scenario.senses, Ros2Senses)
    assert isinstance(scenario.publish, Ros2Publishing)
    assert (scenario.senses.config, scenario.publish.config) == (str(scenarios / "dds.xml"), "")


def test_an_objects_place_goes_by_its_path(project: Path) -> None:
    grip = "grip: {X_PO: {../things/block.sdf: {translation: [0, 0, 0.1]}}}"
    scenario = load_scenario(write(project, OWN + grip))
    assert scenario.grip is not None
    assert scenario.object in scenario.grip.X_PO


def test_what_is_not_there_is_named(project: Path) -> None:
    for old, new, missing in (
        ("sensor.yaml", "none.yaml", project / "scenarios" / "none.yaml"),
        ("../hands/two_finger", "two_finger", project / "scenarios" / "two_finger.hand.yaml"),
        ("../things/block", "block", project / "scenarios" / "block.sdf"),
    ):
        with pytest.raises(InvalidFileError) as caught:
            load_scenario(write(project, OWN.replace(old, new)))
        assert str(missing) in str(caught.value)


def test_an_arms_model_lies_beside_its_file(project: Path) -> None:
    shipped = load_arm_config("seven_axis")
    (project / "arm.yaml").write_text("model: arm.sdf\nbase_link: base\nflange_frame: flange\n")
    shutil.copy(model_path("objects", "cube.sdf"), project / "arm.sdf")
    assert Path(load_arm_config(project / "arm.yaml").model) == project / "arm.sdf"
    assert shipped.model.startswith("package://")
