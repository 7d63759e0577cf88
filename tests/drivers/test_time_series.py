from pathlib import Path

import numpy as np
import pytest

from tactopose_drake.drivers.netcanoem import NetCanOemForceTorque
from tactopose_drake.drivers.simulation.simulated_barrett_hand import HandState
from tactopose_drake.drivers.simulation.simulated_netcanoem import SimulatedNetCanOem
from tactopose_drake.drivers.simulation.time_series import load_time_series
from tactopose_drake.errors import InvalidFileError
from tests.drivers.rigs import CALIBRATIONS, SLOT, START, WRENCH, WRENCH_TOLERANCE, run, unread, virtual_bus


def write(path: Path, rows: np.ndarray) -> Path:
    np.savetxt(path, rows, delimiter=",", header="time,m_x,m_y,m_z,f_x,f_y,f_z", comments="")
    return path


def test_a_row_holds_until_the_next(tmp_path: Path) -> None:
    rows = np.arange(21.0).reshape(3, 7)
    rows[:, 0] = [0.0, 1.0, 3.0]
    series = load_time_series(write(tmp_path / "wrench.csv", rows), 6, start=10.0)
    for time, row in ((-5.0, 0), (10.0, 0), (10.999, 0), (11.0, 1), (12.9, 1), (13.0, 2), (99.0, 2)):
        np.testing.assert_array_equal(series(time), rows[row, 1:])


def test_a_board_can_be_fed_from_a_file(tmp_path: Path) -> None:
    rows = np.array([[0.0, *WRENCH], [0.5, *(-WRENCH)]])
    series = load_time_series(write(tmp_path / "wrench.csv", rows), 6, start=START)
    board = SimulatedNetCanOem(series, CALIBRATIONS)
    with virtual_bus(board) as bus, NetCanOemForceTorque(bus, calibration_slot=SLOT) as sensor:
        run(bus, 1.0)
        for sample in unread(sensor):
            # The load is measured before the answer is sent.
            if abs(sample.time - START - 0.5) > 0.002:
                sign = 1.0 if sample.time - START < 0.5 else -1.0
                assert np.all(np.abs(sample.F_S - sign * WRENCH) < WRENCH_TOLERANCE)


def test_a_row_of_a_hand() -> None:
    state = HandState.from_row(np.arange(106.0))
    np.testing.assert_array_equal(state.joint_positions, np.arange(7))
    np.testing.assert_array_equal(state.pressures[3], np.arange(79, 103))
    np.testing.assert_array_equal(state.fingertip_torques, [103, 104, 105])


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        (np.zeros((2, 7)), "row 3: time must rise, not be 0 after 0"),
        (np.array([[1.0] * 7, [0.0] * 7]), "row 3: time must rise, not be 0 after 1"),
        (np.array([[1.7e9] * 7, [1.7e9 - 0.25] * 7]), "row 3: time must rise, not be 1699999999.75 after 1700000000"),
        (np.zeros((1, 6)), "row 2 must have 7 columns, not 6"),
        (np.full((1, 7), np.nan), "row 2: time must be a finite number, not 'nan'"),
        (np.zeros((0, 7)), "must have at least one row below its header, not none"),
    ],
)
def test_bad_files_are_one_clear_error(tmp_path: Path, rows: np.ndarray, message: str) -> None:
    path = write(tmp_path / "wrench.csv", rows)
    with pytest.raises(InvalidFileError, match=rf"wrench\.csv:? {message}"):
        load_time_series(path, 6)


def test_a_file_without_a_header_does_not_lose_its_first_row(tmp_path: Path) -> None:
    (tmp_path / "load.csv").write_text("0.0, 0, 0, 0, 0, 0, 1.0\n0.5, 0, 0, 0, 0, 0, 2.0\n")
    with pytest.raises(InvalidFileError, match=r"load\.csv: row 1 must be a header, .*, not numbers"):
        load_time_series(tmp_path / "load.csv", 6)


@pytest.mark.parametrize("cell", ["1_0", "\N{ARABIC-INDIC DIGIT ONE}", "1e1_0"])
def test_what_only_python_takes_for_a_number_is_refused(tmp_path: Path, cell: str) -> None:
    (tmp_path / "load.csv").write_text(f"time, f_x\n0.0, {cell}\n", encoding="utf-8")
    with pytest.raises(InvalidFileError, match=rf"load\.csv: row 2: f_x must be a finite number, not '{cell}'"):
        load_time_series(tmp_path / "load.csv", 1)


def test_cells_may_be_in_quotes(tmp_path: Path) -> None:
    (tmp_path / "load.csv").write_text('"time, s", "f_x"\n"0.0","1.5"\n0.5, "2"\n')
    series = load_time_series(tmp_path / "load.csv", 1)
    assert [series(time) for time in (0.1, 0.6)] == [1.5, 2.0]
    (tmp_path / "load.csv").write_text('time, f_x\n0.0, "1.5, 2.0"\n')
    with pytest.raises(InvalidFileError, match=r"load\.csv: row 2: f_x must be a finite number, not '1.5, 2.0'"):
        load_time_series(tmp_path / "load.csv", 1)
    (tmp_path / "load.csv").write_text(f"time, f_x\n0.0, {'1' * 200_000}\n")
    with pytest.raises(InvalidFileError, match=r"load\.csv cannot be read \(field larger"):
        load_time_series(tmp_path / "load.csv", 1)


def test_missing_files_are_one_clear_error(tmp_path: Path) -> None:
    with pytest.raises(InvalidFileError, match="nowhere"):
        load_time_series(tmp_path / "nowhere.csv", 6)


def test_a_file_of_other_columns_is_one_clear_error(tmp_path: Path) -> None:
    (tmp_path / "load.csv").write_text("time, f_x, f_y, f_z\n0.0, 1, 2, 3\n")
    with pytest.raises(InvalidFileError, match=r"load\.csv: row 2 must have 7 columns, not 4"):
        load_time_series(tmp_path / "load.csv", 6)
    (tmp_path / "load.csv").write_text("time and wrench\n0.0, 1, 2, 3, 4, x, 6\n")
    with pytest.raises(InvalidFileError, match=r"load\.csv: row 2: column 6 must be a finite number, not 'x'"):
        load_time_series(tmp_path / "load.csv", 6)
