import math

import can
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactopose_drake.drivers.barrett_hand import BarrettHand
from tactopose_drake.drivers.clock import VirtualClock
from tactopose_drake.drivers.device_bus import DeviceBus
from tactopose_drake.drivers.frames import data_frame
from tactopose_drake.drivers.netcanoem import NetCanOemForceTorque
from tactopose_drake.drivers.simulation import faults
from tactopose_drake.drivers.simulation.virtual_time_bus import VirtualTimeBus, bits_of
from tactopose_drake.errors import BusError, DeviceTimeoutError, InvalidInputError, UnknownNameError
from tests.drivers.rigs import SLOT, START, make_board, make_hand, run, unread, virtual_bus


class Adapter:
    """Something that buses are opened on, and that can be pulled out."""

    def __init__(self, *devices) -> None:
        self.clock = VirtualClock(START)
        self.devices = devices
        self.attempts: list[float] = []
        self.plugged_in = True
        self._bus: VirtualTimeBus | None = None

    def open(self) -> VirtualTimeBus:
        self.attempts.append(self.clock.time())
        if not self.plugged_in:
            raise can.CanInitializationError("no such adapter")
        self._bus = VirtualTimeBus(self.devices, self.clock)
        return self._bus

    def unplug(self) -> None:
        self.plugged_in = False
        self._bus.unplugged = True

    def bus(self) -> DeviceBus:
        return DeviceBus(self.open, clock=self.clock, threaded=False)


def test_an_unknown_interface_is_named_with_those_that_exist() -> None:
    with pytest.raises(UnknownNameError, match=r"interface must be one of .*socketcan.*, not 'socketcam'"):
        DeviceBus.open("socketcam", "can0")


@pytest.mark.parametrize(("interface", "channel"), [("socketcan", "nothing0"), ("slcan", "/dev/nothing0")])
def test_a_bus_that_cannot_be_opened_is_one_clear_error(interface: str, channel: str) -> None:
    with (
        pytest.raises(BusError, match=f"^bus '{channel}' of {interface} cannot be opened"),
        DeviceBus.open(interface, channel),
    ):
        pass


@pytest.mark.parametrize(
    ("error", "seen"),
    [
        (can.CanInitializationError("no"), BusError),
        (OSError("no"), BusError),
        (ValueError("no"), BusError),
        (TypeError("no"), BusError),
        (ImportError("no"), BusError),
        (NotImplementedError("no"), BusError),
        (RuntimeError("a fault of the program"), RuntimeError),
        (KeyError("a fault of the program"), KeyError),
    ],
)
def test_what_interfaces_raise_is_a_bus_error_and_other_faults_are_not_hidden(
    error: Exception, seen: type[Exception]
) -> None:
    def open_bus() -> can.BusABC:
        raise error

    with pytest.raises(seen, match=str(error.args[0])) as raised, DeviceBus(open_bus, threaded=False):
        pass
    assert type(raised.value) is seen


def test_an_adapter_that_is_pulled_out_is_opened_again_with_growing_pauses() -> None:
    adapter = Adapter(make_board())
    with adapter.bus() as bus, NetCanOemForceTorque(bus, calibration_slot=SLOT) as sensor:
        sensor.read()
        adapter.unplug()
        adapter.attempts.clear()
        run(bus, 10.0)
        assert sensor.status == "bus cannot be opened (no such adapter)"
        pauses = np.diff(adapter.attempts)
        assert np.all(np.diff(pauses) > -1e-6)
        assert pauses[0] == pytest.approx(0.2, abs=0.01)
        assert pauses[-1] == pytest.approx(2.0, abs=0.01)
        unread(sensor)
        with pytest.raises(DeviceTimeoutError, match="no such adapter"):
            sensor.read(0.1)
        adapter.plugged_in = True
        run(bus, 2.5)
        unread(sensor)
        assert sensor.read(0.1).status == "ok"


def test_a_failure_while_sending_is_noticed_too() -> None:
    adapter = Adapter(make_board())
    with adapter.bus() as bus, NetCanOemForceTorque(bus, calibration_slot=SLOT) as sensor:
        sensor.read()
        send = adapter._bus.send

        def fail(*_) -> None:
            adapter._bus.send = send
            raise can.CanOperationError("transmit buffer full")

        adapter._bus.send = fail
        run(bus, 0.05)
        assert sensor.status == "bus failed (transmit buffer full)"
        run(bus, 1.0)
        assert sensor.status == "ok"


def test_error_frames_are_counted_and_bus_off_is_a_state_until_a_frame_comes() -> None:
    board = make_board()
    with virtual_bus(board) as bus, NetCanOemForceTorque(bus, calibration_slot=SLOT) as sensor:
        board.faults = [faults.error_frames]
        sensor.read()
        assert bus.error_frames > 10
        assert bus.problem == ""
        board.faults = [faults.bus_off]
        run(bus, 0.1)
        assert "is off" in bus.problem
        board.faults = []
        run(bus, 1.0)
        assert bus.problem == ""


@pytest.mark.parametrize(
    "strange",
    [
        {"is_extended_id": True},
        {"is_remote_frame": True},
        {"is_fd": True},
        {"dlc": 3},
    ],
)
def test_frames_of_another_kind_are_not_taken_for_answers(strange: dict) -> None:
    board = make_board()

    def change(_, replies):
        return [
            faults.Reply(
                reply.delay,
                can.Message(
                    **{"arbitration_id": reply.frame.arbitration_id, "data": reply.frame.data, "is_extended_id": False}
                    | strange
                ),
            )
            for reply in replies
        ]

    board.faults = [change]
    with virtual_bus(board) as bus, NetCanOemForceTorque(bus, calibration_slot=SLOT) as sensor:
        run(bus, 1.0)
        assert unread(sensor) == []
        assert "no reply" in sensor.status


def test_stamps_that_do_not_count_from_the_epoch_become_the_hosts_time() -> None:
    board = make_board()
    with virtual_bus(board) as bus, NetCanOemForceTorque(bus, calibration_slot=SLOT) as sensor:
        recv = bus._line.bus.recv

        def stamped_by_the_adapter(timeout):
            frame = recv(timeout)
            if frame is not None:
                frame.timestamp -= START
            return frame

        bus._line.bus.recv = stamped_by_the_adapter
        assert sensor.read().time == bus.clock.time()


def test_an_error_in_the_thread_ends_every_wait() -> None:
    with DeviceBus.open("virtual", "broken") as bus, NetCanOemForceTorque(bus) as sensor:

        def fail(time: float) -> None:
            raise ZeroDivisionError("a mistake in a driver")

        sensor.poll = fail
        with pytest.raises(BusError, match="a mistake in a driver"):
            sensor.read(5.0)


@pytest.mark.parametrize("timeout", [math.nan, math.inf, -1.0, "x", None])
def test_a_wait_that_would_never_end_is_refused(timeout: object) -> None:
    with virtual_bus(make_board(), make_hand()) as bus:
        with NetCanOemForceTorque(bus, calibration_slot=SLOT) as sensor:
            for wait in (sensor.read, lambda timeout: sensor.tare(2, timeout)):
                with pytest.raises(InvalidInputError, match=r"^timeout must be a "):
                    wait(timeout)
        with BarrettHand(bus) as hand:
            hand.read()
            with pytest.raises(InvalidInputError, match=r"^timeout must be a "):
                hand.tare(timeout)


@pytest.mark.parametrize(("bitrate", "rate"), [(1e6, 200), (500e3, 200), (250e3, 164)])
def test_five_boards_share_what_the_bus_can_carry(bitrate: float, rate: float) -> None:
    boards = [make_board(base) for base in range(0x20, 0x25)]
    clock = VirtualClock(START)
    with DeviceBus(lambda: VirtualTimeBus(boards, clock, bitrate), clock=clock, threaded=False) as bus:
        sensors = [NetCanOemForceTorque(bus, base, calibration_slot=SLOT) for base in range(0x20, 0x25)]
        for sensor in sensors:
            bus.attach(sensor)
        run(bus, 0.5)
        for sensor in sensors:
            unread(sensor)
        run(bus, 2.0)
        assert [len(unread(sensor)) / 2 for sensor in sensors] == pytest.approx([rate] * 5, abs=1)


def test_frames_take_their_time_on_the_wire() -> None:
    assert bits_of(data_frame(1)) == 55  # 47, and 8 stuff bits at most
    assert bits_of(data_frame(1, bytes(8))) == 135


@settings(max_examples=15)
@given(
    st.lists(st.lists(st.tuples(st.integers(0, 2**11 - 1), st.binary(max_size=8)), max_size=6), min_size=1),
    st.booleans(),
)
def test_any_frames_at_any_time_break_nothing(noise: list[list[tuple[int, bytes]]], only_replies: bool) -> None:
    board, simulated = make_board(), make_hand()
    bursts = iter(noise)
    with (
        virtual_bus(board, simulated) as bus,
        NetCanOemForceTorque(bus, calibration_slot=SLOT) as sensor,
        BarrettHand(bus) as hand,
    ):
        replies = sorted(sensor.replies | hand.replies)

        def noisy(_, answer):
            burst = [(replies[k % len(replies)] if only_replies else k, data) for k, data in next(bursts, [])]
            return [faults.Reply(0.0, data_frame(k, data)) for k, data in burst] + answer

        board.faults = simulated.faults = [noisy]
        run(bus, 0.5)
        for sample in unread(sensor):
            assert np.isfinite(sample.F_S).all() == sample.status.startswith("ok")
        for sample in unread(hand):
            assert not np.any(np.abs(sample.joint_positions) > 2 * np.pi)
            assert not np.any(sample.pressures < 0)
        board.faults = simulated.faults = []
        run(bus, 3.5)
        assert (sensor.status, hand.status) == ("ok", "ok")


def test_the_thread_ends_before_the_bus_is_shut_down() -> None:
    with DeviceBus.open("virtual", "closing") as bus:
        thread, inner = bus._thread, bus._line.bus
        order = []
        shutdown = inner.shutdown
        inner.shutdown = lambda: (order.append(thread.is_alive()), shutdown())
        assert thread.is_alive()
    assert order == [False]
    with pytest.raises(can.CanOperationError, match="closed"):
        inner.recv(0)


def test_no_frame_of_a_burst_is_lost() -> None:
    received = []
    with DeviceBus(lambda: can.Bus(interface="virtual", channel="burst"), threaded=False) as bus:
        bus.listen(lambda frame: received.append(frame.arbitration_id))
        with can.Bus(interface="virtual", channel="burst") as other:
            for identifier in range(300):
                other.send(data_frame(identifier))
            for _ in range(10):
                bus.pump(0.0)
    assert received == list(range(300))
