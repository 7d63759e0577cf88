import numpy as np
import pytest

from tactopose_drake.core.poses import random_rotations
from tactopose_drake.core.sensing.long_cells import find_stretch
from tactopose_drake.hand.tactile_pads import load_tactile_pad

OUT = np.array([0.0, 0.0, 1.0])


def grid(pitch: tuple[float, float], count: tuple[int, int]) -> np.ndarray:
    return np.array([[pitch[0] * i, pitch[1] * j, 0.0] for i in range(count[0]) for j in range(count[1])])


@pytest.mark.parametrize("count", [(12, 2), (2, 2), (3, 8), (8, 8)])
@pytest.mark.parametrize("length", [0.0032, 0.006, 0.0078])
def test_long_cells_are_stretched_along_their_longer_side(count: tuple[int, int], length: float) -> None:
    R = random_rotations(np.random.default_rng(count), 1)[0]
    cells = grid((0.002, length), count)
    stretch = find_stretch(cells @ R.T, np.tile(R[:, 2], (len(cells), 1))) @ R
    assert 0.002 * np.hypot(1.0, np.linalg.norm(stretch)) == pytest.approx(length)
    np.testing.assert_allclose(np.abs(stretch) / np.linalg.norm(stretch), [0.0, 1.0, 0.0], atol=1e-9)


def test_it_is_the_usual_cell_that_counts() -> None:
    cells = np.concatenate([grid((0.002, 0.006), (12, 4)), [[0.035, 0.0, 0.0], [0.0, 0.034, 0.0]]])
    stretch = find_stretch(cells, np.tile(OUT, (len(cells), 1)))
    assert np.hypot(1.0, np.linalg.norm(stretch)) == pytest.approx(3.0)
    np.testing.assert_allclose(np.abs(stretch) / np.linalg.norm(stretch), [0.0, 1.0, 0.0], atol=0.02)


def test_long_cells_around_a_finger_are_stretched_along_it() -> None:
    angle = np.repeat(np.linspace(-1.0, 1.0, 9), 3)
    normals = np.stack([np.sin(angle), np.zeros(27), np.cos(angle)], axis=1)
    cells = 0.008 * normals + np.tile([[0.0, 0.006 * j, 0.0] for j in range(3)], (9, 1))
    stretch = find_stretch(cells, normals)
    np.testing.assert_allclose(np.abs(stretch) / np.linalg.norm(stretch), [0.0, 1.0, 0.0], atol=1e-9)


def test_long_cells_across_a_finger_are_as_long_as_on_a_flat_pad() -> None:
    angle = np.repeat(np.linspace(-0.9, 0.9, 5), 8)  # 4 mm apart, on a radius of 8 mm
    normals = np.stack([np.sin(angle), np.zeros(40), np.cos(angle)], axis=1)
    radius = 0.004 / (2.0 * np.sin(0.225))
    cells = radius * normals + np.tile([[0.0, 0.002 * j, 0.0] for j in range(8)], (5, 1))
    stretch = find_stretch(cells, normals)
    # The step to the next row is cut short by as much as it bends.
    assert np.hypot(1.0, np.linalg.norm(stretch)) == pytest.approx(2.0 * np.cos(0.225), rel=1e-3)
    np.testing.assert_allclose(np.abs(stretch) / np.linalg.norm(stretch), [1.0, 0.0, 0.0], atol=1e-6)


@pytest.mark.parametrize(
    "cells",
    [
        grid((0.0035, 0.0035), (8, 5)),
        grid((0.002, 0.0028), (8, 5)),  # nearly square
        grid((0.002, 0.02), (12, 2)),  # two strips apart
        grid((0.002, 0.006), (12, 1)),  # one row
        grid((0.002, 0.006), (1, 1)),
        (grid((0.0035, 0.00606), (5, 5)) + np.array([np.zeros(3), [0.00175, 0.00303, 0.0]])[:, None]).reshape(-1, 3),
    ],
    ids=["square", "nearly_square", "strips", "row", "cell", "hexagons"],
)
def test_other_cells_are_not_stretched(cells: np.ndarray) -> None:
    np.testing.assert_array_equal(find_stretch(cells, np.tile(OUT, (len(cells), 1))), np.zeros(3))


@pytest.mark.parametrize("name", ["bh280_finger", "bh280_palm", "fingertip_1mm"])
def test_the_cells_of_the_package_s_arrays_are_about_square(name: str) -> None:
    layout = load_tactile_pad(name).layout
    np.testing.assert_array_equal(find_stretch(layout.p_TC, layout.n_T), np.zeros(3))
