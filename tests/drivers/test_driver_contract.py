"""What every bus must give: one contract, in virtual time, in one process, between processes, and on a kernel's CAN."""

import contextlib
import json
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import can
import numpy as np
import pytest

from tactopose_drake.drivers.barrett_hand import BarrettHand
from tactopose_drake.drivers.can_recorder import CanRecorder
from tactopose_drake.drivers.device_bus import DeviceBus
from tactopose_drake.drivers.netcanoem import NetCanOemForceTorque
from tactopose_drake.drivers.replay_bus import open_log
from tactopose_drake.drivers.simulation import faults
from tactopose_drake.drivers.simulation.device_server import DeviceServer
from tactopose_drake.errors import BusError, DeviceTimeoutError, EndOfLogError
from tests.drivers.rigs import HAND_STATE, SLOT, WRENCH, WRENCH_TOLERANCE, make_board, make_hand, unread, virtual_bus

MakeBus = Callable[[], contextlib.AbstractContextManager[DeviceBus]]


class DriverContract:
    """`make_bus` gives an open bus with a board and a hand, as `rigs` makes them, on its other end."""

    def test_both_devices_are_read_at_once(self, make_bus: MakeBus) -> None:
        with make_bus() as bus, NetCanOemForceTorque(bus, calibration_slot=SLOT) as sensor, BarrettHand(bus) as hand:
            for _ in range(3):
                reading, sample = sensor.read(5.0), hand.read(5.0)
                assert (reading.status, sample.status) == ("ok", "ok")
                assert np.all(np.abs(reading.F_S - WRENCH) < WRENCH_TOLERANCE)
                np.testing.assert_allclose(sample.pressures, HAND_STATE.pressures, atol=20)
                np.testing.assert_allclose(sample.joint_positions, HAND_STATE.joint_positions, atol=1e-4)

    def test_times_are_the_clocks_and_rise(self, make_bus: MakeBus) -> None:
        with make_bus() as bus:
            before = bus.clock.time()
            with NetCanOemForceTorque(bus, calibration_slot=SLOT) as sensor:
                times = [sensor.read(5.0).time for _ in range(20)]
            assert before < times[0]
            assert np.all(np.diff(times) > 0)
            assert times[-1] <= bus.clock.time()
            assert sensor.newest is not None
            assert sensor.newest.time >= times[-1]

    def test_a_device_that_is_not_there_is_named_and_the_others_go_on(self, make_bus: MakeBus) -> None:
        with (
            make_bus() as bus,
            NetCanOemForceTorque(bus, calibration_slot=SLOT) as sensor,
            NetCanOemForceTorque(bus, 0x30, name="little finger") as absent,
        ):
            with pytest.raises(
                DeviceTimeoutError, match=r"little finger gave no sample .* no reply to the request for its firmware"
            ):
                absent.read(0.3)
            unread(sensor)
            assert sensor.read(5.0).status == "ok"

    def test_a_device_may_leave_and_come_back(self, make_bus: MakeBus) -> None:
        with make_bus() as bus:
            for _ in range(2):
                with NetCanOemForceTorque(bus, calibration_slot=SLOT) as sensor:
                    assert sensor.read(5.0).status == "ok"

    def test_a_tare_makes_the_load_the_zero(self, make_bus: MakeBus) -> None:
        with make_bus() as bus, NetCanOemForceTorque(bus, calibration_slot=SLOT) as sensor:
            sensor.tare(samples=3, timeout=5.0)
            np.testing.assert_array_equal(sensor.read(5.0).F_S, np.zeros(6))

    def test_a_closed_bus_says_so_and_leaves_nothing_behind(self, make_bus: MakeBus) -> None:
        threads, files = set(threading.enumerate()), open_files()
        with make_bus() as bus, NetCanOemForceTorque(bus, calibration_slot=SLOT) as sensor:
            sensor.read(5.0)
        unread(sensor)
        with pytest.raises(BusError, match="closed"):
            sensor.read(0.1)
        assert "closed" in sensor.status
        assert set(threading.enumerate()) == threads
        assert open_files() == files

    @pytest.mark.parametrize("suffix", [".blf", ".asc"])
    def test_a_log_replays_to_the_same_samples(self, make_bus: MakeBus, tmp_path: Path, suffix: str) -> None:
        log = tmp_path / f"log{suffix}"
        with make_bus() as bus, CanRecorder(log) as recorder:
            recorder.record(bus)
            with NetCanOemForceTorque(bus, calibration_slot=SLOT) as sensor, BarrettHand(bus) as hand:
                live = [sensor.read(5.0) for _ in range(30)], [hand.read(5.0) for _ in range(2)]
        first, second = replay(log), replay(log)
        for samples, once, again in zip(live, first, second, strict=True):
            assert [as_bytes(sample) for sample in once] == [as_bytes(sample) for sample in again]
            # An answer that came when it was waited for no more is waited for in the log: a replay may have more.
            times = np.array([sample.time for sample in once])
            for sample in samples:
                k = int(np.argmin(np.abs(times - sample.time)))
                # A text log moves its times by up to a millisecond.
                assert abs(times[k] - sample.time) <= (0.0 if suffix == ".blf" else 1.1e-3)
                assert as_bytes(once[k])[1:] == as_bytes(sample)[1:]


def replay(log: Path) -> tuple[list, list]:
    with open_log(log) as bus, NetCanOemForceTorque(bus, calibration_slot=SLOT) as sensor, BarrettHand(bus) as hand:
        with pytest.raises(EndOfLogError, match="ended after"):
            bus.run_until(np.inf)
        return unread(sensor), unread(hand)


def as_bytes(sample) -> list[bytes]:
    """Every field, the time first."""
    fields = [getattr(sample, name) for name in type(sample).__dataclass_fields__]
    return [field.tobytes() if isinstance(field, np.ndarray) else repr(field).encode() for field in fields]


def open_files() -> set[str]:
    """What this process has open; a socket made and closed meanwhile leaves no trace."""
    folder = Path("/proc/self/fd")
    if not folder.is_dir():
        return set()
    found = set()
    for entry in folder.iterdir():
        with contextlib.suppress(OSError):
            found.add(f"{entry.name} {os.readlink(entry)}")
    return {name for name in found if not name.endswith("/fd")}


class TestVirtualTime(DriverContract):
    @pytest.fixture
    def make_bus(self) -> MakeBus:
        return lambda: virtual_bus(make_board(), make_hand())


class TestVirtual(DriverContract):
    @pytest.fixture
    def make_bus(self, request: pytest.FixtureRequest) -> MakeBus:
        @contextlib.contextmanager
        def make() -> Iterator[DeviceBus]:
            channel = request.node.name
            with (
                DeviceServer(can.Bus(interface="virtual", channel=channel), [make_board(), make_hand()]),
                DeviceBus.open("virtual", channel) as bus,
            ):
                yield bus

        return make

    def test_a_fault_comes_and_goes_in_real_time(self) -> None:
        board = make_board()
        with (
            DeviceServer(can.Bus(interface="virtual", channel="fault"), [board]),
            DeviceBus.open("virtual", "fault") as bus,
            NetCanOemForceTorque(bus, calibration_slot=SLOT) as sensor,
        ):
            assert sensor.read(5.0).status == "ok"
            board.faults = [faults.silence]
            for _ in range(1000):
                if "no reply" in sensor.status:
                    break
                with contextlib.suppress(DeviceTimeoutError):
                    sensor.read(0.05)
            unread(sensor)
            with pytest.raises(DeviceTimeoutError, match="no reply"):
                sensor.read(0.05)
            board.faults = []
            assert sensor.read(5.0).status == "ok"


@contextlib.contextmanager
def devices_elsewhere(**options: Any) -> Iterator[None]:
    """Simulated devices in another process."""
    root = Path(__file__).parents[2]
    command = [sys.executable, "-m", "tests.drivers.serve_devices", json.dumps(options)]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True, cwd=root) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        try:
            assert process.stdout.readline() == "ready\n"
            yield
        finally:
            process.stdin.close()
            assert process.wait(10) == 0


def multicast_works(**options: Any) -> bool:
    try:
        with can.Bus(**options) as one, can.Bus(**options) as other:
            one.send(can.Message(arbitration_id=1))
            return other.recv(0.5) is not None
    except (can.CanError, OSError):
        return False


class TestUdpMulticast(DriverContract):
    @pytest.fixture(scope="class")
    @classmethod
    def make_bus(cls) -> Iterator[MakeBus]:
        # Confined to this machine, and to this run.
        options = {"interface": "udp_multicast", "channel": "239.74.163.2", "hop_limit": 0}
        options["port"] = 20_000 + os.getpid() % 20_000
        if not multicast_works(**options):
            pytest.skip("there is no route for multicast, or msgpack is not installed")
        with devices_elsewhere(**options):
            yield lambda: DeviceBus.open(**options)


class TestVcan(DriverContract):
    @pytest.fixture(scope="class")
    @classmethod
    def make_bus(cls) -> Iterator[MakeBus]:
        options = {"interface": "socketcan", "channel": "vcan0"}
        try:
            can.Bus(**options).shutdown()
        except OSError as error:
            pytest.skip(f"there is no vcan0 ({error})")
        with devices_elsewhere(**options):
            yield lambda: DeviceBus.open(**options)


def test_a_paced_replay_runs_as_fast_as_it_was_recorded(tmp_path: Path) -> None:
    log = tmp_path / "log.blf"
    with virtual_bus(make_board()) as bus, CanRecorder(log) as recorder:
        recorder.record(bus)
        with NetCanOemForceTorque(bus, calibration_slot=SLOT) as sensor:
            live = [sensor.read() for _ in range(40)]
    began = time.monotonic()
    bus = open_log(log, paced=True)
    with NetCanOemForceTorque(bus, calibration_slot=SLOT) as sensor, bus:
        played = [sensor.read(5.0) for _ in range(40)]
        with pytest.raises(EndOfLogError, match="ended after"):
            sensor.read(5.0)
        assert "ended after" in sensor.status
    assert [as_bytes(sample) for sample in played] == [as_bytes(sample) for sample in live]
    assert time.monotonic() - began >= live[-1].time - live[0].time
