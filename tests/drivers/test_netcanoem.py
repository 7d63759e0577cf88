import numpy as np
import pytest

from tactopose_drake.drivers.netcanoem import BoardCalibration, NetCanOemForceTorque
from tactopose_drake.drivers.netcanoem_protocol import Firmware, ForceUnit, TorqueUnit
from tactopose_drake.drivers.simulation import faults
from tactopose_drake.drivers.simulation.simulated_netcanoem import SimulatedNetCanOem
from tactopose_drake.errors import DeviceError, DeviceTimeoutError, InvalidInputError
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
        for samples, shown in ((0, "0"), (2.5, "2.5"), ("x", "'x'"), (None, "None"), (True, "True")):
            with pytest.raises(InvalidInputError, match=f"samples must be an integer >= 1, not {shown}"):
                sensor.tare(samples)
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
        refused = pytest.raises(DeviceTimeoutError, match=r"firmware 3\.6 does not report its units")
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
    "arguments",
    [
        {"base": 128},
        {"base": -1},
        {"base": 2.5},
        {"base": "x"},
        {"calibration_slot": 16},
        {"calibration_slot": 1.5},
        {"period": 0.0},
        {"timeout": np.nan},
    ],
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
    refused = pytest.raises(InvalidInputError, match=r"index must have other identifiers than thumb .* 0x2")
    with virtual_bus(make_board()) as bus, NetCanOemForceTorque(bus, name="thumb") as thumb:
        with refused, NetCanOemForceTorque(bus, name="index"):
            pass
        assert thumb.read().status == "ok"
