"""`tactopose calibrate`: from files to a file that a hand names."""

import dataclasses
import shutil
from collections.abc import Collection
from pathlib import Path

import numpy as np
import pytest
import yaml

from tactopose_drake.cli.calibrate_command import _grasps, calibration_lines, calibration_table
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.hand.calibration_file import CalibrationNoise, HandCalibration, MeasuredNumber
from tactopose_drake.hand.closed_grasps import ClosedGraspParams
from tactopose_drake.hand.hand_calibration import calibrate_hand
from tactopose_drake.hand.hand_config import HandUncertainty, load_hand_config
from tactopose_drake.hand.hand_in_plant import make_hand_plant
from tactopose_drake.hand.recorded_grasps import load_grasps
from tactopose_drake.resources import model_path
from tactopose_drake.runs.manifest import SIGNALS, save_manifest
from tactopose_drake.station.scenario import load_scenario
from tactopose_drake.systems.signals import SignalRecorder
from tests.cli.test_cli import run
from tests.core.meshes import smooth_shape
from tests.hand.calibrated_shadow import WrongHand

UNCERTAINTY = {
    "encoder_offset_deg": 0.0,
    "mounting": 0.0,
    "mounting_deg": 0.0,
    "fingertip_radius": 0.001,
    "sensor_force": 0.0,
    "sensor_moment": 0.0,
}
NOISE = ClosedGraspParams(noise_surface=0.0003, noise_normal_deg=1.5)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, blob: ObjectModel) -> Path:
    """A hand whose fingertips alone are not as its file says, an object, and grasps."""
    folder = tmp_path_factory.mktemp("calibrate")
    shipped = model_path("hands", "shadow_like", "shadow_like.hand.yaml").read_text()
    plain = shipped[: shipped.index("uncertainty:")]
    (folder / "mine.hand.yaml").write_text(plain + "\n" + yaml.safe_dump({"uncertainty": UNCERTAINTY}))
    smooth_shape().export(folder / "blob.stl")
    hand = WrongHand(6, HandUncertainty(**UNCERTAINTY))
    (folder / "grasps").mkdir()
    for k, grasp in enumerate(hand.close(blob, 5, NOISE)):
        recorded = grasp.recorded
        data = {
            "joint_positions": dict(recorded.joint_positions),
            "wrenches": {finger: np.asarray(wrench).tolist() for finger, wrench in recorded.wrenches.items()},
        }
        (folder / "grasps" / f"grasp_{k}.yaml").write_text(yaml.safe_dump(data))
    truth = {finger: hand.error(f"{finger} radius") for finger in hand.errors.fingers}
    (folder / "truth.yaml").write_text(yaml.safe_dump(truth))
    return folder


def calibrate(folder: Path, *options: object) -> int:
    files = ("--hand", folder / "mine.hand.yaml", "--object", folder / "blob.stl", "--grasps", folder / "grasps")
    return run("calibrate", *files, *options)


def test_what_is_written_is_what_the_hand_then_knows(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, page = tmp_path / "calibration.yaml", tmp_path / "page.html"
    page.write_text("of an earlier calibration")
    assert calibrate(folder, "--out", out, "--html", page) == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert "The hand by 5 grasps" in printed
    assert "Remaining error of a contact: 0." in printed
    assert f"Written: {out} Replaced: {page}" in printed
    assert "thumb radius" in printed
    # What was not looked for has no row.
    assert "offset" not in printed
    assert "mounting" not in printed
    truth = yaml.safe_load((folder / "truth.yaml").read_text())
    found = yaml.safe_load(out.read_text())["fingers"]
    for finger, radius in truth.items():
        assert abs(found[finger]["radius"]["value"] - radius) < 5.0 * found[finger]["radius"]["sigma"], finger
        assert found[finger]["radius"]["sigma"] < 0.0005, finger
    text = page.read_text()
    assert text.startswith("<!doctype html>")
    assert text.count('class="before"') == text.count('class="after"') >= 40
    assert "http" not in text
    assert "<h1>Calibration of mine.hand.yaml</h1>" in text
    assert "Remaining error of a contact: " in text
    assert "thumb radius</td><td>" in text

    hand = tmp_path / "calibrated.hand.yaml"
    hand.write_text((folder / "mine.hand.yaml").read_text() + "calibration: calibration.yaml\n")
    _, parts = make_hand_plant(load_hand_config(hand))
    assert parts.calibration is not None
    for finger, surface in parts.surfaces.items():
        np.testing.assert_allclose(surface.shape[0], 0.009 + found[finger]["radius"]["value"], atol=1e-12)


def test_offsets_are_shown_in_degrees_and_of_joints_that_slide_in_millimetres() -> None:
    offsets = {
        "left_slide": MeasuredNumber(value=0.0021, sigma=0.0008),
        "knuckle": MeasuredNumber(value=-1.25, sigma=0.5),
        "wrist": MeasuredNumber(value=-0.001, sigma=0.5),
    }
    table = calibration_table(HandCalibration(grasps=10, joint_offsets=offsets), ("left_slide",))
    rows = list(zip(*(column.cells for column in table.columns), strict=True))
    assert rows == [
        ("left_slide offset", "2.10", "0.80", "mm"),
        ("knuckle offset", "-1.25", "0.50", "deg"),
        ("wrist offset", "0.00", "0.50", "deg"),
    ]


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("joint_positions: {FFJ4: 0.1}\nwrenches: {first: [1, 2]}", "wrenches.first"),
        (
            "joint_positions: {FFJ4: 0.1}\nwrenches: {first: [0, 0, 0, 0, 0, 1]}",
            "joint_positions must have a number for each joint, but lack",
        ),
        ("joint_positions: {FFJ9: 0.1}\nwrenches: {first: [0, 0, 0, 0, 0, 1]}", "FFJ9"),
        ("joint_positions: {FFJ2: 60.5}\nwrenches: {first: [0, 0, 0, 0, 0, 1]}", ", not 60.5."),
        ("joint_positions: [0.1]", "joint_positions must be a mapping"),
        (
            "joint_positions: {FFJ2: 1.44, FFJ1: 0.1}\nwrenches: {first: [0, 0, 0, 0, 0, 1]}",
            "joint_positions[FFJ1] must be left out, as it follows another joint, or within",
        ),
    ],
)
def test_a_bad_grasp_is_one_line(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], content: str, said: str
) -> None:
    grasps = shutil.copytree(folder / "grasps", tmp_path / "grasps")
    (grasps / "bad.yaml").write_text(content)
    files = ("--hand", folder / "mine.hand.yaml", "--object", folder / "blob.stl", "--grasps", grasps)
    assert run("calibrate", *files, "--out", tmp_path / "calibration.yaml") == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "bad.yaml" in line
    assert said in line
    assert not (tmp_path / "calibration.yaml").exists()


def test_a_grasp_that_is_there_twice_is_refused(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    grasps = shutil.copytree(folder / "grasps", tmp_path / "grasps")
    (grasps / "copy.yaml").write_text((grasps / "grasp_1.yaml").read_text())
    files = ("--hand", folder / "mine.hand.yaml", "--object", folder / "blob.stl", "--grasps", grasps)
    assert run("calibrate", *files, "--out", tmp_path / "calibration.yaml") == 2
    (line,) = capsys.readouterr().err.splitlines()
    first, second = grasps / "copy.yaml", grasps / "grasp_1.yaml"
    assert f"{second} must be another grasp than {first}, not have its readings." in line


def calibrate_with_forces_first(folder: Path, tmp_path: Path, fingers: Collection[str]) -> int:
    """Calibrates by the folder's grasps, the wrenches of some fingers in a wrong order."""
    grasps = tmp_path / "grasps"
    grasps.mkdir()
    for path in (folder / "grasps").iterdir():
        data = yaml.safe_load(path.read_text())
        for finger, wrench in data["wrenches"].items():
            data["wrenches"][finger] = wrench[3:] + wrench[:3] if finger in fingers else wrench
        (grasps / path.name).write_text(yaml.safe_dump(data))
    files = ("--hand", folder / "mine.hand.yaml", "--object", folder / "blob.stl", "--grasps", grasps)
    return run("calibrate", *files, "--out", tmp_path / "calibration.yaml")


def test_a_finger_that_makes_no_contact_is_said(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert calibrate_with_forces_first(folder, tmp_path, ["thumb"]) == 0
    reason = "the force is below min_force (0.05 N)."
    said = f"No wrench of thumb gives a contact, so that nothing is known of this finger: {reason}"
    assert said in capsys.readouterr().out


def test_what_a_calibration_is_not_to_be_trusted_for_is_said(folder: Path) -> None:
    model = ObjectModel.from_mesh(folder / "blob.stl")
    grasps = load_grasps(folder / "grasps", model)
    names = [grasp.name for grasp in grasps]
    result = calibrate_hand(folder / "mine.hand.yaml", grasps)
    as_found = " ".join(calibration_lines(result, names))
    assert "do not fit" not in as_found
    assert "That is much" not in as_found
    weights = result.contact_weights | {"thumb": np.array([0.0, 0.1, 0.9, 0.8, 0.0])}
    beside = calibration_lines(dataclasses.replace(result, contact_weights=weights), names)
    assert [line for line in beside if line.startswith("Of ")] == [
        "Of thumb, 3 of 5 contacts do not fit the others and were ignored: its sensor, its wrenches' frame or "
        "its joints are not as the hand's file says."
    ]
    for noise in (CalibrationNoise(position=0.0007), CalibrationNoise(normal_deg=3.3)):
        noisy = dataclasses.replace(result, calibration=dataclasses.replace(result.calibration, noise=noise))
        assert calibration_lines(noisy, names)[1].startswith("That is much: with the right mesh, and errors as")


def test_a_hand_that_names_its_calibration_is_calibrated_anew(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    hand, out = tmp_path / "mine.hand.yaml", tmp_path / "calibration.yaml"
    hand.write_text((folder / "mine.hand.yaml").read_text() + "calibration: calibration.yaml\n")
    files = ("--hand", hand, "--object", folder / "blob.stl", "--grasps", folder / "grasps")
    assert run("calibrate", *files, "--out", out) == 0  # There is none yet.
    assert f"Written: {out}" in " ".join(capsys.readouterr().out.split())
    first = out.read_text()
    assert run("calibrate", *files, "--out", out) == 0
    assert f"Replaced: {out}" in " ".join(capsys.readouterr().out.split())
    assert out.read_text() == first
    assert run("calibrate", *files, "--out", tmp_path / "other.yaml", "--html", out) == 2
    assert "must be another file than an input, and not in one" in capsys.readouterr().err
    assert run("calibrate", *files, "--out", hand) == 2
    assert "must be another file than an input, and not in one" in capsys.readouterr().err


def test_readings_before_touches_are_grasps_that_nothing_is_said_of(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    grasps = shutil.copytree(folder / "grasps", tmp_path / "grasps")
    joints = yaml.safe_load((grasps / "grasp_0.yaml").read_text())["joint_positions"]
    silent = {"joint_positions": joints, "out_of_touch": {"thumb": [0.0, 0.0001, 0.0, 0.0, 0.01, 0.0]}}
    (grasps / "silent.yaml").write_text(yaml.safe_dump(silent))
    files = ("--hand", folder / "mine.hand.yaml", "--object", folder / "blob.stl", "--grasps", grasps)
    assert run("calibrate", *files, "--out", tmp_path / "c.yaml", "--html", tmp_path / "page.html") == 0
    printed = capsys.readouterr().out
    assert "The hand by 5 grasps" in printed
    assert "silent.yaml" not in printed
    assert "silent.yaml</td><td></td><td></td>" in (tmp_path / "page.html").read_text()


def test_what_makes_no_contact_is_said_and_no_calibration_is_written(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fingers = ("first", "middle", "ring", "little", "thumb")
    assert calibrate_with_forces_first(folder, tmp_path, fingers) == 2
    captured = capsys.readouterr()
    (line,) = captured.err.splitlines()
    assert "grasps must have a contact in at least 3, not in 0 of 5" in line
    assert "No wrench of thumb gives one: the force is below min_force" in line
    assert not captured.out
    assert not (tmp_path / "calibration.yaml").exists()


def test_folders_and_outputs_are_checked_before_the_work(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    hand = ("--hand", folder / "mine.hand.yaml", "--object", folder / "blob.stl")
    assert run("calibrate", *hand, "--grasps", tmp_path / "none", "--out", tmp_path / "c.yaml") == 2
    assert "there is no such folder" in capsys.readouterr().err
    (tmp_path / "manifest.yaml").write_text("format: 1\n")
    assert run("calibrate", *hand, "--grasps", tmp_path, "--out", folder / "c.yaml") == 2
    assert (
        f"{tmp_path} must be a folder that holds a recording for each grasp, not one itself" in capsys.readouterr().err
    )
    assert calibrate(folder, "--out", folder / "grasps" / "calibration.yaml") == 2
    assert "must be another file than an input, and not in one" in capsys.readouterr().err


def test_a_recording_that_was_cut_off_is_used_as_far_as_it_goes_and_named(
    blob: ObjectModel, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "grasp"
    folder.mkdir()
    save_manifest(folder, load_scenario("shadow_like"), 0.0, {}, {})
    plant, _ = make_hand_plant(load_hand_config("shadow_like"))
    with SignalRecorder(folder / SIGNALS) as recorder:
        for k in range(50):
            recorder.write("joint_positions", 0.02 * k, np.full(plant.num_positions(), 1e-6 * k))
            recorder.write("wrench_thumb", 0.02 * k, np.array([0.0, 0.0, 0.0, 0.0, 1e-4 * k, -2.0]))
    with (folder / SIGNALS).open("a") as file:
        file.write('{"time": 1.0, "na')
    (grasp,) = _grasps(tmp_path, blob)
    assert set(grasp.wrenches) == {"thumb"}
    told = capsys.readouterr().err
    assert f"{folder / SIGNALS} is cut off after 100 whole lines." in told
    assert "has no wrench_first, wrench_middle, wrench_ring, wrench_little" in told
