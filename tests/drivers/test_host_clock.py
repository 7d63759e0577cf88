"""The host's clock of day is set while devices are read, or stamps are wrong: nothing waits, and no time goes back."""

import itertools
import math
import time
from collections.abc import Callable

import can
import numpy as np
import pytest

from tactopose_drake.drivers.barrett_hand import BarrettHand
from tactopose_drake.drivers.clock import SteadyClock, VirtualClock
from tactopose_drake.drivers.device_bus import DeviceBus
from tactopose_drake.drivers.netcanoem import NetCanOemForceTorque
from tactopose_drake.drivers.reconnecting_bus import receive
from tactopose_drake.drivers.simulation.device_server import DeviceServer
from tests.drivers.rigs import SLOT, is_right, make_board, make_hand, run, unread, virtual_bus

SetClock = Callable[[float], None]
_real_time = time.time


@pytest.fixture
def set_clock(monkeypatch: pytest.MonkeyPatch) -> SetClock:
    """Sets the clock of day forward by so many seconds of what it would show."""
    forward = [0.0]

    def clock_of_day() -> float:
        return _real_time() + forward[0]

    monkeypatch.setattr("time.time", clock_of_day)
    monkeypatch.setattr("can.bus.time", clock_of_day)  # python-can has its own name for it
    return lambda seconds: forward.__setitem__(0, seconds)


def test_stamps_are_what_they_are_while_nobody_sets_the_clock() -> None:
    clock = SteadyClock()
    for _ in range(100):
        stamp = time.time()
        assert clock.of_stamp(stamp) == stamp
    assert abs(clock.time() - time.time()) < 60.0


@pytest.mark.parametrize("forward", [-3600.0, -1.0, 1.0, 3600.0])
def test_a_set_clock_moves_neither_the_time_nor_stamps(set_clock: SetClock, forward: float) -> None:
    clock = SteadyClock()
    before = clock.time()
    for seconds in (forward, 2.0 * forward, 0.0):
        set_clock(seconds)
        for _ in range(100):  # it may be interrupted between two looks at a clock
            stamped, shown = clock.of_stamp(time.time()), clock.time()
            assert shown >= before
            if abs(stamped - shown) < 0.5:
                break
        else:
            pytest.fail(f"stamps are {stamped - shown:g} s off")


def test_a_clock_that_was_set_takes_the_same_off_all_stamps(set_clock: SetClock) -> None:
    clock = SteadyClock()
    set_clock(3600.0)
    while clock.of_stamp(time.time()) > time.time() - 3000.0:  # until it is noticed
        pass
    assert len({clock.of_stamp(1.7e9) for _ in range(100)}) == 1


def test_virtual_time_never_goes_back() -> None:
    clock = VirtualClock(5.0)
    for until, now in ((6.0, 6.0), (4.0, 6.0), (6.5, 6.5)):
        clock.sleep_until(until)
        assert clock.time() == now


@pytest.mark.parametrize("forward", [-3600.0, 3600.0])
def test_boards_are_polled_whatever_the_clock_of_day_shows(set_clock: SetClock, forward: float) -> None:
    channel = f"clock set by {forward}"
    with (
        DeviceServer(can.Bus(interface="virtual", channel=channel), [make_board()]),
        DeviceBus.open("virtual", channel) as bus,
        NetCanOemForceTorque(bus, calibration_slot=SLOT) as sensor,
    ):
        began = bus.clock.time()
        for seconds in (0.0, forward, 0.0):
            set_clock(seconds)
            while (sample := sensor.read(20.0)).time < bus.clock.time() - 10.0 or sample.time > bus.clock.time() + 10.0:
                pass  # frames that were stamped just before and handed on just after
            samples = [sensor.read(20.0) for _ in range(20)]
            assert all(is_right(sample) and sample.status == "ok" for sample in samples)
            times = [sample.time for sample in samples]
            assert times == sorted(times)
            assert began <= times[0]
            assert times[-1] <= bus.clock.time()
            found, age, _ = sensor.observe(max_age=10.0)
            assert found is not None
            assert abs(age) < 10.0


@pytest.mark.parametrize(
    ("stamp", "error"),
    [
        (lambda time, count: time + 3600.0, 3600.0),
        (lambda time, count: time + 0.04, 0.04),
        (lambda time, count: time - 0.2, -0.2),
        (lambda time, count: time + 3600.0 * (count % 50 == 0), 0.0),  # now and then
        (lambda time, count: math.inf, 0.0),
    ],
)
def test_devices_go_on_by_the_clock_of_their_bus_whatever_stamps_say(
    stamp: Callable[[float, int], float], error: float
) -> None:
    """Stamps count for a sample's age alone."""
    board, simulated = make_board(), make_hand()
    with (
        virtual_bus(board, simulated) as bus,
        NetCanOemForceTorque(bus, calibration_slot=SLOT) as sensor,
        BarrettHand(bus) as hand,
    ):
        recv, count = bus._line.bus.recv, itertools.count()

        def stamped(timeout):
            frame = recv(timeout)
            if frame is not None:
                frame.timestamp = stamp(frame.timestamp, next(count))
            return frame

        bus._line.bus.recv = stamped
        run(bus, 1.0)
        samples = unread(sensor)
        assert len(samples) > 185
        assert len(unread(hand)) > 30
        assert all(is_right(sample) for sample in samples)
        ages = [sensor.observe(math.inf)[1] for _ in range(10) if run(bus, 0.01) is None]
        assert np.median(ages) == pytest.approx(-error, abs=0.01)
        assert (sensor.observe(0.02)[0] is not None) == (error == 0.0)


def test_waiting_for_a_frame_does_not_look_at_the_clock_of_day(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail() -> float:
        raise AssertionError("python-can's wait would last as long as the clock was set back")

    with (
        can.Bus(interface="virtual", channel="waiting") as bus,
        can.Bus(interface="virtual", channel="waiting") as other,
    ):
        monkeypatch.setattr("can.bus.time", fail)
        assert receive(bus, 0.01) is None
        other.send(can.Message(arbitration_id=7, is_extended_id=False))
        frame = receive(bus, 1.0)
        assert frame is not None
        assert frame.arbitration_id == 7
        bus.set_filters([{"can_id": 8, "can_mask": 0x7FF}])
        other.send(can.Message(arbitration_id=7, is_extended_id=False))
        assert receive(bus, 1.0) is None
