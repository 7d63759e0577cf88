"""Recordings in other formats, read back message by message and cell by cell."""

import csv
import dataclasses
import json
import math
import shutil
from pathlib import Path

import mcap.reader
import numpy as np
import pytest
from pydrake.math import RigidTransform

from tactopose_drake.core.poses import make_poses, matrix_from_quaternion, retract
from tactopose_drake.errors import InvalidFileError
from tactopose_drake.estimation.prior import PosePrior
from tactopose_drake.hand.hand_config import load_hand_config
from tactopose_drake.hand.hand_in_plant import make_hand_plant
from tactopose_drake.hand.named_joints import NamedJoints
from tactopose_drake.runs import mcap_export
from tactopose_drake.runs.csv_export import write_csv
from tactopose_drake.runs.manifest import load_manifest
from tactopose_drake.runs.mcap_export import write_mcap
from tactopose_drake.runs.recorded_senses import read_recording
from tactopose_drake.runs.scenario_run import run_scenario
from tactopose_drake.station.scenario import load_scenario
from tactopose_drake.systems.signals import UNKNOWN_POSE, Signal, read_signals
from tests import held_can, held_cube
from tests.cli.test_cli import run as tactopose

rosbags_types = pytest.importorskip("rosbags.typesys")
STORE = rosbags_types.get_typestore(rosbags_types.Stores.ROS2_HUMBLE)


@pytest.fixture(scope="module")
def simulated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A moment of a grip, recorded."""
    folder = tmp_path_factory.mktemp("simulated") / "grip"
    scenario = load_scenario("barrett_like")
    scenario.estimation.use_hand_volume = scenario.estimation.check_collisions = False
    scenario.estimation.estimator.period = 0.02
    run_scenario(scenario, duration=0.06, record=folder)
    return folder


def messages(path: Path) -> dict[str, list[tuple[float, object]]]:
    """Time, s since the epoch, and message, by topic."""
    found: dict[str, list[tuple[float, object]]] = {}
    with path.open("rb") as file:
        reader = mcap.reader.make_reader(file)
        assert reader.get_header().profile == "ros2"
        for schema, channel, message in reader.iter_messages():
            assert schema.encoding == "ros2msg"
            assert channel.message_encoding == "cdr"
            value = STORE.deserialize_cdr(message.data, schema.name)
            found.setdefault(channel.topic, []).append((1e-9 * message.log_time, value))
    return found


def estimates(folder: Path) -> list[dict]:
    return [json.loads(line) for line in (folder / "estimates.jsonl").read_text().splitlines()]


def test_a_run_on_devices_gives_its_wrenches_too(recording: Path, tmp_path: Path) -> None:
    out = tmp_path / "run.mcap"
    assert tactopose("export", recording, "--format", "mcap", "--out", out) == 0
    found, start = messages(out), load_manifest(recording).start
    for finger, F_S in held_cube.WRENCHES.items():
        stamped = found[f"/wrench/{finger}"]
        assert len(stamped) >= 2  # one for each change
        for time, said in stamped:
            assert abs(said.header.stamp.sec + 1e-9 * said.header.stamp.nanosec - time) < 1e-6
        assert stamped[0][1].header.frame_id == load_hand_config("shadow_like").finger(finger).sensor_frame
        wrench = stamped[-1][1].wrench
        measured = [getattr(part, axis) for part in (wrench.torque, wrench.force) for axis in "xyz"]
        np.testing.assert_allclose(measured, F_S, atol=0.02)
        early = [value.wrench.force for time, value in stamped if time < start + 0.15]
        assert np.nanmax([np.abs([force.x, force.y, force.z]) for force in early]) < 0.05  # The touch begins at 0.3 s.
    (joints,) = (state for _, state in found["/joint_states"])
    names = NamedJoints(*make_hand_plant(load_hand_config("shadow_like"))).names
    assert joints.name == list(names)
    np.testing.assert_allclose(joints.position, held_cube.Q, atol=1e-12)


def test_every_estimate_is_there_as_it_was(recording: Path, tmp_path: Path) -> None:
    out = tmp_path / "run.mcap"
    tactopose("export", recording, "--format", "mcap", "--out", out)
    found, lines, start = messages(out), estimates(recording), load_manifest(recording).start
    for text in ("status", "sense_status"):
        assert [value.data for _, value in found[f"/{text}"]] == [line[text] for line in lines]
    np.testing.assert_allclose(
        [time - start for time, _ in found["/status"]], [line["time"] for line in lines], atol=1e-6
    )
    with_pose = [line["hypotheses"] for line in lines if line["hypotheses"]]
    assert len(with_pose) > 3
    for hypotheses, (_, best), (_, array) in zip(with_pose, found["/object_pose"], found["/hypotheses"], strict=True):
        assert best.header.frame_id == load_hand_config("shadow_like").palm_frame
        position, turn = best.pose.pose.position, best.pose.pose.orientation
        np.testing.assert_allclose([position.x, position.y, position.z], hypotheses[0]["translation"], atol=1e-12)
        wxyz = np.array([turn.w, turn.x, turn.y, turn.z])
        np.testing.assert_allclose(np.abs(wxyz @ hypotheses[0]["quaternion_wxyz"]), 1.0)
        assert len(array.poses) == len(hypotheses)


def test_a_pose_that_is_held_is_of_the_time_at_which_it_was_found(recording: Path, tmp_path: Path) -> None:
    run = read_recording(recording)
    *before, last = run.estimates
    held = [{**last, "time": last["time"] + 0.1 * k, "status": "held: 0 touches; 2 are needed"} for k in (1, 2)]
    again = {**last, "time": last["time"] + 0.3}
    write_mcap(dataclasses.replace(run, estimates=(*before, last, *held, again)), tmp_path / "run.mcap")
    found, start = messages(tmp_path / "run.mcap"), run.manifest.start
    for topic in ("/object_pose", "/hypotheses"):
        times = [time - start for time, _ in found[topic]][-2:]
        np.testing.assert_allclose(times, [last["time"], again["time"]], atol=1e-6)
    assert [value.data for _, value in found["/status"]][-3:-1] == [held[0]["status"]] * 2
    of_object = [time for time, tf in found["/tf"] if tf.transforms[0].child_frame_id == "object"]
    np.testing.assert_allclose(np.array(of_object[-2:]) - start, [last["time"], again["time"]], atol=1e-6)


def test_a_pose_that_becomes_unknown_is_not_shown_as_if_it_stayed(recording: Path, tmp_path: Path) -> None:
    run = read_recording(recording)
    known = next(line["hypotheses"] for line in run.estimates if line["hypotheses"])
    beliefs = (None, known, None, None, known)
    said = [{"time": 0.1 * k, "status": "", "hypotheses": each} for k, each in enumerate(beliefs)]
    write_mcap(dataclasses.replace(run, estimates=tuple(said)), tmp_path / "run.mcap")
    found = messages(tmp_path / "run.mcap")
    assert [len(array.poses) for _, array in found["/hypotheses"]] == [len(known), 0, len(known)]
    first, gone, again = (scene for _, scene in found["/scene"])
    np.testing.assert_allclose([time - run.manifest.start for time, _ in found["/scene"]], [0.0, 0.2, 0.4], atol=1e-6)
    assert [(marker.ns, marker.id, marker.action) for marker in gone.markers] == [("object", first.markers[-1].id, 2)]
    assert [(marker.ns, marker.id, marker.action) for marker in again.markers] == [("object", first.markers[-1].id, 0)]
    assert len(again.markers[0].points) == len(first.markers[-1].points) > 0
    assert [math.isnan(best.pose.pose.position.x) for _, best in found["/object_pose"]] == [False, True, False]
    assert "/tracked_hypotheses" not in found


def test_a_prior_or_measured_pose_that_becomes_unknown_is_nan_from_then_on(recording: Path, tmp_path: Path) -> None:
    run = read_recording(recording)
    prior = Signal([0.0, 0.1, 0.2, 0.3], [None, PosePrior(np.eye(3, 4)), None, PosePrior(np.eye(3, 4))])
    palm = Signal([0.0, 0.2], [RigidTransform(), UNKNOWN_POSE])
    write_mcap(dataclasses.replace(run, signals={"prior": prior, "palm_pose": palm}), tmp_path / "run.mcap")
    found, start = messages(tmp_path / "run.mcap"), run.manifest.start
    np.testing.assert_allclose([time - start for time, _ in found["/prior"]], [0.1, 0.2, 0.3], atol=1e-6)
    numbers = [(said.pose.pose.orientation.w, said.pose.covariance[0]) for _, said in found["/prior"]]
    np.testing.assert_array_equal(np.isnan(numbers), [[False] * 2, [True] * 2, [False] * 2])
    assert [math.isnan(said.pose.position.x) for _, said in found["/palm_pose"]] == [False, True]


def test_the_covariance_is_of_a_turn_about_the_palms_axes(recording: Path, tmp_path: Path) -> None:
    out = tmp_path / "run.mcap"
    tactopose("export", recording, "--format", "mcap", "--out", out)
    hypothesis = estimates(recording)[-1]["hypotheses"][0]
    _, best = messages(out)["/object_pose"][-1]
    covariance, ours = best.pose.covariance.reshape(6, 6), np.array(hypothesis["covariance"])
    np.testing.assert_allclose(covariance[:3, :3], ours[3:, 3:], atol=1e-15)
    # Samples of the pose, as both conventions have them.
    R_PO = matrix_from_quaternion(np.array(hypothesis["quaternion_wxyz"]))
    increments = np.random.default_rng(0).multivariate_normal(np.zeros(6), ours, size=20000)
    X = retract(np.tile(make_poses(R_PO, np.zeros(3)), (20000, 1, 1)), increments)
    turns = np.einsum("nij,kj->nik", X[:, :, :3], R_PO)  # about P's axes
    w_P = 0.5 * np.stack(
        [turns[:, 2, 1] - turns[:, 1, 2], turns[:, 0, 2] - turns[:, 2, 0], turns[:, 1, 0] - turns[:, 0, 1]]
    )
    scale = np.sqrt(np.diag(covariance)[3:])
    np.testing.assert_allclose(
        np.cov(w_P) / np.outer(scale, scale), covariance[3:, 3:] / np.outer(scale, scale), atol=0.1
    )


def test_a_simulated_run_gives_every_change_of_its_signals(simulated: Path, tmp_path: Path) -> None:
    assert tactopose("export", simulated, "--format", "mcap") == 0
    found = messages(simulated.with_name("grip.mcap"))
    signals, _ = read_signals(simulated / "signals.jsonl")
    for name, topic in (("joint_positions", "/joint_states"), ("prior", "/prior"), ("true_pose", "/true_pose")):
        values = [value for value in signals[name].values if value is not None]
        assert len(found[topic]) == len(values) > 0
    for (_, said), prior in zip(found["/prior"], filter(None, signals["prior"].values), strict=True):
        sigmas = np.repeat([prior.sigma_translation, prior.sigma_rotation], 3)
        np.testing.assert_allclose(said.pose.covariance.reshape(6, 6), np.diag(sigmas**2), atol=1e-12)
        at = said.pose.pose.position
        np.testing.assert_allclose([at.x, at.y, at.z], prior.mean[:, 3], atol=1e-12)
    palm = load_hand_config("barrett_like").palm_frame
    assert {said.header.frame_id for topic in ("/prior", "/true_pose") for _, said in found[topic]} == {palm}
    for (_, said), X_PO in zip(found["/true_pose"], signals["true_pose"].values, strict=True):
        at, turn = said.pose.position, said.pose.orientation
        np.testing.assert_allclose([at.x, at.y, at.z], X_PO.translation(), atol=1e-12)
        R_PO = matrix_from_quaternion(np.array([turn.w, turn.x, turn.y, turn.z]))
        np.testing.assert_allclose(R_PO, X_PO.rotation().matrix(), atol=1e-12)
    for state, q in zip(found["/joint_states"], signals["joint_positions"].values, strict=True):
        np.testing.assert_array_equal(state[1].position, q)
    for pad in load_hand_config("barrett_like").pads:
        pressures = found[f"/pressure/{pad.name}"]
        for (_, array), cells in zip(pressures, signals[f"pressures_{pad.name}"].values, strict=True):
            np.testing.assert_array_equal(array.data, cells)


def test_the_scenes_frames_are_all_in_tf(simulated: Path, tmp_path: Path) -> None:
    out = tmp_path / "run.mcap"
    tactopose("export", simulated, "--format", "mcap", "--out", out)
    found = messages(out)
    ((time, scene),) = found["/scene"]
    assert time == 0.0
    frames = {transform.child_frame_id for _, tf in found["/tf"] for transform in tf.transforms}
    used = {marker.header.frame_id for marker in scene.markers}
    assert "object" in used
    assert used - {"object"} <= frames
    assert all(len(marker.points) % 3 == 0 and len(marker.points) for marker in scene.markers)
    assert len({(marker.ns, marker.id) for marker in scene.markers}) == len(scene.markers)
    palm = load_hand_config("barrett_like").palm_frame
    assert palm in frames


def test_a_hand_on_can_gives_joints_by_name_and_pressures_of_its_logs(tmp_path: Path) -> None:
    scenario = load_scenario("barrett_like_can")
    scenario.duration = 0.5
    scenario.senses.buses["hand"].channel = "exported hand"
    scenario.senses.barrett_hand.max_age = 5.0
    scenario.senses.simulated.folder = str(tmp_path)
    scenario.estimation.use_hand_volume = scenario.estimation.check_collisions = False
    untouched = np.append(held_can.JOINT_POSITIONS, np.zeros(99))  # while the arrays tare themselves
    table = [np.append(0.0, untouched), np.append(0.1, held_can.ROW)]
    np.savetxt(tmp_path / "hand.csv", table, delimiter=",", header="time and 106 numbers")
    run_scenario(scenario, record=tmp_path / "run")
    assert tactopose("export", tmp_path / "run", "--format", "mcap") == 0
    found = messages(tmp_path / "run.mcap")
    state = found["/joint_states"][-1][1]
    positions = dict(zip(state.name, state.position, strict=True))
    for joint, position in zip(scenario.senses.barrett_hand.joints, held_can.JOINT_POSITIONS, strict=True):
        assert positions[joint] == pytest.approx(position, abs=0.01)
    pads = [f"finger_{k}" for k in (1, 2, 3)] + ["palm"]
    for pad, pressures in zip(pads, held_can.PRESSURES, strict=True):
        np.testing.assert_allclose(found[f"/pressure/{pad}"][-1][1].data, pressures, atol=300.0)


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_a_table_has_all_numbers_to_the_last_bit(simulated: Path, tmp_path: Path) -> None:
    out = tmp_path / "run.csv"
    assert tactopose("export", simulated, "--format", "csv", "--out", out) == 0
    table, run = rows(out), read_recording(simulated)
    times = [float(row["time_s"]) for row in table]
    assert times == sorted(set(times))
    columns = [f"joint/{joint}_rad" for joint in run.joints]
    signal = run.signals["joint_positions"]
    changes = [row for row in table if row[columns[0]]]
    assert [float(row["time_s"]) for row in changes] == signal.times
    np.testing.assert_array_equal([[float(row[name]) for name in columns] for row in changes], signal.values)
    said = [row["status"] for row in table if row["status"]]
    assert said == [line["status"] for line in estimates(simulated)]
    truths = [row for row in table if row["true/p_x_m"]]
    np.testing.assert_array_equal(
        [float(row["true/p_z_m"]) for row in truths],
        [X_PO.translation()[2] for X_PO in run.signals["true_pose"].values],
    )


def test_a_file_that_was_there_is_said_to_be_replaced(
    simulated: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "run.csv"
    for said in ("Written", "Replaced"):
        tactopose("export", simulated, "--format", "csv", "--out", out)
        assert capsys.readouterr().out == f"{said}: {out}\n"


def test_a_table_of_a_run_on_devices_has_its_wrenches(recording: Path, tmp_path: Path) -> None:
    out = tmp_path / "run.csv"
    assert tactopose("export", recording, "--format", "csv", "--out", out) == 0
    for finger, F_S in held_cube.WRENCHES.items():
        last = [row for row in rows(out) if row[f"wrench/{finger}/f_x_N"]][-1]
        names = [f"m_{axis}_Nm" for axis in "xyz"] + [f"f_{axis}_N" for axis in "xyz"]
        np.testing.assert_allclose([float(last[f"wrench/{finger}/{name}"]) for name in names], F_S, atol=0.02)
    found = [row for row in rows(out) if row["object/p_x_m"]]
    best = [line["hypotheses"][0] for line in estimates(recording) if line["hypotheses"]]
    assert len(best) > 3
    assert [float(row["object/probability"]) for row in found] == [line["probability"] for line in best]
    sigmas = [f"object/sigma_w_{axis}_rad" for axis in "xyz"] + [f"object/sigma_v_{axis}_m" for axis in "xyz"]
    np.testing.assert_allclose(
        [[float(row[name]) ** 2 for name in sigmas] for row in found], [np.diag(line["covariance"]) for line in best]
    )
    np.testing.assert_array_equal(
        [[float(row[f"object/q_{part}"]) for part in "wxyz"] for row in found],
        [line["quaternion_wxyz"] for line in best],
    )


def test_what_becomes_unknown_is_not_empty_in_a_table_as_if_it_stayed(recording: Path, tmp_path: Path) -> None:
    run = read_recording(recording)
    hypotheses = next(line["hypotheses"] for line in run.estimates if line["hypotheses"])
    prior = Signal([0.0, 0.1, 0.2], [None, PosePrior(np.eye(3, 4)), None])
    said = [{"time": time, "status": "ok", "hypotheses": each} for time, each in ((0.1, hypotheses), (0.2, None))]
    write_csv(dataclasses.replace(run, signals={"prior": prior}, estimates=tuple(said)), tmp_path / "run.csv")
    for column in ("prior/q_w", "object/p_x_m"):
        cells = {float(row["time_s"]): row[column] for row in rows(tmp_path / "run.csv")}
        assert cells[0.0] == ""
        assert math.isfinite(float(cells[0.1]))
        assert cells[0.2] == "nan"


def test_times_that_differ_by_their_rounding_are_one_row(recording: Path, tmp_path: Path) -> None:
    run = read_recording(recording)
    prior = Signal([0.1, 0.30000000000000004], [None, PosePrior(np.eye(3, 4))])
    said = [{"time": time, "status": text, "hypotheses": None} for time, text in ((0.1, "held"), (0.3, "ok"))]
    write_csv(dataclasses.replace(run, signals={"prior": prior}, estimates=tuple(said)), tmp_path / "run.csv")
    told = [(row["time_s"], row["status"], row["prior/q_w"]) for row in rows(tmp_path / "run.csv")]
    assert told == [("0.1", "held", ""), ("0.3", "ok", "1.0")]


def test_what_cannot_be_exported_is_refused(
    recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert tactopose("export", tmp_path, "--format", "csv", "--out", tmp_path.parent / "x.csv") == 2
    assert "must be a recording" in capsys.readouterr().err
    manifest = recording / "manifest.yaml"
    assert tactopose("export", manifest, "--format", "csv") == 2
    assert capsys.readouterr().err == f"error: {manifest} must be a recording, but has no manifest.yaml.\n"
    assert tactopose("export", recording, "--format", "csv", "--out", recording / "x.csv") == 2
    assert "must be another file than an input, and not in one" in capsys.readouterr().err
    assert tactopose("export", recording, "--format", "bag") == 2


@pytest.mark.parametrize(
    ("name", "change", "fault"),
    [
        ("joint_positions", {"vector": [0.1] * 9}, "signal 'joint_positions' must have 8 numbers, not 9"),
        ("pressures_palm", {"name": "pressures_toe"}, "each name in signals must be one of .*, not 'pressures_toe'"),
        ("true_pose", {"pose": ..., "vector": [0.1]}, "Its true_pose must be a pose, not another kind of value"),
        ("prior", {"prior": ..., "unknown": True, "name": "palm_pose"}, "Its palm_pose must be a pose"),
    ],
)
def test_signals_of_another_hand_are_refused(
    simulated: Path, tmp_path: Path, name: str, change: dict, fault: str
) -> None:
    copy = Path(shutil.copytree(simulated, tmp_path / "copy"))
    lines = [json.loads(line) for line in (copy / "signals.jsonl").read_text().splitlines()]
    for line in lines:
        if line["name"] == name:
            line |= change
    kept = [{key: value for key, value in line.items() if value is not ...} for line in lines]
    (copy / "signals.jsonl").write_text("".join(json.dumps(line) + "\n" for line in kept))
    with pytest.raises(InvalidFileError, match=fault):
        read_recording(copy)


@pytest.mark.parametrize("log", [".", ".."])
def test_a_file_is_called_as_the_folder_is_however_that_is_named(
    simulated: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, log: str
) -> None:
    copy = tmp_path / "grip"
    shutil.copytree(simulated, copy)
    inside = copy if log == "." else copy / "inside"
    inside.mkdir(exist_ok=True)
    monkeypatch.chdir(inside)
    assert tactopose("export", log, "--format", "csv") == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["grip", "grip.csv"]


def test_a_recording_of_when_no_stamp_reaches_is_refused(
    simulated: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    copy = tmp_path / "late"
    shutil.copytree(simulated, copy)
    manifest = (copy / "manifest.yaml").read_text()
    start = next(line for line in manifest.splitlines() if line.startswith("start: "))
    (copy / "manifest.yaml").write_text(manifest.replace(start, "start: 2147483647.97"))
    assert tactopose("export", copy, "--format", "mcap") == 2
    errors = capsys.readouterr().err
    assert "not 2147483648 s, with which it ends at" in errors
    assert errors.count("\n") == 1
    assert not (tmp_path / "late.mcap").exists()
    assert tactopose("export", copy, "--format", "csv") == 0


def test_signals_that_are_missing_are_said(simulated: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    copy = Path(shutil.copytree(simulated, tmp_path / "copy"))
    (copy / "signals.jsonl").write_text("")
    assert tactopose("export", copy, "--format", "csv", "--out", tmp_path / "run.csv") == 0
    said = " ".join(capsys.readouterr().err.split())
    assert "signals.jsonl has no pressures_" in said
    assert "joint_positions, which the run has recorded." in said


def test_damaged_estimates_are_said_and_the_rest_is_exported(
    simulated: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    copy = tmp_path / "copy"
    copy.mkdir()
    for file in simulated.iterdir():
        (copy / file.name).write_bytes(file.read_bytes())
    lines = (copy / "estimates.jsonl").read_text().splitlines()
    (copy / "estimates.jsonl").write_text("\n".join([lines[0], '{"time": 1.0, "hypotheses": [{}]}', *lines[1:]]))
    with (copy / "signals.jsonl").open("a") as file:
        file.write('{"time": 0.')
    out = tmp_path / "run.csv"
    assert tactopose("export", copy, "--format", "csv", "--out", out) == 0
    said = capsys.readouterr().err
    assert "estimates.jsonl cannot be read from line 2 on" in said
    assert "is cut off after" in said
    assert len([row for row in rows(out) if row["status"]]) == 1
    (copy / "estimates.jsonl").unlink()
    assert tactopose("export", copy, "--format", "csv", "--out", out) == 0
    assert "estimates.jsonl is missing, so there are no estimates." in capsys.readouterr().err


HYPOTHESIS = {
    "translation": [0.0, 0.0, 0.1],
    "quaternion_wxyz": [1.0, 0.0, 0.0, 0.0],
    "covariance": np.eye(6).tolist(),
    "probability": 1.0,
}
IMPOSSIBLE = {
    "a time that is no number": {"time": math.nan},
    "a time beyond all clocks": {"time": 1e300},
    "a time before the last": {"time": -1.0},
    "a time as text": {"time": "0.02"},
    "no pose": {"hypotheses": []},
    "a place that is no number": {"hypotheses": [HYPOTHESIS | {"translation": [math.nan, 0.0, 0.0]}]},
    "no turn": {"hypotheses": [HYPOTHESIS | {"quaternion_wxyz": [0.0] * 4}]},
    "a covariance of text": {"hypotheses": [HYPOTHESIS | {"covariance": [["a"] * 6] * 6}]},
    "a negative variance": {"hypotheses": [HYPOTHESIS | {"covariance": (-np.eye(6)).tolist()}]},
    "a probability of text": {"tracked_hypotheses": [HYPOTHESIS | {"probability": "1"}]},
    "half a character": {"status": "\ud800"},
    "a status that is none": {"status": None},
    "a finger that is none": {"fingers_in_contact": [3]},
}


@pytest.mark.parametrize("change", IMPOSSIBLE.values(), ids=list(IMPOSSIBLE))
def test_estimates_that_cannot_be_are_said_and_those_before_are_exported(
    simulated: Path, tmp_path: Path, change: dict
) -> None:
    copy = Path(shutil.copytree(simulated, tmp_path / "copy"))
    lines = estimates(copy)
    assert len(lines) == 3
    lines[1] |= change
    (copy / "estimates.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))
    run = read_recording(copy)
    assert run.problems == (f"{copy / 'estimates.jsonl'} cannot be read from line 2 on.",)
    assert list(run.estimates) == lines[:1]


def test_messages_are_made_as_they_are_written(
    simulated: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    links, encode, made, written = mcap_export._Hand.links, mcap_export.encode, [], []
    monkeypatch.setattr(mcap_export._Hand, "links", lambda self, q: made.append(q) or links(self, q))
    monkeypatch.setattr(mcap_export, "encode", lambda kind, value: written.append(len(made)) or encode(kind, value))
    write_mcap(read_recording(simulated), tmp_path / "run.mcap")
    assert len(made) > 10
    assert np.diff(written).max() == 1  # Those of an hour would not fit in memory.
