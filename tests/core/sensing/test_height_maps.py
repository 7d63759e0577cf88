import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw

from tactopose_drake.core.poses import make_poses, random_rotations
from tactopose_drake.core.sensing.height_maps import HeightMapSensor
from tactopose_drake.errors import InvalidInputError

SENSOR = HeightMapSensor(pixel=(1e-4, 2e-4))
X_PT = make_poses(random_rotations(np.random.default_rng(0), 1)[0], np.array([0.02, -0.03, 0.1]))


def sloping(rows: int = 120, columns: int = 160) -> np.ndarray:
    """A depth that is linear in both coordinates of T, and positive everywhere."""
    x, y = places(rows, columns)
    return 0.001 + 0.02 * x - 0.03 * y


def places(rows: int, columns: int) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates of the pixels in T, m."""
    return np.meshgrid((np.arange(columns) - (columns - 1) / 2) * 1e-4, (np.arange(rows) - (rows - 1) / 2) * 2e-4)


@pytest.mark.parametrize(("rows", "columns"), [(120, 160), (121, 163), (3, 200), (1, 1)])
def test_cells_are_means_where_the_pixels_are(rows: int, columns: int) -> None:
    patch = SENSOR.patch(sloping(rows, columns), np.eye(3, 4))
    x, y, z = patch.p_PT.T
    np.testing.assert_allclose(z, 0.0)
    np.testing.assert_array_equal(patch.n_PT, np.tile([0.0, 0.0, 1.0], (len(x), 1)))
    # The mean of what is linear is the value in the middle; the object is so deep below the gel's surface.
    np.testing.assert_allclose(patch.points[:, 2], -(0.001 + 0.02 * x - 0.03 * y), atol=1e-12)
    assert patch.active.all()
    # They are spread over the whole pad, about its middle.
    assert len(x) <= 80
    assert np.ptp(x) >= 0.7 * (columns - 1) * 1e-4
    assert np.ptp(y) >= 0.6 * (rows - 3) * 2e-4
    np.testing.assert_allclose([x.mean(), y.mean()], 0.0, atol=1.01e-4)  # half a pixel


def test_a_pair_of_sizes_may_be_a_list() -> None:
    first, second = (HeightMapSensor(pixel=pixel).patch(sloping(), X_PT) for pixel in ((5e-5, 7e-5), [5e-5, 7e-5]))
    np.testing.assert_array_equal(first.p_PT, second.p_PT)


def test_the_patch_moves_with_the_pad() -> None:
    at_rest, moved = (SENSOR.patch(sloping(), X) for X in (np.eye(3, 4), X_PT))
    np.testing.assert_allclose(moved.points, at_rest.points @ X_PT[:, :3].T + X_PT[:, 3], atol=1e-12)
    np.testing.assert_allclose(moved.eigenvalues, at_rest.eigenvalues, rtol=1e-6)
    X = RigidTransform(RollPitchYaw(0.1, 0.2, 0.3), [0.1, 0.0, 0.0])
    np.testing.assert_array_equal(SENSOR.patch(sloping(), X).p_PT, SENSOR.patch(sloping(), X.GetAsMatrix34()).p_PT)


def test_the_less_is_touched_the_finer_it_is_looked_at() -> None:
    x, y = places(240, 320)
    gaps = []
    for radius in (0.001, 0.003, 0.01):
        depth = np.where(np.hypot(x, y) < radius, 0.0005, 0.0)
        patch = SENSOR.patch(depth, np.eye(3, 4))
        gaps.append(patch.half_pitch)
        assert 40 <= patch.active.sum() <= 110
        # All around what is touched, a cell says that it is not.
        assert len(patch.p_PT) - patch.active.sum() >= 20
        assert len(patch.p_PT) <= 300
        np.testing.assert_allclose(patch.centroid[:2], 0.0, atol=2e-4)
    assert gaps[0] < gaps[1] < gaps[2]


@pytest.mark.parametrize("radius", [0.5, 1.5, 3.0, 5.0, 5.6, 8.0, 12.0, 40.0])
@pytest.mark.parametrize(("row", "column"), [(120, 160), (5, 300)])
def test_cells_reach_as_far_as_the_blocks_however_little_is_touched(radius: float, row: int, column: int) -> None:
    rows, columns = np.mgrid[:240, :320]
    depth = np.where((rows - row) ** 2 + (columns - column) ** 2 < radius**2, 5e-4, 0.0)
    patch = HeightMapSensor(pixel=6e-5).patch(depth, np.eye(3, 4))
    assert patch.half_pitch == pytest.approx(0.5 * np.diff(np.unique(np.round(patch.p_PT[:, 0], 9))).min(), rel=1e-6)
    assert np.count_nonzero(~patch.active) >= 8


def test_a_depth_that_is_none_may_be_where_nothing_touches() -> None:
    depth, mask = np.full((120, 160), 0.0008), np.ones((120, 160), dtype=np.bool_)
    depth[40:50, 60:70], mask[40:50, 60:70] = np.inf, False
    found = SENSOR.patch(depth, np.eye(3, 4), mask=mask)
    depth[40:50, 60:70] = 0.0
    np.testing.assert_array_equal(found.pressure, SENSOR.patch(depth, np.eye(3, 4)).pressure)


def test_pixels_that_are_not_known_leave_the_mean_of_the_others() -> None:
    depth = np.full((120, 160), 0.0008)
    depth[::3, ::2] = np.nan
    patch = SENSOR.patch(depth, np.eye(3, 4))
    np.testing.assert_allclose(patch.points[:, 2], -0.0008, rtol=1e-12)


def test_a_block_is_known_where_most_of_its_pixels_are() -> None:
    depth = np.full((12, 12), 0.0008)
    depth[0, :3], depth[1, :2] = np.nan, np.nan  # of the first block of three by three pixels four are left
    depth[0, 6:9], depth[1, 6] = np.nan, np.nan  # of the third one five
    patch = HeightMapSensor(pixel=1e-4, most_cells=16).patch(depth, np.eye(3, 4))
    assert len(patch.p_PT) == 16
    np.testing.assert_array_equal(np.flatnonzero(patch.dead), [0])
    np.testing.assert_allclose(patch.points[~patch.dead, 2], -0.0008, rtol=1e-12)


def test_what_the_mask_leaves_out_is_not_touched() -> None:
    depth = np.full((120, 160), 0.0008)
    mask = np.zeros(depth.shape, dtype=np.bool_)
    mask[:, :80] = True
    depth[:, 100:] = np.nan  # glare, of which nothing is known, touched or not
    patch = SENSOR.patch(depth, np.eye(3, 4), mask)
    assert (patch.p_PT[patch.active, 0] < 2e-4).all()
    assert (patch.p_PT[patch.dead, 0] > 1.8e-3).all()
    assert patch.dead.any()
    assert (~patch.dead & ~patch.active).any()


def test_a_map_that_nothing_touches_is_no_contact() -> None:
    noise = np.abs(np.random.default_rng(0).normal(size=(240, 320))) * 2e-5
    patch = SENSOR.patch(noise, X_PT)
    assert patch.status == "no_contact"
    assert 30 <= len(patch.p_PT) <= 200


def test_a_gel_that_gives_way_no_more_is_saturated() -> None:
    sensor = HeightMapSensor(pixel=1e-4, most_depth=0.001)
    depth = np.full((50, 50), 0.0005)
    depth[:25] = 0.0012
    patch = sensor.patch(depth, X_PT)
    assert patch.saturated.any()
    np.testing.assert_array_equal(patch.saturated, patch.alpha * patch.pressure >= 0.001)


@pytest.mark.parametrize(
    ("depth", "options", "message"),
    [
        (np.zeros(5), {}, "depth"),
        (np.zeros((0, 5)), {}, "depth must have 1 to .* pixels, not 0"),
        (np.full((4, 4), np.nan), {}, "depth must be known at one pixel or more"),
        (np.full((4, 4), np.inf), {}, "depth must be .*, not inf"),
        (np.full((4, 4), 0.8), {}, "depth must be numbers from -0.1 to 0.1 m, or NaN, not 0.8 m"),
        (
            np.zeros((4, 4)),
            {"mask": np.zeros((4, 5), dtype=bool)},
            "mask must be booleans of shape .*, not bool of shape",
        ),
        (np.zeros((4, 4)), {"mask": np.zeros((4, 4))}, "mask must be booleans of shape .*, not float64"),
    ],
)
def test_a_map_that_is_none_is_refused(depth: np.ndarray, options: dict[str, np.ndarray], message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        SENSOR.patch(depth, X_PT, **options)


def test_a_map_that_is_hardly_known_is_called_so() -> None:
    depth = np.full((240, 320), np.nan)
    depth[100:110, 100:103] = 1e-5
    with pytest.raises(InvalidInputError, match=r"depth must be mostly known somewhere, .*, 30 of 76800"):
        SENSOR.patch(depth, X_PT)


@pytest.mark.parametrize(
    "options",
    [
        {"pixel": 0.0},
        {"pixel": 0.05},
        {"pixel": (1e-4, 1e-4, 1e-4)},
        {"pixel": [1e-4]},
        {"pixel": 1e-4, "most_depth": 1e-5},
        {"pixel": 1e-4, "most_cells": 2},
        {"pixel": 1e-4, "alpha": 1e-16},
    ],
)
def test_a_sensor_that_is_none_is_refused(options: dict[str, float]) -> None:
    with pytest.raises(InvalidInputError, match="HeightMapSensor"):
        HeightMapSensor(**options)
