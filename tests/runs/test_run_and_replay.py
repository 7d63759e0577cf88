"""Whole runs on simulated devices, recorded; and their replay, here and in another process."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml

from tactopose_drake.core.poses import quaternion_from_matrix
from tactopose_drake.errors import BusError, DeviceTimeoutError, InvalidFileError, InvalidInputError
from tactopose_drake.hand.fingertip_weights import FingertipWeights
from tactopose_drake.hand.hand_config import load_hand_config, make_hand_plant
from tactopose_drake.runs.manifest import load_manifest
from tactopose_drake.runs.scenario_replay import replay
from tactopose_drake.runs.scenario_run import run_scenario
from tactopose_drake.runs.stepping import RunView
from tactopose_drake.station.scenario import load_scenario
from tactopose_drake.systems.signals import read_signals
from tests import held_cube
from tests.cli.test_cli import run as tactopose
from tests.drivers.test_driver_contract import open_files
from tests.runs.stations import bus_threads

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


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A scenario with the files that it needs: the touch begins after 0.3 s."""
    folder = tmp_path_factory.mktemp("run")
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
    return folder


@pytest.fixture(scope="module")
def recording(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Made by the command line."""
    files = open_files()
    recording = tmp_path_factory.mktemp("recordings") / "grasp"
    assert tactopose("run", folder / "cube.scenario.yaml", "--record", recording, "--monitor") == 0
    assert bus_threads() == set()
    # A model's arrays stay mapped from the cache.
    assert {name for name in open_files() - files if not name.endswith(".npy")} == set()
    return recording


def lines(path: Path) -> list[dict]:
    return [json.loads(line) for line in path.read_text().splitlines()]


def test_a_run_finds_the_object_when_it_is_touched(recording: Path) -> None:
    estimates = lines(recording / "estimates.jsonl")
    assert len(estimates) == 10
    last = estimates[-1]
    assert last["sense_status"] == "ok"
    assert set(last["fingers_in_contact"]) == set(held_cube.WRENCHES)
    off = np.array(last["hypotheses"][0]["translation"]) - held_cube.X_PO[:, 3]
    assert np.linalg.norm(off) < 0.006


def test_the_folder_says_how_it_was_made(recording: Path) -> None:
    manifest = load_manifest(recording)
    assert manifest.scenario.object == "cube"
    assert manifest.buses == {"left": "left.blf", "right": "right.blf"}
    assert manifest.versions["drake"]
    assert manifest.start > 1.7e9
    # The tare took the gauges' offset off, which the simulated boards have.
    assert all(np.linalg.norm(bias) > 50 for bias in manifest.biases.values())
    assert set(manifest.biases) == set(held_cube.WRENCHES)
    signals, cut = read_signals(recording / "signals.jsonl")
    assert cut == ""
    assert set(signals) == {"joint_positions", "prior"}


def replay_here(recording: Path, folder: Path, out: Path) -> int:
    return tactopose("replay", recording, "--scenario", folder / "cube.scenario.yaml", "--out", out)


def test_another_process_replays_to_the_same_bits(recording: Path, folder: Path, tmp_path: Path) -> None:
    here, there = tmp_path / "here.jsonl", tmp_path / "there.jsonl"
    assert replay_here(recording, folder, here) == 0
    moved = shutil.move(shutil.copytree(recording, tmp_path / "copy"), tmp_path / "moved")
    command = [sys.executable, "-c", "from tactopose_drake.cli.main import main; main()", "replay", str(moved)]
    command += ["--scenario", str(folder / "cube.scenario.yaml"), "--speed", "real", "--out", str(there)]
    environment = os.environ | {"PYTHONHASHSEED": "7"}
    subprocess.run(command, check=True, capture_output=True, env=environment, timeout=300)
    assert here.read_bytes() == there.read_bytes()
    last = lines(here)[-1]
    assert last["sense_status"] == "ok"
    off = np.array(last["hypotheses"][0]["translation"]) - held_cube.X_PO[:, 3]
    assert np.linalg.norm(off) < 0.006


def test_a_log_that_was_cut_off_plays_to_its_last_whole_frame(
    recording: Path, folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    whole, part = tmp_path / "whole.jsonl", tmp_path / "part.jsonl"
    replay_here(recording, folder, whole)
    copy = Path(shutil.copytree(recording, tmp_path / "copy"))
    for name in ("left", "right"):
        log = copy / f"{name}.blf"
        log.write_bytes(log.read_bytes()[: log.stat().st_size * 3 // 4])
    capsys.readouterr()
    assert replay_here(copy, folder, part) == 0
    printed = capsys.readouterr().out
    assert printed.count("is cut off or damaged after") == 2
    some, all_of_it = part.read_text(), whole.read_text()
    # What it plays of the beginning is what there was.
    assert 0 < len(lines(part)) < len(lines(whole))
    assert all_of_it.startswith("\n".join(some.splitlines()[:-2]))


def test_signals_that_were_cut_off_end_the_replay(
    recording: Path, folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    copy = Path(shutil.copytree(recording, tmp_path / "copy"))
    signals = copy / "signals.jsonl"
    signals.write_bytes(signals.read_bytes()[:-30] + b'{"time": 0.5')
    assert replay_here(copy, folder, tmp_path / "out.jsonl") == 2
    message = capsys.readouterr().err
    assert "signals.jsonl: is cut off after 1 whole lines. It has no joint_positions" in message
    # The joints never move, so all that is recorded of them is the first line.
    rows = (recording / "signals.jsonl").read_bytes().splitlines(keepends=True)
    signals.write_bytes(b"".join(rows) + b'{"time": 0.5')
    replay_here(copy, folder, tmp_path / "out.jsonl")
    assert "signals.jsonl: is cut off after 2 whole lines" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("object: cube", "object: mug", "was recorded with the object 'cube'; the scenario has 'mug'"),
        ("base: 0x22", "base: 0x23", "was recorded with other devices; senses.fingers differ"),
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
    for early, message in ((3600.0, "start: is 36.. s before the logs' first frame"), (start, "before the logs'")):
        (copy / "manifest.yaml").write_text(text.replace(f"start: {start!r}", f"start: {start - early!r}"))
        with pytest.raises(InvalidFileError, match=message):
            replay(copy, load_scenario(folder / "cube.scenario.yaml"))


def test_a_replay_says_from_when_on_it_is_not_the_run(
    recording: Path, folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    copy, out = Path(shutil.copytree(recording, tmp_path / "copy")), tmp_path / "out.jsonl"
    replay_here(copy, folder, out)
    rows = lines(out)
    (copy / "estimates.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))
    capsys.readouterr()
    assert replay_here(copy, folder, out) == 0
    assert "the estimates are not those of the run" not in capsys.readouterr().out
    other = next(row for row in rows if row["hypotheses"])
    other["hypotheses"][0]["translation"][0] += 0.001
    (copy / "estimates.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))
    assert replay_here(copy, folder, out) == 0
    printed = capsys.readouterr().out
    assert f"From {other['time']:.2f} s on, the estimates are not those of the run: a live run works with" in printed


def test_a_scenario_may_name_a_recording(recording: Path, folder: Path, tmp_path: Path) -> None:
    scenario = tmp_path / "recorded.scenario.yaml"
    rest = (folder / "cube.scenario.yaml").read_text()
    begin, end = rest.index("senses:"), rest.index("X_WBase")
    scenario.write_text(rest[:begin] + f"senses: !RecordedSenses {{folder: {recording}}}\n" + rest[end:])
    view = run_scenario(load_scenario(scenario))
    off = view.diagram.GetOutputPort("object_pose").Eval(view.context).translation() - held_cube.X_PO[:, 3]
    assert np.linalg.norm(off) < 0.006
    with pytest.raises(InvalidInputError, match="recorded already"):
        run_scenario(load_scenario(scenario), record=tmp_path / "again")


def test_recordings_that_are_none_are_refused(recording: Path, folder: Path, tmp_path: Path) -> None:
    scenario = load_scenario(folder / "cube.scenario.yaml")
    with pytest.raises(InvalidInputError, match="new or empty"):
        run_scenario(scenario, record=recording)
    for damage, message in (
        (lambda copy: (copy / "manifest.yaml").unlink(), "is no recording"),
        (lambda copy: (copy / "left.blf").unlink(), "the log 'left.blf' of the bus 'left' is not in the folder"),
        (lambda copy: (copy / "manifest.yaml").write_text("format: 99\n"), "has the format 99"),
    ):
        copy = Path(shutil.copytree(recording, tmp_path / message.replace("/", " ")))
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
        2, f"{place}: 'middle' is unknown; valid names: left, right."
    )  # fmt: skip
    status, message = attempt("thumb:", "toe:")
    assert status == 2
    assert "CanSenses.fingers: 'toe' is unknown; valid names: first" in message
    monkeypatch.setattr("tactopose_drake.runs.scenario_run.ObjectModel", None)  # nobody gets as far as the object
    status, message = attempt("base: 0x22", "base: 0x10000")
    assert (status, message.count("error: ")) == (2, 1)
    status, message = attempt("interface: virtual", "interface: telepathy")
    assert status == 2
    assert "'telepathy' is unknown" in message
    status, message = attempt(f"joints: !JointFile {{path: {folder}/joints.csv}}", "joints: !JointPort {}")
    assert status == 2
    assert "is !JointPort, which is for a diagram of your own" in message


def test_an_interrupt_ends_a_run_in_good_order(folder: Path, tmp_path: Path) -> None:
    times = []

    def observe(view: RunView) -> None:
        times.append(view.context.get_time())
        assert len(bus_threads()) == 4  # two buses, and their other ends
        if len(times) == 2:
            raise KeyboardInterrupt

    view = run_scenario(load_scenario(folder / "cube.scenario.yaml"), record=tmp_path / "run", observer=observe)
    assert times == [0.1, 0.2]
    assert view.context.get_time() == 0.2
    assert bus_threads() == set()
    played = replay(tmp_path / "run", load_scenario(folder / "cube.scenario.yaml"))
    assert played.whole


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
    with pytest.raises(DeviceTimeoutError, match="first: gave no sample"):
        run_scenario(scenario, duration=0.1)
    assert bus_threads() == set()
