"""Pads of rubber: the pressure that a layer of constant volume passes on, and what cells make of it."""

import numpy as np
import pytest

from tactopose_drake.core.sensing.rubber_layer import (
    RubberLayer,
    cell_response,
    confined_pressure,
    find_neighbours,
)
from tactopose_drake.core.sensing.tactile_layout import TactileLayout
from tactopose_drake.core.sensing.tactile_patterns import CellRow, RowPattern
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.hand.tactile_pads import load_tactile_pad


def square_pad(count: int, cell: float = 0.001) -> TactileLayout:
    places = cell * (np.arange(count) - 0.5 * (count - 1))
    rows = [CellRow(center=[float(x), 0.0, 0.0], count=count, cell=[cell, cell]) for x in places]
    return RowPattern(pitch=cell, rows=rows).make()


def test_springs_share_nothing() -> None:
    pressure = np.random.default_rng(0).uniform(0.0, 1e4, 16)
    np.testing.assert_array_equal(confined_pressure(pressure, find_neighbours(square_pad(4)), 0.0), pressure)


def test_the_force_stays_and_what_is_not_touched_feels_nothing() -> None:
    layout = load_tactile_pad("bh280_finger").layout
    pressure = np.random.default_rng(1).uniform(1e3, 1e4, 24) * (np.arange(24) < 15)
    pressure[14] = 0.01 * pressure.max()  # hardly covered
    found = confined_pressure(pressure, find_neighbours(layout), 0.02)
    assert layout.areas @ found == pytest.approx(layout.areas @ pressure)
    assert np.all((found > 0.0) == (pressure > 0.0))
    assert found[14] == pressure[14]
    assert np.all(found[:14] != pressure[:14])
    np.testing.assert_array_equal(confined_pressure(np.zeros(24), find_neighbours(layout), 0.02), 0.0)


def test_a_flat_thing_on_rubber_that_keeps_its_volume_is_poissons_dome() -> None:
    """-laplace u = 1 on a square of side 1, u = 0 around it: the middle is 0.073671, the mean 0.035144."""
    found = confined_pressure(np.full(25 * 25, 1e4), find_neighbours(square_pad(25)), 10.0)
    assert found.max() / found.mean() == pytest.approx(0.073671 / 0.035144, rel=0.01)
    assert found.argmax() == 25 * 25 // 2


def test_between_springs_and_a_dome_pressure_falls_off_over_the_confinement() -> None:
    """Far from the corners of a wide contact the pressure rises from its edge as 1 - exp(-x / l)."""
    layout, confinement = square_pad(31), 0.003
    found = confined_pressure(np.full(31 * 31, 1e4), find_neighbours(layout), confinement).reshape(31, 31)
    x = 0.001 * (np.arange(15) + 0.5)
    np.testing.assert_allclose(found[15, :15] / found[15, 15], 1.0 - np.exp(-x / confinement), atol=0.02)


def test_a_pressure_that_rubber_only_scales_stays_as_it_is() -> None:
    """A sine over the contact, the laplacian's own: every cell gives the same share, and the force is what it was."""
    count, places = 40, 0.001 * (np.arange(40) + 0.5)
    pressure = 1e4 * np.outer(*[np.sin(np.pi * places / 0.04)] * 2).ravel()
    pressure = np.maximum(pressure, 0.03 * pressure.max())  # hardly changed, and touched up to the pad's edge
    found = confined_pressure(pressure, find_neighbours(square_pad(count)), 0.01)
    np.testing.assert_allclose(found, pressure, atol=0.04 * pressure.max())


def test_what_is_pressed_more_flows_to_what_is_pressed_less() -> None:
    """Two cells of 1 x 2 mm beside one another, a gap between them, by hand: p A + l^2 (flow to all sides) = p_w A."""
    rows = [CellRow(center=[x, 0.0, 0.0], count=1, cell=[0.001, 0.002]) for x in (0.0, 0.0012)]
    neighbours = find_neighbours(RowPattern(rows=rows).make())
    np.testing.assert_allclose(neighbours.conductance, 0.002 / 0.0012 * (1.0 - np.eye(2)))
    springs, l_squared, area = np.array([3e4, 1e4]), 0.002**2, 2e-6
    to_outside = 0.002 / 0.0005 + 2.0 * 0.001 / 0.001  # half a cell to each edge
    across = 0.002 / 0.0012
    flow = (to_outside + across) * np.eye(2) - across * (1.0 - np.eye(2))
    confined = np.linalg.solve(area * np.eye(2) + l_squared * flow, area * springs)
    found = confined_pressure(springs, neighbours, 0.002)
    np.testing.assert_allclose(found, confined * springs.sum() / confined.sum(), rtol=1e-9)
    assert found[1] > springs[1]


def test_neighbours_lie_side_by_side_on_a_curved_array() -> None:
    neighbours = find_neighbours(load_tactile_pad("bh280_finger").layout)
    beside = np.sort(np.sum(neighbours.others >= 0, axis=1))
    # Of three cells in each of eight rows: four corners, ten on the sides and two on the ends, six within.
    np.testing.assert_array_equal(beside, [*[2] * 4, *[3] * 14, *[4] * 6])
    np.testing.assert_allclose(neighbours.conductance, neighbours.conductance.T)


def test_cells_read_less_in_proportion_and_more_on_the_way_back() -> None:
    rubber = RubberLayer(half_pressure=5e4, hysteresis=0.1)
    way = np.linspace(0.0, 4e4, 101)
    up, down = cell_response(way, way, rubber), cell_response(way, np.full(101, 4e4), rubber)
    assert cell_response(np.array([5e4]), np.array([5e4]), rubber)[0] == pytest.approx(2.5e4)
    assert np.all(np.diff(up) > 0.0)
    assert np.all(np.diff(down) > 0.0)
    assert down[0] == up[0] == 0.0
    assert down[-1] == up[-1]
    linear = RubberLayer(hysteresis=0.1)
    gap = cell_response(way, np.full(101, 4e4), linear) - cell_response(way, way, linear)
    assert gap.max() == pytest.approx(0.1 * 4e4, rel=1e-6)
    assert way[gap.argmax()] == pytest.approx(2e4)


@pytest.mark.parametrize(
    ("field", "value"), [("confinement", -1.0), ("half_pressure", 0.0), ("hysteresis", 0.3), ("hysteresis", -0.1)]
)
def test_numbers_out_of_range_are_named(field: str, value: float) -> None:
    with pytest.raises(InvalidInputError, match=f"RubberLayer.{field}"):
        RubberLayer(**{field: value}).validate()
