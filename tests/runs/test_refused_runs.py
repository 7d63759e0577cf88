"""Runs and replays that cannot be made: each is one error that says why."""

import re
import shutil
from pathlib import Path

import pytest

from tactopose_drake.errors import BusError, DeviceTimeoutError, InvalidFileError, InvalidInputError
from tactopose_drake.runs.device_run import check_devices
from tactopose_drake.runs.manifest import load_manifest
from tactopose_drake.runs.scenario_replay import replay
from tactopose_drake.runs.scenario_run import run_scenario
from tactopose_drake.station.can_senses import FixedJoints
from tactopose_drake.station.scenario import load_scenario
from tests.cli.test_cli import run as tactopose
from tests.runs.stations import bus_threads


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "object: cube",
            "object: mug",
            "must be replayed with the object that it was recorded with, 'cube', not 'mug'",
        ),
        (
            "base: 0x22",
            "base: 0x23",
            "must be replayed with the devices that it was recorded with, but senses.fingers differ",
        ),
    ],
)
def test_the_wrong_scenario_is_one_error(
    recording: Path, folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], old: str, new: str, message: str
) -> None:
    other = tmp_path / "other.scenario.yaml"
    other.write_text((folder / "cube.scenario.yaml").read_text().replace(old, new))
    capsys.readouterr()
    assert tactopose("replay", recording, "--scenario", other) == 2
    errors = capsys.readouterr().err
    assert message in " ".join(errors.split())
    assert "Traceback" not in errors


def test_a_start_long_before_the_logs_is_refused(recording: Path, folder: Path, tmp_path: Path) -> None:
    copy = Path(shutil.copytree(recording, tmp_path / "copy"))
    text, start = (copy / "manifest.yaml").read_text(), load_manifest(recording).start
    told: list[str | None] = []
    for early, message in (
        (3600.0, "start must be at most .* s before the logs' first frame, not 3[56].. s"),
        (start, "before the logs'"),
    ):
        (copy / "manifest.yaml").write_text(text.replace(f"start: {start!r}", f"start: {start - early!r}"))
        with pytest.raises(InvalidFileError, match=message):
            replay(copy, load_scenario(folder / "cube.scenario.yaml"), tell=told.append)
    assert not told, "the station was made before the manifest was looked at"


def test_recordings_that_are_none_are_refused(recording: Path, folder: Path, tmp_path: Path) -> None:
    scenario = load_scenario(folder / "cube.scenario.yaml")
    with pytest.raises(InvalidInputError, match="must be new, or an empty folder"):
        run_scenario(scenario, record=recording)
    damages = (
        (lambda copy: (copy / "manifest.yaml").unlink(), "must be a recording"),
        (lambda copy: (copy / "left.blf").unlink(), r"left\.blf, the log of the bus 'left', is missing\."),
        (lambda copy: (copy / "manifest.yaml").write_text("format: 99\n"), "must have the format 1, not 99"),
        (
            lambda copy: (copy / "manifest.yaml").write_text("key_of_then: 1\nformat: 98\n"),
            "must have the format 1, not 98",
        ),
    )
    for number, (damage, message) in enumerate(damages):
        copy = Path(shutil.copytree(recording, tmp_path / str(number)))
        damage(copy)
        with pytest.raises(InvalidFileError, match=message):
            load_manifest(copy)


def test_what_cannot_be_run_is_said_at_once(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    text = (folder / "cube.scenario.yaml").read_text()

    def attempt(old: str, new: str) -> tuple[int, str]:
        (tmp_path / "bad.scenario.yaml").write_text(text.replace(old, new))
        capsys.readouterr()
        status = tactopose("run", tmp_path / "bad.scenario.yaml", "--duration", "0.1")
        return status, " ".join(capsys.readouterr().err.split())

    place = f"error: {tmp_path}/bad.scenario.yaml: CanSenses.fingers[little].bus"
    assert attempt("bus: right, base: 0x20", "bus: middle, base: 0x20") == (
        2, f"{place} must be one of left, right, not 'middle'."
    )  # fmt: skip
    status, message = attempt("thumb:", "toe:")
    assert status == 2
    assert re.search("CanSenses.fingers must be one of first.*, not 'toe'", message)
    monkeypatch.setattr("tactopose_drake.runs.scenario_run.ObjectModel", None)  # nobody gets as far as the object
    status, message = attempt("base: 0x22", "base: 0x10000")
    assert (status, message.count("error: ")) == (2, 1)
    status, message = attempt("interface: virtual", "interface: telepathy")
    assert status == 2
    assert "not 'telepathy'." in message
    status, message = attempt(f"joints: !JointFile {{path: {folder}/joints.csv}}", "joints: !JointPort {}")
    assert status == 2
    assert "CanSenses.joints must be !FixedJoints or !JointFile for a run of the scenario by itself" in message


@pytest.mark.parametrize("name", ["joints.csv", "palm.csv"])
def test_a_run_does_not_outlast_the_files_of_joints_and_palm(folder: Path, tmp_path: Path, name: str) -> None:
    scenario = load_scenario(folder / "cube.scenario.yaml")
    (tmp_path / "palm.csv").write_text(
        "time, x, y, z, qw, qx, qy, qz\n0.0, 0, 0, 0, 1, 0, 0, 0\n0.5, 0, 0, 0, 1, 0, 0, 0\n"
    )
    if name == "palm.csv":
        scenario.senses.joints, scenario.senses.palm = FixedJoints(), str(tmp_path / name)
    for board in scenario.senses.fingers.values():
        board.max_age = 0.1
    told: list[str] = []
    for simulated, duration, end in (
        (scenario.senses.simulated, None, "the run ends, at 1 s"),
        (scenario.senses.simulated, 0.7, "the run ends, at 0.7 s"),
        (None, None, "the run ends, which has no end"),
    ):
        scenario.senses.simulated = simulated
        with pytest.raises(InvalidInputError, match=rf"{name} must go on until {end}, not end at 0\.5 s"):
            run_scenario(scenario, duration=duration, tell=told.append)
    assert told == []
    check_devices(scenario, 0.6)  # the last row is not older by then than a sample may be


@pytest.mark.parametrize("name", ["joints.csv", "palm.csv"])
def test_files_of_joints_and_palm_begin_with_the_run(folder: Path, tmp_path: Path, name: str) -> None:
    scenario = load_scenario(folder / "cube.scenario.yaml")
    header, row = {"joints.csv": ("FFJ3", "0.1"), "palm.csv": ("x, y, z, qw, qx, qy, qz", "0, 0, 0, 1, 0, 0, 0")}[name]
    (tmp_path / name).write_text(f"time, {header}\n1795793561, {row}\n1795793661, {row}\n")  # s since the epoch
    if name == "palm.csv":
        scenario.senses.joints, scenario.senses.palm = FixedJoints(), str(tmp_path / name)
    else:
        scenario.senses.joints.path = str(tmp_path / name)
    told: list[str] = []
    with pytest.raises(InvalidInputError, match=rf"{name} must begin with the run, .*, not at 1795793561 s"):
        run_scenario(scenario, tell=told.append)
    assert told == []


def test_a_joint_file_without_a_path_is_named(folder: Path) -> None:
    scenario = load_scenario(folder / "cube.scenario.yaml")
    scenario.senses.joints.path = ""
    with pytest.raises(InvalidInputError, match=r"CanSenses\.joints\.path must be a CSV file .*, not empty"):
        run_scenario(scenario)


def test_what_simulated_devices_feel_is_read_before_any_work(folder: Path, tmp_path: Path) -> None:
    scenario = load_scenario(folder / "cube.scenario.yaml")
    scenario.senses.simulated.folder = str(shutil.copytree(folder, tmp_path / "felt"))
    (tmp_path / "felt" / "ring.csv").write_text("0.0, 0, 0, 0, 0, 0, 1.0\n")
    told: list[str] = []
    with pytest.raises(InvalidFileError, match=r"ring\.csv: row 1 must be a header, the columns' names, not numbers"):
        run_scenario(scenario, tell=told.append)
    assert told == []


def test_a_bus_that_is_not_there_is_one_error(folder: Path) -> None:
    scenario = load_scenario(folder / "cube.scenario.yaml")
    scenario.senses.simulated = None
    scenario.senses.buses["left"].interface = "socketcan"
    scenario.senses.buses["left"].channel = "no_such_can"
    with pytest.raises(BusError, match="cannot be opened"):
        run_scenario(scenario, duration=0.1)


def test_a_board_that_cannot_be_tared_is_named(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tactopose_drake.station.can_devices._GREETING_TIME", 0.3)
    scenario = load_scenario(folder / "cube.scenario.yaml")
    scenario.senses.simulated = None
    with pytest.raises(DeviceTimeoutError, match="first gave no sample"):
        run_scenario(scenario, duration=0.1)
    assert bus_threads() == set()


def test_a_duration_beyond_all_clocks_is_refused(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert tactopose("run", folder / "cube.scenario.yaml", "--duration", "1e99") == 2
    assert "duration must be a number from 0 to 1e+12, not 1e+99" in capsys.readouterr().err
