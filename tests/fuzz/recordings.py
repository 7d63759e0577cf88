"""Damaged recordings: checked, their logs read and played by the drivers, and some of them played whole."""

import contextlib
import functools
import tempfile
from pathlib import Path
from unittest import mock

import can
import numpy as np

from tactopose_drake.drivers.can_recorder import CanRecorder
from tactopose_drake.drivers.log_frames import log_frames
from tactopose_drake.errors import EndOfLogError
from tactopose_drake.estimation.prior import PosePrior
from tactopose_drake.hand.hand_config import load_hand_config
from tactopose_drake.hand.hand_in_plant import make_hand_plant
from tactopose_drake.hand.tactile_pads import load_tactile_pad
from tactopose_drake.runs import scenario_replay
from tactopose_drake.runs.manifest import MANIFEST, SIGNALS
from tactopose_drake.station import scenario as scenarios
from tactopose_drake.station.can_devices import CanDevices
from tactopose_drake.station.can_senses import CanBus, CanSenses, ForceTorqueBoard
from tactopose_drake.station.scenario import Scenario
from tactopose_drake.systems.force_torque_sensor import load_force_torque_model
from tactopose_drake.systems.signals import SignalRecorder
from tests.fuzz.file_damage import damage, damage_bytes
from tests.fuzz.files import own_folder, read

_PLAYED = 0.001  # share of the recordings that are played to a station; of the others the drivers alone play the logs

# Damaged values of all that a scenario may hold are those of the kind `yaml_files`.
PADS = """format: 1
scenario:
  hand: barrett_like
  object: mug
  seed: 4
  estimation: {estimator: {method: pair_search, max_duration: 0.5}}
versions: {python: 3.11.7}
start: 0.0
buses: {}
biases: {}
"""
BOARDS = """format: 1
scenario:
  hand: shadow_like
  object: cube
  senses: !CanSenses
    buses: {left: {interface: virtual}, right: {interface: virtual, channel: can1}}
    fingers: {first: {bus: left, base: 32}, middle: {bus: left, base: 33}, thumb: {bus: right}}
versions: {python: 3.11.7}
start: 1700000000.0
buses: {left: left.blf, right: right.blf}
biases:
  first: [0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
  middle: [1.0, -2.0, 3.0, 0.0, 0.5, 0.0]
  thumb: [0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
"""


def recordings(rng: np.random.Generator) -> None:
    """Checks a recording with one or two damaged files; its drivers play the logs, and sometimes all is played."""
    base = _recordings()[int(rng.random() < 0.7)]
    names = sorted(base)
    is_played = bool(rng.random() < _PLAYED)
    with own_folder() as folder:
        chosen = {names[i] for i in rng.integers(len(names), size=rng.integers(1, 3))}
        for name, content in base.items():
            if name in chosen:
                content = damage_bytes(content, rng) if name.endswith(".blf") else damage(content.decode(), rng)
            if name not in chosen or rng.random() > 0.05:
                (folder / name).write_bytes(content)
        read(functools.partial(_play, folder, _scenario("left.blf" in base), is_whole=is_played))
        for name in chosen:
            if name.endswith((".blf", ".asc")):
                read(functools.partial(_read_log, folder / name))


def _play(folder: Path, scenario: Scenario, *, is_whole: bool) -> None:
    """Plays a recording, or only what comes before its station is made, which takes seconds: its checks and drivers."""
    with contextlib.ExitStack() as parts:
        for module, name, load in _SHIPPED:
            parts.enter_context(mock.patch.object(module, name, load))
        if not is_whole:
            parts.enter_context(mock.patch.object(scenario_replay, "_make_station", _play_logs))
        parts.enter_context(contextlib.suppress(_LogsPlayedError))
        scenario_replay.replay(folder, scenario, duration=0.2)


_SHIPPED = [  # What is read of the package's own files, each of which is read once.
    (module, load.__name__, functools.cache(load))
    for module, load in (
        (scenarios, load_hand_config),
        (scenarios, load_tactile_pad),
        (scenarios, load_force_torque_model),
        (scenario_replay, load_hand_config),
    )
]


class _LogsPlayedError(Exception):
    """Ends a replay in the place of its station."""


def _play_logs(folder: Path, scenario: Scenario, devices: CanDevices | None, signals: object) -> None:
    if devices is not None:
        with devices:
            for bus in devices.buses.values():
                with contextlib.suppress(EndOfLogError):
                    bus.run_until(bus.clock.time() + 1.0)
    raise _LogsPlayedError


def _read_log(path: Path) -> None:
    try:
        for count, _ in enumerate(log_frames(path)):
            assert count < 10_000, "a log of a hundred frames does not end"
    except EndOfLogError:
        return
    raise AssertionError("a log ended without saying so")


@functools.cache
def _scenario(has_boards: bool) -> Scenario:
    if not has_boards:
        return Scenario(hand="barrett_like", object="mug")
    board = functools.partial(ForceTorqueBoard, bus="left")
    senses = CanSenses(
        buses={name: CanBus(interface="virtual", channel=name) for name in ("left", "right")},
        fingers={"first": board(base=0x20), "middle": board(base=0x21), "thumb": ForceTorqueBoard(bus="right")},
    )
    return Scenario(object="cube", senses=senses)


@functools.cache
def _recordings() -> tuple[dict[str, bytes], dict[str, bytes]]:
    """The files of two recordings: of the simulated hand with pads, and of force-torque boards on two buses."""
    rng = np.random.default_rng(0)
    with tempfile.TemporaryDirectory() as name:
        pads = Path(name, "pads")
        pads.mkdir()
        (pads / MANIFEST).write_text(PADS)
        config = load_hand_config("barrett_like")
        with SignalRecorder(pads / SIGNALS) as recorder:
            for time in (0.0, 0.05, 0.1, 0.15):
                _record_common(recorder, "barrett_like", time, rng)
                for pad in config.pads:
                    pressures = rng.uniform(0.0, 1e4, size=len(load_tactile_pad(pad.array).layout))
                    recorder.write(f"pressures_{pad.name}", time, pressures)
        boards = Path(name, "boards")
        boards.mkdir()
        (boards / MANIFEST).write_text(BOARDS)
        with SignalRecorder(boards / SIGNALS) as recorder:
            _record_common(recorder, "shadow_like", 0.0, rng)
        for log in ("left.blf", "right.blf", "same.asc"):
            with CanRecorder(boards / log) as writer:
                for i in range(30):
                    data = rng.bytes(int(rng.integers(9)))
                    frame = can.Message(
                        arbitration_id=0x200 + int(rng.integers(64)), is_extended_id=False, data=data,
                        timestamp=1.7e9 + 0.004 * i, is_rx=bool(rng.integers(2)),
                    )  # fmt: skip
                    writer.write(frame, 0)
        return _contents(pads), _contents(boards)


def _record_common(recorder: SignalRecorder, hand: str, time: float, rng: np.random.Generator) -> None:
    plant, _ = make_hand_plant(load_hand_config(hand))
    recorder.write("joint_positions", time, rng.uniform(0.0, 1.0, size=plant.num_positions()))
    recorder.write("prior", time, PosePrior(np.eye(3, 4)))


def _contents(folder: Path) -> dict[str, bytes]:
    assert (folder / MANIFEST).is_file()
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}
