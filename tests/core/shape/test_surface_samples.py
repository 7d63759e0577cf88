import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from tactopose_drake.core.shape.surface_samples import points_along_surface, sample_surface
from tests.core.meshes import arrays, ball, create, random_pose, shape_poor_in_symmetry

SHAPES = {
    "slab": create.box((0.1, 0.08, 0.004)),
    "ball": ball(),
    "rod": create.cylinder(0.0035, 0.18),
    "boxes": shape_poor_in_symmetry(),
}
every_shape = pytest.mark.parametrize("shape", SHAPES.values(), ids=SHAPES)


@every_shape
def test_patches_along_the_surface_cover_it(shape: trimesh.Trimesh) -> None:
    points, _, share = points_along_surface(*arrays(shape), 777)
    assert len(points) * share == pytest.approx(shape.area)


@every_shape
def test_samples_lie_on_the_surface_with_its_normals(shape: trimesh.Trimesh) -> None:
    samples = sample_surface(*arrays(shape), 500)
    assert len(samples) == 500
    triangles = shape.triangles
    for point, normal in zip(samples.points[::25], samples.normals[::25], strict=True):
        closest = trimesh.triangles.closest_point(triangles, np.broadcast_to(point, (len(triangles), 3)))
        distance = np.linalg.norm(closest - point, axis=1)
        assert distance.min() < 1e-9
        assert np.any(shape.face_normals[distance < 1e-9] @ normal > 1 - 1e-9)
    np.testing.assert_allclose(np.linalg.norm(samples.normals, axis=1), 1.0)


@every_shape
def test_samples_are_shared_out_by_area(shape: trimesh.Trimesh) -> None:
    count = 2000
    samples = sample_surface(*arrays(shape), count)
    directions = np.concatenate([np.eye(3), -np.eye(3)])
    side = np.argmax(shape.face_normals @ directions.T, axis=1)
    expected = count * np.bincount(side, weights=shape.area_faces, minlength=6) / shape.area
    found = np.bincount(np.argmax(samples.normals @ directions.T, axis=1), minlength=6)
    # Independent random points would be off by their root mean square sqrt(n), some 20 to 40 here.
    np.testing.assert_allclose(found, expected, atol=0.012 * count)


@every_shape
def test_samples_keep_their_distance(shape: trimesh.Trimesh) -> None:
    samples = sample_surface(*arrays(shape), 1000)
    # Normals keep the two sides of thin walls apart.
    spread = np.concatenate([samples.points, 0.05 * samples.normals], axis=1)
    gap = cKDTree(spread).query(spread, k=2)[0][:, 1]
    ideal = np.sqrt(shape.area / 1000)
    assert gap.mean() > 0.6 * ideal  # independent random points: 0.5
    assert np.percentile(gap, 5) > 0.25 * ideal  # independent random points: 0.13


@every_shape
def test_no_part_of_the_surface_is_left_out(shape: trimesh.Trimesh) -> None:
    samples = sample_surface(*arrays(shape), 1000)
    anywhere, _ = trimesh.sample.sample_surface(shape, 20_000, seed=0)
    assert cKDTree(samples.points).query(anywhere)[0].max() < 2.0 * np.sqrt(shape.area / 1000)


def test_the_same_mesh_gives_the_same_samples() -> None:
    vertices, faces = arrays(shape_poor_in_symmetry())
    first, second = (sample_surface(vertices, faces, 300) for _ in range(2))
    np.testing.assert_array_equal(first.points, second.points)
    np.testing.assert_array_equal(first.normals, second.normals)


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=5)
def test_tiny_faces_beside_large_ones_get_their_share(seed: int) -> None:
    mesh = create.box((0.1, 0.1, 0.1)).apply_transform(random_pose(np.random.default_rng(seed)))
    top = mesh.face_normals @ mesh.face_normals[0] > 0.9
    for _ in range(4):
        vertices, faces = trimesh.remesh.subdivide(mesh.vertices, mesh.faces, np.flatnonzero(top))
        normal = mesh.face_normals[np.flatnonzero(top)[0]]
        mesh = trimesh.Trimesh(vertices, faces, process=False)
        top = mesh.face_normals @ normal > 0.9
    samples = sample_surface(*arrays(mesh), 600)
    # From one turn of the box to another that varies by 1.1; it would by 9 if samples were drawn one by one.
    assert abs(np.sum(samples.normals @ normal > 0.9) - 100) <= 5


def test_samples_are_read_only() -> None:
    samples = sample_surface(*arrays(ball()), 200)
    for array in (samples.points, samples.normals):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0
