"""Disks that are full, and runs that fail: what becomes of their recordings."""

from pathlib import Path
from types import SimpleNamespace

import can
import numpy as np
import pytest

from tactopose_drake.drivers.can_recorder import CanRecorder
from tactopose_drake.errors import BusError, InvalidInputError
from tactopose_drake.runs.recording import Recording
from tactopose_drake.runs.scenario_run import run_scenario
from tactopose_drake.station.can_senses import CanBus, CanSenses, FixedJoints, ForceTorqueBoard
from tactopose_drake.station.scenario import Scenario, load_scenario
from tactopose_drake.systems.line_file import LineFile

FULL = Path("/dev/full")  # Linux' own: every write finds no space left

needs_full = pytest.mark.skipif(not FULL.exists(), reason="the system has no device that is always full")


@needs_full
def test_a_full_disk_ends_the_lines_and_not_the_run() -> None:
    lines = LineFile(FULL)
    lines.write("one")
    lines.write("two")
    lines.close()
    assert lines.count == 0
    assert lines.problem == "/dev/full ends after 0 lines (No space left on device)."


@needs_full
def test_a_full_disk_ends_a_log_and_not_the_thread_of_its_bus() -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("tactopose_drake.drivers.can_recorder.FORMATS", ("",))
        patch.setattr("tactopose_drake.drivers.can_recorder._TextWriter", can.ASCWriter)
        recorder = CanRecorder(FULL)
    with recorder:
        for i in range(3000):
            recorder.write(can.Message(arbitration_id=i, timestamp=1.0 + 1e-3 * i, data=b"12345678"), 0)
    assert recorder.problem.startswith("/dev/full ends after about ")
    assert recorder.problem.endswith("(No space left on device).")


@needs_full
def test_a_recording_says_what_is_lost(tmp_path: Path) -> None:
    with Recording(tmp_path / "run", load_scenario("shadow_like")) as recording:
        recording.write("joint_positions", 0.0, np.zeros(3))
        assert recording.lost == ()
        recording._signals.file._file.close()
        recording._signals.file._file = FULL.open("w", buffering=1)
        recording.write("joint_positions", 0.1, np.ones(3))
        recording.write("joint_positions", 0.2, np.zeros(3))
    assert recording.lost == (f"{tmp_path}/run/signals.jsonl ends after 1 lines (No space left on device).",)
    assert (tmp_path / "run" / "signals.jsonl").read_text().count("\n") == 1


def test_a_disk_without_room_is_told_before_the_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("shutil.disk_usage", lambda folder: SimpleNamespace(free=1_000_000))
    told: list[str] = []
    with pytest.raises(
        InvalidInputError, match=r"run: its disk must have at least 20 MB left for a recording, not 1\.0 MB"
    ):
        run_scenario(load_scenario("shadow_like"), record=tmp_path / "run", tell=told.append)
    assert told == []
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("exists", [False, True])
def test_a_run_that_fails_leaves_nothing_in_the_way_of_the_next(tmp_path: Path, exists: bool) -> None:
    folder = tmp_path / "run"
    if exists:
        folder.mkdir()
    senses = CanSenses(
        buses={"left": CanBus(interface="socketcan", channel="no_such_can")},
        fingers={"first": ForceTorqueBoard(bus="left")},
        joints=FixedJoints(),
    )
    scenario = Scenario(object="cube", senses=senses)
    for _ in range(2):
        with pytest.raises(BusError, match="cannot be opened"):
            run_scenario(scenario, record=folder)
    assert folder.exists() == exists
    assert not exists or list(folder.iterdir()) == []


def test_what_a_run_has_recorded_before_it_failed_stays(tmp_path: Path) -> None:
    def fail() -> None:
        with Recording(tmp_path / "run", load_scenario("shadow_like")) as recording:
            recording.begin(0.0, {})
            recording.write("joint_positions", 0.0, np.zeros(3))
            raise RuntimeError("in the middle")

    with pytest.raises(RuntimeError, match="in the middle"):
        fail()
    assert {path.name for path in (tmp_path / "run").iterdir()} == {"manifest.yaml", "signals.jsonl", "estimates.jsonl"}
