import math

import numpy as np
import pytest
from scipy.spatial.distance import cdist

from tactopose_drake.core.shape.point_grid import PointGridParams, build_point_grid
from tactopose_drake.errors import InvalidInputError

GENERATOR = np.random.default_rng(0)
SPHERE = GENERATOR.normal(size=(2000, 3)) * [0.03, 0.05, 0.02]
CLOUDS = {
    "volume": SPHERE,
    "surface": 0.04 * SPHERE / np.linalg.norm(SPHERE, axis=1, keepdims=True) + [0.3, -0.2, 0.1],
    "plane": SPHERE * [1.0, 1.0, 0.0],
    "line": SPHERE * [0.0, 1.0, 0.0],
    "twice each": np.tile(SPHERE[:50], (2, 1)),
    "two": SPHERE[:2],
    "two far ones among many near ones": np.concatenate([1e-4 * SPHERE, [[1.0, 0.0, 0.0], [0.0, 1.0, 1.0]]]),
}


@pytest.mark.parametrize("name", CLOUDS)
def test_the_nearest_point_is_that_of_brute_force(name: str) -> None:
    cloud = CLOUDS[name]
    grid = build_point_grid(cloud)
    around = cloud[GENERATOR.integers(len(cloud), size=300)]
    scale = GENERATOR.choice([1e-4, 1e-3, 1e-2, 0.1, 1.0], size=(300, 1))
    queries = np.concatenate([around + scale * GENERATOR.normal(size=(300, 3)), around[:50]])
    np.testing.assert_allclose(grid.distance(queries), cdist(queries, cloud).min(axis=1), rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize("name", CLOUDS)
def test_each_cell_holds_its_points(name: str) -> None:
    cloud = CLOUDS[name]
    grid = build_point_grid(cloud)
    assert sorted(map(tuple, grid.points)) == sorted(map(tuple, cloud))
    cell = np.repeat(np.arange(grid.seeds.size), np.diff(grid.starts))
    assert len(cell) == len(cloud)
    lower = grid.origin + grid.spacing * np.stack(np.unravel_index(cell, grid.seeds.shape), axis=1)
    assert np.all(grid.points >= lower - 1e-12)
    assert np.all(grid.points <= lower + grid.spacing + 1e-12)


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (np.zeros((0, 3)), "points must be at least 2 different ones, not 0"),
        (np.ones((5, 3)), "points must be at least 2 different ones, not 5, all the same"),
        ([[0.0, math.nan, 0.0]], r"points\[0, 1\] must be .*, not nan"),
        (np.zeros((4, 2)), r"points must have the shape .*, not \(4, 2\)"),
    ],
)
def test_bad_clouds_are_named(points: object, message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        build_point_grid(points)  # type: ignore[arg-type]


def test_there_are_no_more_cells_than_wanted() -> None:
    few, many = build_point_grid(SPHERE, PointGridParams(most_cells=50)), build_point_grid(SPHERE)
    assert few.seeds.size <= 50 < many.seeds.size
    np.testing.assert_array_equal(few.distance(2.0 * SPHERE), many.distance(2.0 * SPHERE))
