import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from tactopose_drake.core.poses import exp_so3
from tactopose_drake.core.sensing.tactile_array import (
    PressureField,
    TactileModel,
    forces_on_cells,
    mean_pressure,
    read_cells,
    spread_matrix,
)
from tactopose_drake.core.sensing.tactile_layout import TactileLayout
from tactopose_drake.core.sensing.tactile_patterns import CellRow, RowPattern
from tactopose_drake.errors import InvalidInputError

from .tactile_fields import field_around, fingertip, grid, polygon, refined, total_force

GRID, FINGERTIP = grid(), fingertip()
small = st.floats(-0.0009, 0.0009)
slopes = st.tuples(st.floats(-0.3, 0.3), st.floats(-0.3, 0.3)).map(np.array)


@given(x=small, y=small, slope=slopes)
def test_the_force_on_all_cells_is_that_of_the_field(x: float, y: float, slope: np.ndarray) -> None:
    field = polygon(np.array([x, y]), slope)
    np.testing.assert_allclose(forces_on_cells(GRID, [field]).sum(axis=0), total_force(field), rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("depth", [0.0, 0.0007, 0.003, -0.001])
def test_a_round_pad_feels_no_place_twice_and_misses_none(depth: float) -> None:
    field = field_around(FINGERTIP, depth)
    np.testing.assert_allclose(forces_on_cells(FINGERTIP, [field]).sum(axis=0), total_force(field), rtol=1e-9)


@given(x=small, y=small, slope=slopes)
def test_finer_faces_change_nothing(x: float, y: float, slope: np.ndarray) -> None:
    field = polygon(np.array([x, y]), slope)
    reading, again = (mean_pressure(GRID, [f]) for f in (field, refined(refined(field))))
    np.testing.assert_allclose(again, reading, rtol=1e-9, atol=1e-6)


@given(x=small, y=small, slope=slopes)
def test_a_move_by_one_cell_moves_the_reading_by_one_cell(x: float, y: float, slope: np.ndarray) -> None:
    field = polygon(np.array([x, y]), slope, radius=0.002)
    moved = dataclasses.replace(field, vertices=field.vertices + np.array([0.001, -0.001, 0.0]))
    reading, after = (mean_pressure(GRID, [f]).reshape(12, 8) for f in (field, moved))
    np.testing.assert_allclose(after[1:, 1:], reading[:-1, :-1], atol=1e-6)
    assert reading.max() > 1e3


def test_the_reading_does_not_depend_on_the_frame() -> None:
    R, p = exp_so3(np.array([0.4, -2.0, 0.9])), np.array([0.3, -0.1, 0.2])
    layout = TactileLayout(FINGERTIP.corners @ R.T + p, FINGERTIP.rays @ R.T)
    field = field_around(FINGERTIP, 0.0005)
    moved = dataclasses.replace(field, vertices=field.vertices @ R.T + p)
    np.testing.assert_allclose(mean_pressure(layout, [moved]), mean_pressure(FINGERTIP, [field]), rtol=1e-9)


def test_covered_cells_read_the_pressure_at_their_centres() -> None:
    corners = np.array([[-0.02, -0.02, 0.0], [0.02, -0.02, 0.0], [0.02, 0.02, 0.0], [-0.02, 0.02, 0.0]])
    slope = np.array([4e5, -7e5, 0.0])
    field = PressureField(corners, 5e4 + corners @ slope, np.array([4, 0, 1, 2, 3]))
    np.testing.assert_allclose(mean_pressure(GRID, [field]), 5e4 + GRID.p_TC @ slope, rtol=1e-12)


def test_a_cell_that_is_covered_in_part_reads_that_part() -> None:
    corners = np.array([[-0.02, -0.02, 0.0], [0.00525, -0.02, 0.0], [0.00525, 0.02, 0.0], [-0.02, 0.02, 0.0]])
    field = PressureField(corners, np.full(4, 3e4), np.array([4, 0, 1, 2, 3]))
    reading = mean_pressure(GRID, [field]).reshape(12, 8)
    np.testing.assert_allclose(reading[10], 3e4)  # its cells end at 5 mm
    np.testing.assert_allclose(reading[11], 0.25 * 3e4)


def test_contacts_add_up() -> None:
    fields = [polygon(np.array([x, 0.0]), np.zeros(2), radius=0.002) for x in (-0.002, 0.001)]
    apart = sum(mean_pressure(GRID, [field]) for field in fields)
    np.testing.assert_allclose(mean_pressure(GRID, fields), apart)


def test_what_turns_away_or_lies_beyond_is_not_felt() -> None:
    field = polygon(np.zeros(2), np.zeros(2))
    away = dataclasses.replace(field, faces=np.concatenate([[5], field.faces[:0:-1]]))
    assert not mean_pressure(GRID, [away]).any()
    assert not mean_pressure(GRID, [polygon(np.array([0.01, 0.0]), np.zeros(2))]).any()
    assert not mean_pressure(GRID, []).any()
    assert not mean_pressure(GRID, [PressureField.none()]).any()


@pytest.mark.parametrize("layout", [GRID, FINGERTIP], ids=["flat", "round"])
def test_a_soft_layer_shares_pressure_and_keeps_the_force(layout: TactileLayout) -> None:
    pressure = np.zeros(len(layout))
    pressure[len(layout) // 2] = 7e4
    shared = spread_matrix(layout, 0.0015) @ pressure
    assert shared @ layout.areas == pytest.approx(pressure @ layout.areas, rel=1e-12)
    assert np.argmax(shared) == len(layout) // 2
    away = np.linalg.norm(layout.p_TC - layout.p_TC[len(layout) // 2], axis=1)
    assert shared[away > 6 * 0.0015].max(initial=0.0) < 1e-3 * shared.max()
    assert shared[(away > 0) & (away < 0.003)].min() > 0.01 * shared.max()
    np.testing.assert_array_equal(spread_matrix(layout, 0.0) @ pressure, pressure)


def test_the_soft_layer_shares_between_large_cells_what_the_gaussian_carries_across_their_edge() -> None:
    layout, width, spread = grid(9, 1, cell=0.006), 0.006, 0.0015
    shared = spread_matrix(layout, spread)[:, 4]
    # By formula: the share of [-w/2, w/2] convolved with a Gaussian that lies in [w/2, 3w/2].
    steps = np.linspace(-0.5, 0.5, 2001) * width
    expected = np.mean(stats.norm.cdf((1.5 * width - steps) / spread) - stats.norm.cdf((0.5 * width - steps) / spread))
    np.testing.assert_allclose(shared[[3, 5]], expected, rtol=0.02)


@pytest.mark.parametrize("spread", [1e-12, 1e-5, 1e-4, 2.5e-4, 5e-4])
def test_a_layer_that_is_thin_against_a_cell_shares_as_little(spread: float) -> None:
    width = 0.004
    layout = RowPattern(pitch=width, rows=[CellRow(count=5, cell=[width, width])]).make()
    matrix = spread_matrix(layout, spread)
    np.testing.assert_allclose(matrix.sum(axis=0), 1.0)
    # What crosses an edge is the mean over the cell of the Gaussian's tail beyond it.
    assert matrix[1, 2] == pytest.approx(spread / math.sqrt(2.0 * math.pi) / width, abs=0.012)
    assert matrix[0, 2] == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("resolution", [70.0, 1000.0, 11e3, 99e3])
def test_a_saturated_cell_shows_the_range_however_coarse_the_steps_are(resolution: float) -> None:
    model = TactileModel(range=250e3, resolution=resolution)
    frame = read_cells(np.array([1e5, 250e3, 260e3, 9e9]), np.zeros(4), model)
    np.testing.assert_array_equal(frame.pressure[1:], 250e3)
    np.testing.assert_array_equal(frame.saturated, [False, True, True, True])


def test_noise_range_quantisation_and_dead_cells() -> None:
    model = TactileModel(range=1000.0, resolution=10.0, noise=3.0, dead_cells=[4])
    pressure = np.array([0.0, 104.9, 104.9, 5000.0, 500.0, 0.0])
    frame = read_cells(pressure, np.array([-1.0, 0.0, 0.1, 0.0, 0.0, 5.0]), model)
    np.testing.assert_allclose(frame.pressure, [0, 100, 110, 1000, np.nan, 20])
    np.testing.assert_array_equal(frame.saturated, [0, 0, 0, 1, 0, 0])
    assert frame.status == "saturated: 3"


def test_an_ideal_array_reads_the_pressure_and_says_whether_anything_touches() -> None:
    pressure = np.array([0.0, 1.234, 5e6])
    frame = read_cells(pressure, np.full(3, 2.0), TactileModel())
    np.testing.assert_array_equal(frame.pressure, pressure)
    assert frame.status == "ok"
    assert read_cells(np.zeros(3), np.zeros(3), TactileModel(dead_cells=[1])).status == "no contact"


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("range", 0.0, "TactileModel.range must be .*, not 0"),
        ("resolution", -1.0, "TactileModel.resolution must be .*, not -1"),
        ("noise", np.nan, "TactileModel.noise must be .*, not nan"),
        ("spread", -1e-3, "TactileModel.spread must be .*, not -0.001"),
        ("dead_cells", [3, 24], "dead_cells must be an integer from 0 to 23, not 24"),
        ("dead_cells", [-1], "dead_cells must be .*, not -1"),
    ],
)
def test_a_bad_parameter_is_named(field: str, value: object, message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        TactileModel(**{field: value}).validate(24)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"vertices": np.full((5, 3), np.nan)}, r"vertices\[0, 0\] must be .*, not nan"),
        ({"pressure": np.zeros(4)}, "pressure must have the shape .*"),
        ({"faces": np.array([5, 0, 1, 2, 3])}, "faces must be polygons of the 5 vertices"),
        ({"faces": np.array([3, 0, 1, 5])}, "faces must be polygons"),
        ({"faces": np.array([3, 0, 1, -1])}, "faces must be polygons"),
        ({"faces": np.array([2, 0, 1])}, "faces must be polygons"),
    ],
)
def test_a_broken_field_is_named(change: dict[str, np.ndarray], message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        dataclasses.replace(polygon(np.zeros(2), np.zeros(2)), **change)
