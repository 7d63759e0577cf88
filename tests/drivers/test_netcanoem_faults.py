import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactopose_drake.drivers.netcanoem import NetCanOemForceTorque
from tactopose_drake.drivers.netcanoem_protocol import StatusBit
from tactopose_drake.drivers.simulation import faults
from tactopose_drake.drivers.simulation.simulated_netcanoem import SimulatedNetCanOem, nano17_like_calibration
from tactopose_drake.errors import DeviceTimeoutError
from tests.drivers.rigs import (
    CALIBRATIONS,
    SLOT,
    WRENCH,
    is_right,
    make_board,
    run,
    unread,
    virtual_bus,
)

# Each fault, the state that it ends in, and whether samples stay valid meanwhile.
FAULTS = [
    (faults.silence, "no reply to the request for its", False),
    (faults.missing_frame, "no reply to the request for its", False),
    (faults.out_of_order, "no reply to the request for its", False),
    (faults.extra_frames, "bad reply: reply to sample: part 0 came twice", False),
    (faults.bus_off, "bus is off", False),
    (faults.wrong_length(4), "bad reply: first half of a sample must have 8 bytes, not 4", False),
    (faults.wrong_length(0), "no reply to the request for its", False),
    (faults.late(0.15), "no reply to the request for its", False),
    (faults.late(0.05), "ok", True),
    (faults.duplicates, "ok", True),
    (faults.own_frame_echo, "ok", True),
    (faults.error_frames, "ok", True),
]
NAMES = [getattr(fault, "__name__", "") + f"-{status[:12]}" for fault, status, _ in FAULTS]


@pytest.mark.parametrize(("fault", "status", "valid"), FAULTS, ids=NAMES)
def test_a_fault_has_its_status_gives_no_wrong_number_and_passes(fault, status: str, valid: bool) -> None:
    board = make_board()
    with virtual_bus(board) as bus, NetCanOemForceTorque(bus, calibration_slot=SLOT) as sensor:
        assert is_right(sensor.read())
        board.faults = [fault]
        run(bus, 0.01)  # what was on its way
        unread(sensor)
        run(bus, 2.0)
        assert sensor.status.startswith(status)
        assert not sensor.status.endswith(".")
        samples = unread(sensor)
        good = [sample for sample in samples if np.isfinite(sample.F_S).any()]
        assert all(is_right(sample) for sample in good)
        assert bool(good) == valid
        board.faults = []
        run(bus, 1.5)
        assert sensor.status == "ok"
        unread(sensor)
        assert is_right(sensor.read(0.1))


def test_an_answer_that_is_contradicted_is_not_believed() -> None:
    board = make_board()
    board.faults = [faults.extra_frames]
    with virtual_bus(board) as bus, NetCanOemForceTorque(bus, calibration_slot=SLOT) as sensor:
        run(bus, 3.0)
        assert unread(sensor) == []
        assert "came twice, with different data" in sensor.status
        with pytest.raises(DeviceTimeoutError, match=r"came twice, with different data\.$"):
            sensor.read(0.1)


@pytest.mark.parametrize("opcode", [2, 6, 7, 8, 15])
def test_each_answer_of_the_greeting_may_be_contradicted(opcode: int) -> None:
    board = make_board()

    def contradict(request, replies):
        return faults.extra_frames(request, replies) if request.arbitration_id & 0xF == opcode else replies

    board.faults = [contradict]
    with virtual_bus(board) as bus, NetCanOemForceTorque(bus, calibration_slot=SLOT) as sensor:
        run(bus, 1.0)
        assert unread(sensor) == []
        board.faults = []
        assert is_right(sensor.read(2.0))


@pytest.mark.parametrize("delays", [(0.0, 0.001), (0.001, 0.0)], ids=["it answers later", "it answers first"])
def test_a_second_board_of_the_same_identifiers_that_is_plugged_in_is_noticed(delays: tuple[float, float]) -> None:
    board = make_board()
    other = SimulatedNetCanOem(lambda time: -WRENCH, {SLOT: nano17_like_calibration(np.random.default_rng(9))}, 0x20)
    other.faults = [faults.silence]
    with virtual_bus(board, other) as bus, NetCanOemForceTorque(bus, calibration_slot=SLOT) as sensor:
        run(bus, 0.5)
        assert all(is_right(sample) for sample in unread(sensor))
        board.faults, other.faults = ([faults.late(delay)] for delay in delays)
        run(bus, 0.5)
        assert len(unread(sensor)) <= 1
        assert sensor.status.endswith("came twice, with different data")


@pytest.mark.parametrize("fault", [faults.own_frame_echo, faults.duplicates, faults.error_frames])
def test_faults_that_do_no_harm_do_none_from_the_start(fault) -> None:
    board = make_board()
    board.faults = [fault]
    with virtual_bus(board) as bus, NetCanOemForceTorque(bus, calibration_slot=SLOT) as sensor:
        assert is_right(sensor.read())
        assert board.active == SLOT


def test_an_echo_alone_is_not_taken_for_the_activation_of_a_calibration() -> None:
    board = make_board()

    def echo_and_lose_the_activation(request, replies):
        lost = request.arbitration_id & 0xF == 6
        return faults.own_frame_echo(request, [] if lost else replies)

    board.faults = [echo_and_lose_the_activation]
    refused = pytest.raises(DeviceTimeoutError, match="no reply to the request for its calibration")
    with virtual_bus(board) as bus, NetCanOemForceTorque(bus, calibration_slot=SLOT) as sensor, refused:
        sensor.read()


def test_another_calibration_than_was_asked_for_is_refused() -> None:
    board = make_board()

    def other_slot(request, replies):
        if request.arbitration_id & 0xF == 6:
            replies[0].frame.data[0] = 0
        return replies

    board.faults = [other_slot]
    refused = pytest.raises(DeviceTimeoutError, match=f"activated calibration 0 instead of {SLOT}")
    with virtual_bus(board) as bus, NetCanOemForceTorque(bus, calibration_slot=SLOT) as sensor, refused:
        sensor.read()


@pytest.mark.parametrize(
    ("word", "status", "valid"),
    [
        (StatusBit.SUPPLY_LOW | StatusBit.TEMPERATURE_HIGH, "error: supply low, temperature high", False),
        (StatusBit(1 << 9), "error: status bit 9", False),
        (StatusBit.WATCHDOG_RESET, "ok (watchdog reset)", True),
    ],
)
def test_status_bits_are_stated_and_critical_ones_reject_the_data(word: StatusBit, status: str, valid: bool) -> None:
    board = make_board()
    with virtual_bus(board) as bus, NetCanOemForceTorque(bus, calibration_slot=SLOT) as sensor:
        board.status = word
        sample = sensor.read()
        assert sample.status == status
        assert is_right(sample) if valid else np.isnan(sample.F_S).all()
        board.status = StatusBit(0)
        assert is_right(sensor.read())


def test_a_reset_between_two_polls_is_seen_by_its_status_bit_and_gives_no_wrong_number() -> None:
    board = make_board()
    with virtual_bus(board) as bus, NetCanOemForceTorque(bus, calibration_slot=SLOT) as sensor:
        sensor.read()
        board.active, board.status = 0, StatusBit.WATCHDOG_RESET
        run(bus, 1.0)
        assert board.active == SLOT
        assert sensor.status == "ok (watchdog reset)"
        samples = unread(sensor)
        assert len(samples) > 100
        assert all(is_right(sample) for sample in samples)


@pytest.mark.parametrize("reading", [-32768, 32767])
def test_a_gauge_at_its_end_rejects_the_data(reading: int) -> None:
    board = make_board()
    with virtual_bus(board) as bus, NetCanOemForceTorque(bus, calibration_slot=SLOT) as sensor:
        board.broken_gauges = {1: reading, 4: reading}
        sample = sensor.read()
        assert sample.status == "saturated: gauge 1, 4"
        assert np.isnan(sample.F_S).all()
        assert sample.gauges[4] == reading


@pytest.mark.parametrize("overload", [60.0, math.nan])
def test_an_overload_saturates(overload: float) -> None:
    board = SimulatedNetCanOem(lambda time: overload * WRENCH, CALIBRATIONS)
    with virtual_bus(board) as bus, NetCanOemForceTorque(bus, calibration_slot=SLOT) as sensor:
        sample = sensor.read()
        assert sample.status.startswith("saturated: gauge")
        assert np.isnan(sample.F_S).all()


@settings(max_examples=10)
@given(st.floats(0.0, 0.4), st.floats(0.02, 0.4))
def test_a_reboot_never_shows_as_a_wrong_number(wait: float, duration: float) -> None:
    board = make_board()
    with virtual_bus(board) as bus, NetCanOemForceTorque(bus, calibration_slot=SLOT) as sensor:
        sensor.read()
        run(bus, wait)
        board.reboot(duration)
        run(bus, 3.0)
        assert board.active == SLOT
        assert sensor.status == "ok"
        assert all(is_right(sample) for sample in unread(sensor))


@settings(max_examples=10)
@given(st.integers(0, 2**32 - 1))
def test_faults_at_random_never_show_as_a_wrong_number(seed: int) -> None:
    generator = np.random.default_rng(seed)
    board = make_board()
    harm = [faults.silence, faults.missing_frame, faults.out_of_order, faults.duplicates, faults.extra_frames]
    harm += [faults.own_frame_echo, faults.error_frames, faults.wrong_length(3), faults.late(0.02), faults.bus_off]
    board.faults = [faults.sometimes(fault, 0.01, generator) for fault in harm]
    with virtual_bus(board) as bus, NetCanOemForceTorque(bus, calibration_slot=SLOT) as sensor:
        run(bus, 30.0)  # To start, all of some ten replies must come unharmed: one board in 200 takes more than 5 s.
        good = [sample for sample in unread(sensor) if np.isfinite(sample.F_S).any()]
        assert good
        assert all(is_right(sample) for sample in good)
        board.faults = []
        run(bus, 1.5)
        assert sensor.status == "ok"
