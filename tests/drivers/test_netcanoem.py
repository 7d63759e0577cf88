import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactopose_drake.drivers.netcanoem import BoardCalibration, ForceTorqueSample, NetCanOemForceTorque
from tactopose_drake.drivers.netcanoem_protocol import Firmware, ForceUnit, StatusBit, TorqueUnit
from tactopose_drake.drivers.simulation import faults
from tactopose_drake.drivers.simulation.simulated_netcanoem import SimulatedNetCanOem
from tactopose_drake.errors import DeviceError, DeviceTimeoutError, InvalidInputError
from tests.drivers.rigs import CALIBRATIONS, SLOT, WRENCH, WRENCH_TOLERANCE, make_board, run, unread, virtual_bus


def is_right(sample: ForceTorqueSample) -> bool:
    return bool(np.all(np.abs(sample.F_S - WRENCH) < WRENCH_TOLERANCE))


def test_reads_the_wrench_in_si_units_about_the_sensor() -> None:
    with virtual_bus(make_board()) as bus, NetCanOemForceTorque(bus, calibration_slot=SLOT) as sensor:
        sample = sensor.read()
    assert sample.status == "ok"
    assert is_right(sample)


def test_a_known_calibration() -> None:
    # One gauge an axis, 1 lbf and 1 lbf-in for 10 readings; force rows come first on the board, last in a wrench.
    calibration = BoardCalibration(100.0 * np.eye(6), 1000, 1000, ForceUnit.POUND, TorqueUnit.POUND_INCH)
    wrench = calibration.wrench_matrix() @ np.array([10, 0, 0, 0, 0, 20])
    np.testing.assert_allclose(wrench, [0, 0, 2 * 0.1129848, 4.4482216, 0, 0], rtol=1e-6)


def test_samples_come_once_a_period_with_the_time_of_their_last_frame() -> None:
    with virtual_bus(make_board()) as bus, NetCanOemForceTorque(bus, calibration_slot=SLOT, period=0.004) as sensor:
        sensor.read()
        times = [sensor.read().time for _ in range(5)]
        assert bus.clock.time() == times[-1]
    np.testing.assert_allclose(np.diff(times), 0.004, atol=1e-6)


def test_the_bias_is_taken_off_here() -> None:
    offset = [500, -300, 20, 0, 900, -1000]
    with virtual_bus(make_board(offset=offset)) as bus, NetCanOemForceTorque(bus, calibration_slot=SLOT) as sensor:
        assert not is_right(sensor.read())
        sensor.bias = offset
        assert is_right(sensor.read())


def test_a_tare_makes_the_present_load_the_zero() -> None:
    load = [np.zeros(6)]
    board = SimulatedNetCanOem(lambda time: load[0], CALIBRATIONS, offset=[700, -20, 3, 40, 0, 5])
    with virtual_bus(board) as bus, NetCanOemForceTorque(bus, calibration_slot=SLOT) as sensor:
        sensor.read()
        load[0] = np.array([0.001, 0, 0, 0, 0, 2.0])
        sensor.tare(samples=4)
        np.testing.assert_allclose(sensor.read().F_S, np.zeros(6), atol=1e-9)
        load[0] = load[0] + WRENCH
        assert is_right(sensor.read())


def test_a_tare_needs_valid_samples() -> None:
    board = make_board()
    with virtual_bus(board) as bus, NetCanOemForceTorque(bus, calibration_slot=SLOT) as sensor:
        board.broken_gauges = {2: 32767}
        with pytest.raises(DeviceError, match="saturated: gauge 2"):
            sensor.tare()
        board.broken_gauges = {}
        board.faults = [faults.silence]
        with pytest.raises(DeviceTimeoutError, match="no reply"):
            sensor.tare(timeout=0.5)
        with pytest.raises(InvalidInputError, match="samples: is 0"):
            sensor.tare(samples=0)
    np.testing.assert_array_equal(sensor.bias, np.zeros(6))


@pytest.mark.parametrize("force", ForceUnit)
@pytest.mark.parametrize("torque", TorqueUnit)
def test_units_and_counts_are_the_boards_own(force: ForceUnit, torque: TorqueUnit) -> None:
    # The same transducer, calibrated in other units.
    nano = CALIBRATIONS[SLOT]
    scale = np.r_[[2500 / nano.counts_per_force / force.newtons] * 3, [40e-3 / nano.counts_per_torque] * 3]
    scale[3:] /= torque.newton_meters
    matrix = (scale[:, None] * nano.matrix).astype(np.float32).astype(np.float64)
    other = BoardCalibration(matrix, 2500, 40, force, torque)
    np.testing.assert_allclose(other.wrench_matrix(), nano.wrench_matrix(), rtol=1e-6)
    board = SimulatedNetCanOem(lambda time: WRENCH, {SLOT: other})
    with virtual_bus(board) as bus, NetCanOemForceTorque(bus, calibration_slot=SLOT) as sensor:
        assert is_right(sensor.read())
        assert sensor.calibration is not None
        assert (sensor.calibration.counts_per_force, sensor.calibration.force_unit) == (2500, force)


def test_old_firmware_needs_to_be_told_its_units() -> None:
    board = make_board(firmware=Firmware(3, 6, 9))
    with virtual_bus(board) as bus:
        refused = pytest.raises(DeviceTimeoutError, match=r"firmware 3\.6 does not tell its units")
        with NetCanOemForceTorque(bus, calibration_slot=SLOT) as sensor, refused:
            sensor.read()
        units = ForceUnit.NEWTON, TorqueUnit.NEWTON_MILLIMETER
        with NetCanOemForceTorque(bus, calibration_slot=SLOT, units=units) as sensor:
            assert is_right(sensor.read())


def test_an_empty_calibration_is_refused() -> None:
    refused = pytest.raises(DeviceTimeoutError, match="calibration 5 is empty")
    with virtual_bus(make_board()) as bus, NetCanOemForceTorque(bus, calibration_slot=5) as sensor, refused:
        sensor.read()


@pytest.mark.parametrize(
    "arguments", [{"base": 128}, {"base": -1}, {"calibration_slot": 16}, {"period": 0.0}, {"timeout": np.nan}]
)
def test_arguments_out_of_range_are_refused(arguments: dict) -> None:
    with virtual_bus() as bus, pytest.raises(InvalidInputError, match=next(iter(arguments))):
        NetCanOemForceTorque(bus, **arguments)


def test_several_boards_share_a_bus() -> None:
    boards = [make_board(base) for base in range(0x20, 0x25)]
    with virtual_bus(*boards) as bus:
        sensors = [NetCanOemForceTorque(bus, base, calibration_slot=SLOT) for base in range(0x20, 0x25)]
        for sensor in sensors:
            sensor.__enter__()
        boards[2].faults = [faults.silence]
        run(bus, 1.0)
        for k, sensor in enumerate(sensors):
            samples = unread(sensor)
            assert (len(samples) > 150) == (k != 2)
            assert all(is_right(sample) for sample in samples)


def test_a_second_driver_of_the_same_board_is_refused() -> None:
    refused = pytest.raises(InvalidInputError, match=r"index: has the identifier 0x2.*thumb")
    with virtual_bus(make_board()) as bus, NetCanOemForceTorque(bus, name="thumb") as thumb:
        with refused, NetCanOemForceTorque(bus, name="index"):
            pass
        assert thumb.read().status == "ok"


# Each fault, the state that it ends in, and whether samples stay valid meanwhile.
FAULTS = [
    (faults.silence, "no reply to the request for its", False),
    (faults.missing_frame, "no reply to the request for its", False),
    (faults.out_of_order, "no reply to the request for its", False),
    (faults.extra_frames, "bad reply: reply to sample: part 0 came twice", False),
    (faults.bus_off, "bus: is off", False),
    (faults.wrong_length(4), "bad reply: first half of a sample: has 4 bytes", False),
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


@pytest.mark.parametrize("reading", [-32768, 32767])
def test_a_gauge_at_its_end_rejects_the_data(reading: int) -> None:
    board = make_board()
    with virtual_bus(board) as bus, NetCanOemForceTorque(bus, calibration_slot=SLOT) as sensor:
        board.broken_gauges = {1: reading, 4: reading}
        sample = sensor.read()
        assert sample.status == "saturated: gauge 1, 4"
        assert np.isnan(sample.F_S).all()
        assert sample.gauges[4] == reading


def test_an_overload_saturates() -> None:
    board = SimulatedNetCanOem(lambda time: 60 * WRENCH, CALIBRATIONS)
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
        run(bus, 5.0)
        good = [sample for sample in unread(sensor) if np.isfinite(sample.F_S).any()]
        assert good
        assert all(is_right(sample) for sample in good)
        board.faults = []
        run(bus, 1.5)
        assert sensor.status == "ok"
