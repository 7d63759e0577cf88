"""Recorded grasps as files."""

import json
from pathlib import Path

import pytest

from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.errors import InvalidFileError
from tactopose_drake.hand.recorded_grasps import load_grasp, load_grasps

GRASP = {
    "joint_positions": {"FFJ4": 0.1, "FFJ3": -0.2},
    "wrenches": {"first": [0.001, 0.0, 0.0, 0.0, 1.0, -2.0]},
    "out_of_touch": {"little": [0.0, 0.0, 0.0, 0.1, 0.0, 0.0]},
    "time": 12.5,
}


def test_yaml_and_json_say_the_same(tmp_path: Path, blob: ObjectModel) -> None:
    (tmp_path / "b.json").write_text(json.dumps(GRASP))
    (tmp_path / "a.yaml").write_text(
        "joint_positions: {FFJ4: 0.1, FFJ3: -0.2}\n"
        "wrenches:\n  first: [0.001, 0, 0, 0, 1, -2]\n"
        "out_of_touch:\n  little: [0, 0, 0, 0.1, 0, 0]\n"
        "time: 12.5\n"
    )
    (tmp_path / "notes.txt").write_text("no grasp")
    first, second = load_grasps(tmp_path, blob)
    assert first.name.endswith("a.yaml")
    assert second.name.endswith("b.json")
    for grasp in (first, second):
        assert dict(grasp.joint_positions) == GRASP["joint_positions"]
        assert dict(grasp.wrenches) == GRASP["wrenches"]
        assert dict(grasp.out_of_touch) == GRASP["out_of_touch"]
        assert grasp.time == 12.5
        assert grasp.model is blob


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            "joints: {}",
            "line 1: the content must have only the keys joint_positions, wrenches, out_of_touch, time, not 'joints'",
        ),
        ("joint_positions: {FFJ4: a}", "line 1: joint_positions.FFJ4 must be a number, not 'a'"),
        ("joint_positions: {FFJ4: 0.1}\nwrenches: {first: [1, 2]}", "wrenches.first"),
        ("joint_positions: {FFJ4: 0.1}", "wrenches must have six numbers for each finger that touches, but has none"),
        ("wrenches: {first: [0, 0, 0, 0, 0, 1]}", "joint_positions must have a number for each joint, but has none"),
        (
            "joint_positions: {FFJ4: 0.1}\nwrenches: &both {first: [0, 0, 0, 0, 0, 1]}\nout_of_touch: *both",
            "out_of_touch must not have first, as a finger must be in only one of it and wrenches.",
        ),
        ("", "the file must not be empty"),
    ],
)
def test_a_fault_is_said_in_one_line(tmp_path: Path, blob: ObjectModel, text: str, said: str) -> None:
    path = tmp_path / "one.yaml"
    path.write_text(text)
    with pytest.raises(InvalidFileError) as caught:
        load_grasp(path, blob)
    assert str(caught.value).startswith(f"{path}: ")
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_folder_without_grasps(tmp_path: Path, blob: ObjectModel) -> None:
    allowed = (
        f"{tmp_path} must itself hold a file for each grasp, which ends in .json, .yaml or .yml and has "
        "joint_positions, rad by joint, and wrenches, six numbers by finger, N m and N, or for `tactopose calibrate` a "
        "folder for each recording of `tactopose run --record`, with its manifest.yaml, but has "
    )
    with pytest.raises(InvalidFileError) as nothing:
        load_grasps(tmp_path, blob)
    assert str(nothing.value) == f"{allowed}nothing."
    (tmp_path / "runs").mkdir()
    for name in ("d.csv", "a.csv", "b.csv", "c.csv"):
        (tmp_path / name).touch()
    with pytest.raises(InvalidFileError) as others:
        load_grasps(tmp_path, blob)
    assert str(others.value) == f"{allowed}only a.csv, b.csv, c.csv, 2 more."
    with pytest.raises(InvalidFileError, match="there is no such folder"):
        load_grasps(tmp_path / "none", blob)
