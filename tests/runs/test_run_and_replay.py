"""Whole runs on simulated devices, recorded; and their replay, here and in another process."""

import importlib.metadata
import json
import os
import re
import shutil
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from tactopose_drake.errors import InvalidFileError, InvalidInputError
from tactopose_drake.resources import model_path
from tactopose_drake.runs.manifest import load_manifest
from tactopose_drake.runs.monitor import explained_estimate
from tactopose_drake.runs.recorded_senses import read_recording
from tactopose_drake.runs.scenario_replay import replay
from tactopose_drake.runs.scenario_run import run_scenario
from tactopose_drake.runs.stepping import RunView
from tactopose_drake.station.scenario import load_scenario
from tactopose_drake.systems.signals import read_signals
from tests import held_cube
from tests.cli.test_cli import run as tactopose
from tests.runs.stations import bus_threads


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


def test_a_replay_makes_a_page_without_changing_its_estimates(
    recording: Path, folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    alone, beside, page = tmp_path / "alone.jsonl", tmp_path / "beside.jsonl", tmp_path / "page.html"
    assert replay_here(recording, folder, alone) == 0
    arguments = ["--scenario", folder / "cube.scenario.yaml", "--out", beside, "--html", page]
    assert tactopose("replay", recording, *arguments) == 0
    assert "Replaced" not in capsys.readouterr().out
    assert alone.read_bytes() == beside.read_bytes()
    text = page.read_text()
    assert len(text) < 6e6
    for said in (
        "<title>Cube in the shadow-like hand: recording grasp</title>",
        "contact force, N",
        "\u00b1 position, mm",
        "tp-time",
    ):
        assert said in text
    assert tactopose("replay", recording, *arguments) == 0
    assert f"Replaced: {beside}, {page}" in capsys.readouterr().out


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
    assert "signals.jsonl is cut off after 1 whole lines. It must have the joint_positions" in message
    # The joints never move, so all that is recorded of them is the first line.
    rows = (recording / "signals.jsonl").read_bytes().splitlines(keepends=True)
    signals.write_bytes(b"".join(rows) + b'{"time": 0.5')
    replay_here(copy, folder, tmp_path / "out.jsonl")
    assert "signals.jsonl is cut off after 2 whole lines" in capsys.readouterr().out


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
    text = f"From {other['time']:.2f} s on, the estimates are not those of the run: "
    for change, why in ((0.001, "a live run uses"), (0.03, "the best poses are up to 31 mm apart.")):
        other["hypotheses"][0]["translation"][0] += change
        (copy / "estimates.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))
        assert replay_here(copy, folder, out) == 0
        said = capsys.readouterr().out
        assert text + why in said
        assert "recorded with" not in said
    manifest = copy / "manifest.yaml"
    manifest.write_text(re.sub(r"\n  drake: .*", "\n  drake: 0.1.0", manifest.read_text()))
    assert replay_here(copy, folder, out) == 0
    here = importlib.metadata.version("drake")
    assert f"up to 31 mm apart. It was recorded with drake 0.1.0, which here is {here}." in capsys.readouterr().out
    # A period's delay of the touch is a live run's; that of half the run is not.
    rows = lines(out)
    for row in reversed(range(1, len(rows))):
        rows[row] = rows[row - 1] | {"time": rows[row]["time"]}
    (copy / "estimates.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))
    assert replay_here(copy, folder, out) == 0
    assert "the run: a live run uses" in capsys.readouterr().out
    silent = {"fingers_in_contact": [], "hypotheses": None}
    late = [row | silent if row["time"] < 0.7 else row for row in rows]
    (copy / "estimates.jsonl").write_text("".join(json.dumps(row) + "\n" for row in late))
    assert replay_here(copy, folder, out) == 0
    assert "times, other fingers touch or one of the two has no pose." in capsys.readouterr().out


def test_a_recording_without_the_prior_that_the_run_had_is_refused(
    recording: Path, folder: Path, tmp_path: Path
) -> None:
    copy = Path(shutil.copytree(recording, tmp_path / "copy"))
    signals = (copy / "signals.jsonl").read_text().splitlines(keepends=True)
    (copy / "signals.jsonl").write_text("".join(line for line in signals if '"name": "prior"' not in line))
    with pytest.raises(InvalidFileError, match="must have the prior, which the run has recorded, but lacks it"):
        replay(copy, load_scenario(folder / "cube.scenario.yaml"))


def test_a_recording_whose_project_has_moved_replays(recording: Path, folder: Path, tmp_path: Path) -> None:
    shutil.copy(model_path("hands", "shadow_like", "shadow_like.hand.yaml"), tmp_path / "my.hand.yaml")
    shutil.copy(model_path("objects", "cube.obj"), tmp_path / "box.obj")
    mine = tmp_path / "my.scenario.yaml"
    text = (folder / "cube.scenario.yaml").read_text().replace("hand: shadow_like", "hand: my.hand.yaml")
    mine.write_text(text.replace("object: cube", "object: box.obj"))
    moved = Path(shutil.copytree(recording, tmp_path / "moved"))
    text = (moved / "manifest.yaml").read_text().replace("hand: shadow_like", "hand: /gone/my.hand.yaml")
    text = text.replace(f"folder: {folder}", "folder: /gone/felt")
    (moved / "manifest.yaml").write_text(text.replace("object: cube", "object: /gone/box.obj"))
    result = replay(moved, load_scenario(mine))
    assert result.whole
    assert explained_estimate(result.view) is not None
    (tmp_path / "my.hand.yaml").rename(tmp_path / "other.hand.yaml")
    mine.write_text(mine.read_text().replace("my.hand", "other.hand"))
    with pytest.raises(
        InvalidInputError, match=r"must be replayed with the hand that it was recorded with, '/gone/my\.hand\.yaml'"
    ):
        replay(moved, load_scenario(mine))


def test_what_a_recording_needs_is_named_where_it_says_so(recording: Path, tmp_path: Path) -> None:
    moved = Path(shutil.copytree(recording, tmp_path / "moved"))
    text = (moved / "manifest.yaml").read_text()
    for old, new, place in (
        ("hand: shadow_like", "hand: /gone/my.hand.yaml", r"scenario\.hand: "),
        ("object: cube", "object: /gone/box.obj", r"Scenario\.object must be .* but "),
    ):
        (moved / "manifest.yaml").write_text(text.replace(old, new))
        with pytest.raises(InvalidInputError, match=rf"moved/manifest\.yaml: {place}/gone/"):
            read_recording(moved)


def test_a_scenario_may_name_a_recording(recording: Path, folder: Path, tmp_path: Path) -> None:
    scenario = tmp_path / "recorded.scenario.yaml"
    rest = (folder / "cube.scenario.yaml").read_text()
    begin, end = rest.index("senses:"), rest.index("X_WBase")
    scenario.write_text(rest[:begin] + f"senses: !RecordedSenses {{folder: {recording}}}\n" + rest[end:])
    view = run_scenario(load_scenario(scenario))
    off = view.diagram.GetOutputPort("object_pose").Eval(view.context).translation() - held_cube.X_PO[:, 3]
    assert np.linalg.norm(off) < 0.006
    with pytest.raises(InvalidInputError, match="record must be None if the scenario's senses are a recording"):
        run_scenario(load_scenario(scenario), record=tmp_path / "again")


def test_a_run_that_was_late_says_so_although_it_has_caught_up(folder: Path) -> None:
    times = []

    def stop_once(view: RunView) -> None:
        times.append(view.context.get_time())
        if len(times) == 2:
            time.sleep(0.4)

    run_scenario(load_scenario(folder / "cube.scenario.yaml"), duration=0.1)  # first calls are slow
    view = run_scenario(load_scenario(folder / "cube.scenario.yaml"), observer=stop_once)
    assert view.slowness.startswith("at ")
    assert "behind its devices, its most" in view.slowness


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
