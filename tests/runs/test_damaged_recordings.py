"""Recordings that are not what a run has written: each is refused in one line, and none plays as if it were whole."""

import dataclasses
import gc
import json
import shutil
import struct
import weakref
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from pydrake.math import RigidTransform

from tactopose_drake.drivers.log_frames import log_frames
from tactopose_drake.errors import EndOfLogError, InvalidFileError
from tactopose_drake.estimation.prior import PosePrior
from tactopose_drake.hand.hand_config import load_hand_config
from tactopose_drake.hand.hand_in_plant import make_hand_plant
from tactopose_drake.hand.tactile_pads import load_tactile_pad
from tactopose_drake.runs.estimate_writer import EstimateWriter
from tactopose_drake.runs.manifest import ESTIMATES, SIGNALS, load_manifest, save_manifest
from tactopose_drake.runs.scenario_replay import replay
from tactopose_drake.runs.scenario_run import run_scenario
from tactopose_drake.runs.stepping import RunView
from tactopose_drake.station.can_devices import logged_buses
from tactopose_drake.station.can_senses import CanBus, CanSenses, ForceTorqueBoard
from tactopose_drake.station.scenario import Scenario, load_scenario
from tactopose_drake.station.senses import RecordedSenses
from tactopose_drake.systems.signals import SignalRecorder


@pytest.fixture(scope="module")
def scenario() -> Scenario:
    return load_scenario("barrett_like")


@pytest.fixture(scope="module")
def recording(scenario: Scenario, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Of a simulated hand that feels nothing, for three tenths of a second."""
    folder = tmp_path_factory.mktemp("recordings") / "empty_hand"
    folder.mkdir()
    save_manifest(folder, scenario, 0.0, {}, {})
    config = load_hand_config(scenario.hand)
    plant, _ = make_hand_plant(config)
    with SignalRecorder(folder / SIGNALS) as recorder:
        for time in (0.0, 0.1, 0.2, 0.3):
            recorder.write("joint_positions", time, np.full(plant.num_positions(), 0.1 + time))
            recorder.write("prior", time, PosePrior(np.eye(3, 4)))
            recorder.write("true_pose", time, RigidTransform([0.0, 0.0, time]))
            for finger in config.fingers:
                if finger.sensor_frame:
                    recorder.write(f"wrench_{finger.name}", time, np.zeros(6))
            for pad in config.pads:
                recorder.write(f"pressures_{pad.name}", time, np.zeros(len(load_tactile_pad(pad.array).layout)))
    return folder


def test_the_recording_plays_as_it_is(recording: Path, scenario: Scenario) -> None:
    played = replay(recording, scenario)
    assert played.whole
    assert played.view.context.get_time() == 0.3


def test_a_part_that_ends_between_two_estimates_is_like_the_run(
    recording: Path, scenario: Scenario, tmp_path: Path
) -> None:
    copy = Path(shutil.copytree(recording, tmp_path / "copy"))
    with EstimateWriter(copy / ESTIMATES) as writer:
        replay(recording, scenario, observer=lambda view: writer.write(view.diagram, view.context))
    played = replay(copy, scenario, duration=0.25)
    assert (played.view.context.get_time(), played.difference) == (0.25, "")
    other = dataclasses.replace(scenario, surface_sigma=0.002)  # They are not to be compared.
    assert replay(copy, other, duration=0.25).difference == ""
    signals = copy / SIGNALS
    edit(lambda lines: [line for line in lines if line["time"] <= 0.2])(copy)
    signals.write_text(signals.read_text().replace('"time": 0.2', '"time": 0.15') + '{"time"')
    played = replay(copy, scenario)
    assert (played.view.context.get_time(), played.whole, played.difference) == (0.15, False, "")


def test_a_replay_that_is_interrupted_or_cut_off_is_not_whole(
    recording: Path, scenario: Scenario, tmp_path: Path
) -> None:
    def interrupt(view: RunView) -> None:
        if view.context.get_time() > 0.15:
            raise KeyboardInterrupt

    played = replay(recording, scenario, observer=interrupt)
    assert (played.whole, played.ends) == (False, ("The replay was interrupted at 0.20 s.",))
    copy = Path(shutil.copytree(recording, tmp_path / "copy"))
    of_recording = dataclasses.replace(scenario, senses=RecordedSenses(folder=str(copy)))
    assert run_scenario(of_recording).cut == ()
    assert run_scenario(of_recording, observer=interrupt).cut == ("The replay was interrupted at 0.20 s.",)
    with (copy / SIGNALS).open("a") as file:
        file.write('{"time"')
    (said,) = run_scenario(of_recording).cut
    assert "is cut off after" in said


def test_a_replay_is_freed(recording: Path, scenario: Scenario) -> None:
    played = replay(recording, scenario, duration=0.1)
    diagram = weakref.ref(played.view.diagram)
    gc.collect()
    assert played.view.context.get_time() == pytest.approx(0.1)
    del played
    gc.collect()
    assert diagram() is None


def edit(change: Callable[[list[dict]], object]) -> Callable[[Path], None]:
    """Damages the signals."""

    def damage(folder: Path) -> None:
        lines = [json.loads(line) for line in (folder / SIGNALS).read_text().splitlines()]
        changed = change(lines)
        lines = changed if isinstance(changed, list) else lines
        (folder / SIGNALS).write_text("".join(json.dumps(line) + "\n" for line in lines))

    return damage


def edit_text(file: str, change: Callable[[str], str]) -> Callable[[Path], None]:
    def damage(folder: Path) -> None:
        text = (folder / file).read_text()
        assert change(text) != text
        (folder / file).write_text(change(text))

    return damage


def replaced(file: str, old: str, new: str) -> Callable[[Path], None]:
    return edit_text(file, lambda text: text.replace(old, new, 1))


def without(name: str) -> Callable[[Path], None]:
    return edit(lambda lines: [line for line in lines if line["name"] != name])


def of(lines: list[dict], name: str) -> dict:
    return [line for line in lines if line["name"] == name][-1]


DAMAGES = {
    "start nan": (replaced("manifest.yaml", "start: 0.0", "start: .nan"), "start must be a finite number, not '.nan'"),
    "start early": (replaced("manifest.yaml", "start: 0.0", "start: -3600"), "start must be a number >= 0, not -3600"),
    "half a manifest": (
        edit_text("manifest.yaml", lambda text: text.partition("versions:")[0]),
        "Manifest.versions must be there, but are missing: the file is cut off",
    ),
    "bus": (
        replaced("manifest.yaml", "buses: {}", "buses: {left: signals.jsonl}"),
        "Manifest.buses must be those of the scenario's senses, none, not left",
    ),
    "bias": (
        replaced("manifest.yaml", "biases: {}", "biases: {toe: [1]}"),
        "Manifest.biases must be those of the scenario's senses, none, not toe",
    ),
    "shuffled": (edit(lambda lines: lines[::-1]), "must be a signal (its time is"),
    "no joints": (
        without("joint_positions"),
        "It must have the joint_positions, which the run has recorded, but lacks it",
    ),
    "no prior": (without("prior"), "It must have the prior, which the run has recorded, but lacks it"),
    "no pad": (without("pressures_palm"), "It must have the pressures_palm, which the run has recorded, but lacks it"),
    "short": (edit(lambda lines: of(lines, "joint_positions")["vector"].pop()), "differs in kind or length"),
    "all short": (
        edit(lambda lines: [line["vector"].pop() for line in lines if line["name"] == "joint_positions"] and None),
        "'joint_positions' must have 8 numbers, not 7",
    ),
    "no vector": (edit(lambda lines: of(lines, "joint_positions").update(vector=3)), "must be a signal"),
    "two kinds": (edit(lambda lines: lines[0].update(unknown=True)), "must be a signal"),
    "text": (edit(lambda lines: of(lines, "joint_positions")["vector"].__setitem__(0, "1")), "is not a finite number"),
    "truth": (edit(lambda lines: of(lines, "joint_positions")["vector"].__setitem__(0, True)), "not a finite number"),
    "digits": (edit(lambda lines: of(lines, "joint_positions")["vector"].__setitem__(0, 10**400)), "must be a signal"),
    "time": (edit(lambda lines: lines[-1].update(time="0.3")), "'0.3' is not a finite number"),
    "huge time": (replaced(SIGNALS, '"time": 0.3', '"time": 1e400'), "inf is not a finite number"),
    "nan": (replaced(SIGNALS, '"vector": [', '"vector": [NaN, '), "NaN is not a number"),
    "twice": (replaced(SIGNALS, '"time": 0.3', '"time": 0.3, "time": 0.3'), "a key is given twice"),
    "nested": (replaced(SIGNALS, '"vector": [', '"vector": ' + "[" * 20000), "must be a signal"),
    "name": (edit(lambda lines: lines[-1].update(name=["a"])), "its name must be text"),
    "stranger": (
        edit(lambda lines: of(lines, "joint_positions").update(name="toe")),
        "not 'toe'",
    ),
    "prior": (edit(lambda lines: of(lines, "prior").update(prior={"X_PO": 3})), "must be a signal"),
    "no pose": (edit(lambda lines: of(lines, "true_pose").update(pose=[[1, 0, 0, 0]] * 3)), "must be a signal"),
    "empty": (lambda folder: (folder / SIGNALS).write_text(""), "which the run has recorded, but lacks it"),
    "absent": (lambda folder: (folder / SIGNALS).unlink(), "signals.jsonl cannot be read"),
}


@pytest.mark.parametrize("name", DAMAGES)
def test_a_damaged_recording_is_refused_in_one_line(
    recording: Path, scenario: Scenario, tmp_path: Path, name: str
) -> None:
    damage, fault = DAMAGES[name]
    copy = Path(shutil.copytree(recording, tmp_path / "copy"))
    damage(copy)
    with pytest.raises(InvalidFileError) as caught:
        replay(copy, scenario)
    message = str(caught.value)
    assert fault in message
    assert "\n" not in message
    assert len(message) < 700


def test_a_recording_from_devices_names_all_of_them(tmp_path: Path) -> None:
    board = ForceTorqueBoard(bus="left")
    senses = CanSenses(buses={"left": CanBus(interface="virtual")}, fingers={"first": board})
    scenario = Scenario(object="cube", senses=senses)
    log = tmp_path / "left.blf"
    log.write_bytes(b"")
    for buses, biases, fault in (
        ({}, {"first": np.zeros(6)}, "Manifest.buses must be those of the scenario's senses, left, not none"),
        ({"left": log}, {}, "Manifest.biases must be those of the scenario's senses, first, not none"),
        ({"left": log}, {"toe": np.zeros(6)}, "Manifest.biases must be those of the scenario's senses, first, not toe"),
        ({"left": log}, {"first": np.zeros(5)}, r"Manifest.biases\[first\] must have the shape \(6,\), not \(5,\)"),
    ):
        save_manifest(tmp_path, scenario, 1.7e9, buses, biases)
        with pytest.raises(InvalidFileError, match=fault):
            load_manifest(tmp_path)
    save_manifest(tmp_path, scenario, 1.7e9, {"left": log}, {"first": np.zeros(6)})
    with pytest.raises(InvalidFileError, match=r"left\.blf must be a log of CAN frames \(it is empty\)"):
        logged_buses({"left": log})
    log.unlink()
    with pytest.raises(InvalidFileError, match=r"left\.blf, the log of the bus 'left', is missing"):
        load_manifest(tmp_path)


def test_a_log_whose_object_has_no_length_ends_there(tmp_path: Path) -> None:
    header = struct.pack("<4sLBBBBBBBBQQLL8H8H72x", b"LOGG", 144, 0, 0, 0, 0, 2, 6, 8, 1, 176, 176, 1, 0, *([0] * 16))
    nothing = struct.pack("<4sHHLL", b"LOBJ", 16, 9, 0, 86)
    container = struct.pack("<4sHHLLH6xL4x", b"LOBJ", 16, 1, 32 + len(nothing), 10, 0, len(nothing)) + nothing
    (tmp_path / "log.blf").write_bytes(header + container)
    with pytest.raises((EndOfLogError, InvalidFileError)):
        list(log_frames(tmp_path / "log.blf"))
