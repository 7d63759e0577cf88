import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from tactopose_drake.core.shape.signed_distance import DistanceGrid, GridParams, build_grid
from tactopose_drake.errors import InvalidInputError
from tests.core.meshes import arrays, ball, create, cube, inside_out, joined, random_pose, shape_poor_in_symmetry

RADIUS, SIDE = 0.04, 0.06
SPACING = 0.002
BALL = build_grid(*arrays(ball(RADIUS, subdivisions=5)), spacing=SPACING)
CUBE = build_grid(*arrays(cube(SIDE)), spacing=SPACING)
seeds = st.integers(0, 2**32 - 1)


def box_distance(points: NDArray[np.float64], half: float) -> NDArray[np.float64]:
    q = np.abs(points) - half
    return np.linalg.norm(np.maximum(q, 0), axis=-1) + np.minimum(q.max(axis=-1), 0)


def points_within(grid: DistanceGrid, seed: int, count: int = 500) -> NDArray[np.float64]:
    return np.random.default_rng(seed).uniform(grid.origin, grid.upper, (count, 3))


@given(seed=seeds)
@settings(max_examples=10)
def test_a_ball_s_distance_and_normal(seed: int) -> None:
    p = points_within(BALL, seed)
    radius = np.linalg.norm(p, axis=1)
    d, n = BALL.distance_and_normal(p)
    away = radius > 7 * SPACING  # the gradient jumps at the centre
    # One point in a hundred thousand is near a node whose nearest face the sweeps miss, by a tenth of a cell at most.
    error = np.abs(d[away] - radius[away] + RADIUS)
    assert error.max() < 0.1 * SPACING
    assert np.quantile(error, 0.99) < 1e-4
    assert np.all(np.sum(n * p, axis=1)[away] / radius[away] > np.cos(np.radians(4.0)))


@given(seed=seeds)
@settings(max_examples=10)
def test_a_cube_s_distance_and_normal(seed: int) -> None:
    p = points_within(CUBE, seed)
    d, n = CUBE.distance_and_normal(p)
    exact = box_distance(p, SIDE / 2)
    # Worst where three faces are equally near, in cells that their diagonal crosses from node to node: there the
    # interpolant of max(x, y, z) is 1 - (1 - t)^3 at (t, t, t), too large by 2 / (3 sqrt 3) of a cell at the most.
    np.testing.assert_allclose(d, exact, rtol=0.0, atol=(2.0 / (3.0 * np.sqrt(3.0)) + 1e-6) * SPACING)
    over_a_face = (np.abs(p[:, :2]).max(axis=1) < SIDE / 2 - 5 * SPACING) & (np.abs(p[:, 2]) > SIDE / 2 - SPACING)
    np.testing.assert_allclose(d[over_a_face], exact[over_a_face], atol=1e-8)
    np.testing.assert_allclose(n[over_a_face], np.sign(p[over_a_face]) * [0, 0, 1], atol=1e-3)


@given(seed=seeds)
@settings(max_examples=10)
def test_no_two_distances_differ_by_more_than_the_way_between(seed: int) -> None:
    generator = np.random.default_rng(seed)
    for grid in (BALL, CUBE):
        a, b = generator.integers(0, grid.shape, (2, 500, 3))
        change = grid.values[tuple(a.T)][:, 0] - grid.values[tuple(b.T)][:, 0]
        assert np.all(np.abs(change) <= grid.spacing * (np.linalg.norm(a - b, axis=1) + 0.1))
        # Between nodes the interpolation may be steeper, where the gradient jumps at a ridge: along each axis it is a
        # mean of differences between neighbouring nodes, so the root of three at the most.
        p = points_within(grid, seed)
        q = p + generator.normal(size=p.shape) * grid.spacing
        change, way = np.abs(grid.distance(p) - grid.distance(q)), np.linalg.norm(p - q, axis=1)
        assert np.all(change <= np.sqrt(3.0) * way)
        assert np.mean(change <= 1.01 * way) > 0.97


def test_nodes_hold_the_exact_distance_within_the_band() -> None:
    vertices, faces = arrays(shape_poor_in_symmetry().apply_transform(random_pose(np.random.default_rng(4))))
    grid = build_grid(vertices, faces, spacing=0.003)
    generator = np.random.default_rng(0)
    index = generator.integers(0, grid.shape, (3000, 3))
    points = grid.origin + grid.spacing * index
    exact = np.full(len(points), np.inf)
    for triangle in vertices[faces]:
        closest = trimesh.triangles.closest_point(np.broadcast_to(triangle, (len(points), 3, 3)), points)
        exact = np.minimum(exact, np.linalg.norm(closest - points, axis=1))
    found = np.abs(grid.values[tuple(index.T)][:, 0])
    band = exact < GridParams().band * grid.spacing
    np.testing.assert_allclose(found[band], exact[band], atol=1e-6)
    np.testing.assert_allclose(found, exact, atol=0.1 * grid.spacing)
    np.testing.assert_allclose(grid.distance(points), grid.values[tuple(index.T)][:, 0], atol=1e-7)


@given(seed=seeds)
@settings(max_examples=5)
def test_the_field_turns_and_moves_with_the_mesh(seed: int) -> None:
    generator = np.random.default_rng(seed)
    mesh = create.icosphere(3, 0.03).apply_scale([1.0, 0.7, 1.4])
    X = random_pose(generator)
    still = build_grid(*arrays(mesh), spacing=0.003)
    moved = build_grid(*arrays(mesh.copy().apply_transform(X)), spacing=0.003)
    # Not far within, where the distance bends more between nodes, up to its ridge.
    p = mesh.vertices[::7] * generator.uniform(0.9, 1.15, (len(mesh.vertices[::7]), 1))
    d, n = still.distance_and_normal(p)
    d_moved, n_moved = moved.distance_and_normal(p @ X[:3, :3].T + X[:3, 3])
    np.testing.assert_allclose(d_moved, d, atol=3e-4)
    assert np.median(np.sum(n_moved * (n @ X[:3, :3].T), axis=1)) > np.cos(np.radians(3.0))


@given(seed=seeds)
@settings(max_examples=10)
def test_outside_the_grid_the_way_to_it_is_added(seed: int) -> None:
    generator = np.random.default_rng(seed)
    p = generator.uniform(-1, 1, (200, 3))
    clamped = np.clip(p, BALL.origin, BALL.upper)
    d, n = BALL.distance_and_normal(p)
    d_clamped, n_clamped = BALL.distance_and_normal(clamped)
    np.testing.assert_allclose(d, d_clamped + np.linalg.norm(p - clamped, axis=1))
    np.testing.assert_allclose(n, n_clamped)
    # An upper bound of the true distance, and never nearer than the grid's own border.
    assert np.all(d >= np.linalg.norm(p, axis=1) - RADIUS - 1e-4)


@pytest.mark.parametrize("shape", [(), (1,), (4, 5), (2, 3, 4)])
def test_points_come_in_batches_of_any_shape(shape: tuple[int, ...]) -> None:
    p = np.random.default_rng(0).uniform(-0.05, 0.05, (*shape, 3))
    d, n = CUBE.distance_and_normal(p)
    assert d.shape == shape
    assert n.shape == (*shape, 3)
    np.testing.assert_array_equal(CUBE.distance(p), d)
    np.testing.assert_allclose(d.reshape(-1)[-1], CUBE.distance(p.reshape(-1, 3)[-1]))


@given(seed=seeds)
@settings(max_examples=10)
def test_normals_are_of_unit_length_everywhere(seed: int) -> None:
    for grid in (BALL, CUBE):
        p = np.concatenate([points_within(grid, seed), np.zeros((1, 3)), 0.5 * (grid.origin + grid.upper)[None]])
        np.testing.assert_allclose(np.linalg.norm(grid.distance_and_normal(p)[1], axis=1), 1.0, atol=1e-9)


def test_where_normals_cancel_the_nearest_node_decides() -> None:
    values = np.zeros((2, 2, 2, 4), dtype=np.float32)
    values[0, ..., 1], values[1, ..., 1] = -1.0, 1.0
    grid = DistanceGrid(values, np.zeros(3), 1.0)
    np.testing.assert_array_equal(grid.distance_and_normal([0.49999, 0.2, 0.2])[1], [-1, 0, 0])
    np.testing.assert_array_equal(grid.distance_and_normal([0.50001, 0.2, 0.2])[1], [1, 0, 0])
    nowhere = DistanceGrid(np.zeros((2, 2, 2, 4), dtype=np.float32), np.zeros(3), 1.0)
    np.testing.assert_array_equal(nowhere.distance_and_normal([[0.5, 0.5, 0.5]])[1], [[0, 0, 1]])


def test_a_point_is_inside_where_the_winding_number_is_at_least_one() -> None:
    overlapping = build_grid(*arrays(joined(cube(0.06), cube(0.06, (0.03, 0.0, 0.0)))), spacing=SPACING)
    hollow = build_grid(*arrays(joined(cube(0.06), inside_out(cube(0.04)))), spacing=SPACING)
    assert overlapping.distance([0.015, 0.0, 0.0]) < 0  # in both
    np.testing.assert_allclose(hollow.distance([[0.0, 0.0, 0.0], [0.022, 0.0, 0.0]]), [0.02, -0.002], atol=1e-4)
    inward, outward = hollow.distance_and_normal([[0.021, 0.0, 0.0], [0.029, 0.0, 0.0]])[1]
    np.testing.assert_allclose([inward, outward], [[-1, 0, 0], [1, 0, 0]], atol=1e-3)


def test_the_mesh_lies_within_a_margin_of_the_grid() -> None:
    for mesh in (cube(), create.cylinder(0.0035, 0.18), shape_poor_in_symmetry()):
        grid = build_grid(*arrays(mesh), max_bytes=16 * 100_000)
        margin = max(3 * grid.spacing, 0.05 * float(np.linalg.norm(mesh.extents)))
        assert np.all(grid.origin <= mesh.bounds[0] - margin + 1e-12)
        assert np.all(grid.upper >= mesh.bounds[1] + margin - 1e-12)


@pytest.mark.parametrize("nodes", [20_000, 100_000])
def test_the_memory_bound_is_used_and_kept(nodes: int) -> None:
    grid = build_grid(*arrays(shape_poor_in_symmetry()), max_bytes=16 * nodes)
    assert 0.8 * 16 * nodes < grid.values.nbytes <= 16 * nodes


def test_thin_walls_get_a_finer_grid() -> None:
    params = GridParams(nodes=30_000)
    thick, thin = (build_grid(*arrays(create.annulus(0.03, r_max, 0.05)), params=params) for r_max in (0.04, 0.032))
    assert thick.values[..., 0].size <= 30_000
    assert 0.9 * 0.002 / 2.5 < thin.spacing <= 0.002 / 2.5


def test_a_grid_is_read_only_and_contiguous() -> None:
    assert CUBE.values.flags.c_contiguous
    for array in (CUBE.values, CUBE.origin):
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0


@pytest.mark.parametrize(
    ("spacing", "max_bytes", "message"),
    [
        (0.0, 2**20, "spacing must be .*, not 0"),
        (1e-4, 2**20, r"spacing must be at least 0\.00\d+ m with max_grid_bytes = 1048576, not 0\.0001 m"),
        (None, 1000, "max_grid_bytes must be a number >= 160000, not 1000"),
    ],
)
def test_impossible_resolutions_are_refused(spacing: float | None, max_bytes: int, message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        build_grid(*arrays(cube()), spacing=spacing, max_bytes=max_bytes)
