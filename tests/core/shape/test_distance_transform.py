import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from tactopose_drake.core.mesh.winding_kernels import winding_numbers
from tactopose_drake.core.shape import distance_transform
from tactopose_drake.core.shape.distance_kernels import signed_field
from tests.core.meshes import arrays, ball, create, cube, inside_out, joined, random_pose, shape_poor_in_symmetry

BAND = 2.0  # half width of what is exact, in spacings

Grid = tuple[NDArray[np.float64], float, tuple[int, int, int]]


def grid_around(vertices: NDArray[np.float64], nodes: int = 40) -> Grid:
    lower, upper = vertices.min(axis=0), vertices.max(axis=0)
    spacing = float((upper - lower).max() / nodes)
    shape = np.ceil((upper - lower) / spacing).astype(int) + 7
    return lower - np.array([3.3, 3.1, 3.2]) * spacing, spacing, (int(shape[0]), int(shape[1]), int(shape[2]))


def nodes_of(grid: Grid) -> NDArray[np.float64]:
    origin, spacing, shape = grid
    return origin + spacing * np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), axis=-1)


def brute_force(packed: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Distances to all triangles, by trimesh's own point-triangle distance."""
    corners = np.stack([packed[:, :3], packed[:, :3] + packed[:, 3:6], packed[:, :3] + packed[:, 6:9]], axis=1)
    best = np.full(len(points), np.inf)
    for triangle in corners:
        closest = trimesh.triangles.closest_point(np.broadcast_to(triangle, (len(points), 3, 3)), points)
        best = np.minimum(best, np.linalg.norm(closest - points, axis=1))
    return best


SHAPES = {
    "turned_cube": cube().apply_transform(random_pose(np.random.default_rng(1))),
    "ball": ball(subdivisions=2),
    "torus": create.torus(0.04, 0.015, major_sections=24, minor_sections=12),
    "boxes": shape_poor_in_symmetry().apply_transform(random_pose(np.random.default_rng(2))),
}
every_shape = pytest.mark.parametrize("shape", SHAPES.values(), ids=SHAPES)


@every_shape
def test_distances_are_exact_near_the_surface_and_close_everywhere(shape: trimesh.Trimesh) -> None:
    vertices, faces = arrays(shape)
    origin, spacing, counts = grid = grid_around(vertices)
    packed = distance_transform.pack_triangles(vertices[faces])
    nearest = distance_transform.nearest_faces(packed, origin, spacing, counts, BAND)
    assert nearest.min() >= 0
    generator = np.random.default_rng(0)
    index = tuple(generator.integers(0, counts, (3000, 3)).T)
    points = nodes_of(grid)[index]
    chosen = vertices[faces[nearest[index]]]
    found = np.linalg.norm(trimesh.triangles.closest_point(chosen, points) - points, axis=1)
    exact = brute_force(packed, points)
    band = exact < BAND * spacing
    assert band.sum() > 200
    np.testing.assert_allclose(found[band], exact[band], atol=1e-12)
    assert np.max(found - exact) < 0.1 * spacing
    assert np.mean(found - exact > 1e-9) < 0.01


@every_shape
def test_field_is_distance_with_sign_and_its_unit_gradient(shape: trimesh.Trimesh) -> None:
    vertices, faces = arrays(shape)
    origin, spacing, counts = grid = grid_around(vertices)
    packed = distance_transform.pack_triangles(vertices[faces])
    nearest = distance_transform.nearest_faces(packed, origin, spacing, counts, BAND)
    winding, _ = winding_numbers(vertices, faces, origin, spacing, counts)
    values = signed_field(packed, nearest, winding, origin, spacing)
    assert values.dtype == np.float32
    np.testing.assert_allclose(np.linalg.norm(values[..., 1:], axis=-1), 1.0, atol=1e-6)
    # Following the gradient by the signed distance leads to the surface.
    feet = nodes_of(grid) - values[..., :1] * values[..., 1:]
    at_surface = brute_force(packed, feet.reshape(-1, 3)[::37])
    assert at_surface.max() < 1e-7
    np.testing.assert_array_equal(values[..., 0] < 0, (winding >= 1) & (values[..., 0] != 0))


@every_shape
def test_inside_is_where_trimesh_says(shape: trimesh.Trimesh) -> None:
    vertices, faces = arrays(shape)
    origin, spacing, counts = grid = grid_around(vertices, nodes=25)
    winding, rest = winding_numbers(vertices, faces, origin, spacing, counts)
    assert not rest.any()
    points = nodes_of(grid).reshape(-1, 3)[::11]
    inside = np.zeros(len(points))
    for a, b, c in vertices[faces][:, :, None] - points:  # solid angles, after van Oosterom and Strackee
        la, lb, lc = (np.linalg.norm(corner, axis=1) for corner in (a, b, c))
        triple = np.einsum("ni,ni->n", a, np.cross(b, c))
        dots = (a * b).sum(1) * lc + (b * c).sum(1) * la + (c * a).sum(1) * lb
        inside += np.arctan2(triple, la * lb * lc + dots) / (2 * np.pi)
    np.testing.assert_array_equal(winding.reshape(-1)[::11], np.round(inside))


def test_winding_numbers_count_overlapping_and_inverted_bodies() -> None:
    outer, inner = cube(0.06), cube(0.02)
    for mesh, in_the_middle in (
        (joined(outer, inner), 2),
        (joined(outer, inside_out(inner)), 0),
        (inside_out(outer), -1),
    ):
        vertices, faces = arrays(mesh)
        origin, spacing, counts = grid_around(vertices, nodes=21)
        winding, rest = winding_numbers(vertices, faces, origin, spacing, counts)
        assert not rest.any()
        assert winding[counts[0] // 2, counts[1] // 2, counts[2] // 2] == in_the_middle
        assert winding[0, 0, 0] == 0


def test_columns_through_edges_and_vertices_cross_the_surface_once() -> None:
    # All vertices of this finely divided cube lie on columns of the grid, up to a nudge along no special direction.
    mesh = cube(0.06)
    for _ in range(4):
        mesh = mesh.subdivide()
    vertices, faces = arrays(mesh)
    spacing = 0.06 / 16
    origin = np.array([-0.03, -0.03, -0.03]) - 2 * spacing
    counts = (21, 21, 21)
    winding, rest = winding_numbers(vertices, faces, origin + spacing * np.array([1e-7, 2.3e-7, 0.0]), spacing, counts)
    assert not rest.any()
    assert set(np.unique(winding)) == {0, 1}
    inner = winding[3:18, 3:18, 3:18]
    assert inner.all()


def test_columns_that_graze_an_edge_cross_the_surface_once() -> None:
    # Points of a line that are rounded are on either side of it: both faces of an edge must agree on which.
    vertices, faces = arrays(ball(subdivisions=3).apply_transform(random_pose(np.random.default_rng(8))))
    generator = np.random.default_rng(0)
    for start, end in vertices[faces[:400, :2]]:
        origin = start + generator.random() * (end - start)
        origin[2] = vertices[:, 2].min() - 0.01
        winding, rest = winding_numbers(vertices, faces, origin, 0.01, (1, 1, 12))
        assert rest[0, 0] == 0
        assert set(np.unique(winding)) <= {0, 1}


def test_open_meshes_leave_a_remainder_in_the_columns_through_the_hole() -> None:
    mesh = cube(0.06)
    mesh.update_faces(mesh.face_normals[:, 2] < 0.9)
    vertices, faces = arrays(mesh)
    origin, spacing, counts = grid_around(vertices, nodes=20)
    _, rest = winding_numbers(vertices, faces, origin, spacing, counts)
    assert rest[counts[0] // 2, counts[1] // 2] == 1
    assert rest[0, 0] == 0


def test_gradient_on_the_surface_is_the_face_s_normal() -> None:
    vertices, faces = arrays(cube(0.06))
    spacing = 0.005
    origin = np.full(3, -0.03 - 2 * spacing)  # nodes lie on the cube's faces
    packed = distance_transform.pack_triangles(vertices[faces])
    counts = (17, 17, 17)
    nearest = distance_transform.nearest_faces(packed, origin, spacing, counts, BAND)
    winding, _ = winding_numbers(vertices, faces, origin + 1e-9, spacing, counts)
    values = signed_field(packed, nearest, winding, origin, spacing)
    np.testing.assert_allclose(values[8, 8, 14], [0, 0, 0, 1], atol=1e-6)
    np.testing.assert_allclose(values[8, 8, 2], [0, 0, 0, -1], atol=1e-6)
    np.testing.assert_allclose(values[2, 8, 8], [0, -1, 0, 0], atol=1e-6)
