"""The signals of a recording as they are read, one after the other."""

import math
import weakref
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from tactopose_drake.errors import InvalidFileError
from tactopose_drake.runs.manifest import SIGNALS
from tactopose_drake.runs.recorded_senses import read_recording
from tactopose_drake.runs.sense_reader import SenseReader, _BesideDevices
from tactopose_drake.systems.signals import Change, SignalFile, Value


def test_the_changes_come_in_order_of_time_and_are_those_of_the_whole(recording: Path) -> None:
    reader, changes = SenseReader(recording), list[Change]()
    assert reader.read(lambda *change: changes.append(change)) == []
    times = [time for _, time, _ in changes]
    assert times == sorted(times)
    run = read_recording(recording)
    assert {name for name, _, _ in changes} == set(run.signals)
    assert "wrench_thumb" in run.signals
    for name, signal in run.signals.items():
        assert [time for other, time, _ in changes if other == name] == signal.times
    assert reader.joints == run.joints


def test_nothing_is_kept_of_a_file_that_is_read(tmp_path: Path) -> None:
    lines = (f'{{"time": {0.01 * k}, "name": "wrench_thumb", "vector": [{k}.0]}}\n' for k in range(2000))
    (tmp_path / SIGNALS).write_text("".join(lines) + '{"time": 30.0, "na')
    file, values = SignalFile(tmp_path / SIGNALS), list[weakref.ref[Value]]()
    for _, _, value in file.changes():
        values.append(weakref.ref(value))
    del value
    assert len(values) == 2000
    assert sum(value() is not None for value in values) <= 1
    assert file.cut == f"{tmp_path / SIGNALS} is cut off after 2000 whole lines."


def test_beside_devices_only_the_present_is_kept() -> None:
    def changes() -> Iterator[Change]:
        yield "prior", 0.0, None
        for k in range(10_000):
            yield "joint_positions", 0.01 * k, np.array([float(k)])

    beside, taken, most = _BesideDevices(changes(), ["joint_positions"]), [], 0
    for step in range(500):
        now = 0.1 * step
        taken += beside.taken(now)
        joints = beside.known["joint_positions"]
        for time in (now - 0.05, now, now + 0.1):
            if time >= 0.0:
                assert joints.at(time)[0] == pytest.approx(math.floor(100.0 * time + 1e-9), abs=1.0)
        beside.keep(now - 0.1, now + 0.2)
        most = max(most, len(joints.times))
    assert most < 50
    assert set(beside.known) == {"joint_positions"}
    taken += beside.rest()
    assert [time for name, time, _ in taken if name == "joint_positions"] == [0.01 * k for k in range(10_000)]
    assert taken[0] == ("prior", 0.0, None)


def test_a_signal_of_another_kind_is_named_before_it_is_passed_on(recording: Path, tmp_path: Path) -> None:
    for file in recording.iterdir():
        (tmp_path / file.name).write_bytes(file.read_bytes())
    with (tmp_path / SIGNALS).open("a") as file:
        file.write('{"time": 1000.0, "name": "palm_pose", "vector": [1.0]}\n')
    passed = list[str]()
    with pytest.raises(InvalidFileError, match=r"is damaged\. Its palm_pose must be a pose"):
        SenseReader(tmp_path).read(lambda name, time, value: passed.append(name))
    assert "palm_pose" not in passed
