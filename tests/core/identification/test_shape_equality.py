import numpy as np
import pytest
import trimesh

from tactopose_drake.core.identification.shape_equality import ShapeEqualityParams, find_alignment
from tactopose_drake.core.poses import transform_points
from tactopose_drake.core.shape.object_model import ObjectModel
from tests.core.meshes import random_pose, shape_poor_in_symmetry


def make(mesh: trimesh.Trimesh) -> ObjectModel:
    return ObjectModel.from_mesh(mesh, spacing=0.002, cache=False)


@pytest.fixture(scope="module")
def model() -> ObjectModel:
    return make(shape_poor_in_symmetry())


@pytest.mark.parametrize("seed", [0, 1])
def test_a_moved_and_finer_mesh_is_laid_onto_the_first(model: ObjectModel, seed: int) -> None:
    X = random_pose(np.random.default_rng(seed))
    other = make(shape_poor_in_symmetry().subdivide().apply_transform(X))
    X_BA = find_alignment(model, other)
    assert X_BA is not None
    np.testing.assert_allclose(
        transform_points(X_BA, model.vertices), transform_points(X[:3], model.vertices), atol=0.005 * model.size
    )


@pytest.mark.parametrize("shape", [trimesh.creation.icosphere(4, 0.03), trimesh.creation.box((0.1, 0.06, 0.02))])
def test_symmetric_shapes_are_equal_in_any_place(shape: trimesh.Trimesh) -> None:
    moved = shape.copy().apply_transform(random_pose(np.random.default_rng(2)))
    assert find_alignment(make(shape), make(moved)) is not None


@pytest.mark.parametrize("size", [(0.06, 0.06, 0.06), (0.06, 0.08, 0.1)])
def test_a_small_part_that_breaks_a_symmetry_does_not_hide_that_shapes_are_equal(size: tuple[float, ...]) -> None:
    part = trimesh.creation.box((0.012, 0.012, 0.012), trimesh.transformations.translation_matrix((0.03, 0.012, 0.02)))
    mesh = trimesh.boolean.union([trimesh.creation.box(size), part], engine="manifold")
    for seed in range(2):
        X = random_pose(np.random.default_rng(seed))
        model, other = make(mesh), make(mesh.copy().apply_transform(X))
        X_BA = find_alignment(model, other)
        assert X_BA is not None
        np.testing.assert_allclose(X_BA, X[:3], atol=0.01)


def test_a_tiny_part_that_breaks_the_symmetries_of_a_cube_does_not_hide_that_shapes_are_equal() -> None:
    place = trimesh.transformations.translation_matrix((0.046, 0.014, -0.013))
    part = trimesh.creation.box((0.0086, 0.0085, 0.0084), place)
    mesh = trimesh.boolean.union([trimesh.creation.box((0.092, 0.092, 0.092)), part], engine="manifold")
    for seed in range(4):
        moved = mesh.copy().apply_transform(random_pose(np.random.default_rng(seed)))
        assert find_alignment(make(mesh), make(moved)) is not None


def test_other_shapes_are_not_equal(model: ObjectModel) -> None:
    mirrored = shape_poor_in_symmetry()
    mirrored.apply_transform(np.diag([1.0, 1.0, -1.0, 1.0]))
    assert find_alignment(model, make(mirrored)) is None
    longer = shape_poor_in_symmetry()
    longer.apply_scale((1.05, 1.0, 1.0))
    assert find_alignment(model, make(longer)) is None


def test_equal_areas_and_moments_are_not_enough() -> None:
    """Two small blocks stand on the same face of a box, either at corners that are opposite, or mirrored."""

    def cube_with(*places: tuple[float, float]) -> ObjectModel:
        blocks = [
            trimesh.creation.box((0.012, 0.012, 0.02), trimesh.transformations.translation_matrix((x, y, 0.035)))
            for x, y in places
        ]
        return make(trimesh.boolean.union([trimesh.creation.box((0.06, 0.06, 0.06)), *blocks], engine="manifold"))

    a, b = cube_with((0.02, 0.008), (-0.02, -0.008)), cube_with((-0.02, 0.008), (0.02, -0.008))
    np.testing.assert_allclose(np.linalg.eigvalsh(a.inertia), np.linalg.eigvalsh(b.inertia), rtol=1e-6)
    assert find_alignment(a, b) is None
    assert find_alignment(a, a) is not None


def test_a_small_part_makes_another_object() -> None:
    """A pin on a cube changes area, volume and moments by about a percent, and few samples are on it."""
    cube = trimesh.creation.box((0.06, 0.06, 0.06))
    pin = trimesh.creation.box((0.004, 0.004, 0.016), trimesh.transformations.translation_matrix((0.01, 0.005, 0.034)))
    plain, pinned = make(cube), make(trimesh.boolean.union([cube, pin], engine="manifold"))
    assert find_alignment(plain, pinned) is None
    assert find_alignment(pinned, plain) is None


def test_a_tolerance_decides_what_is_equal(model: ObjectModel) -> None:
    larger = shape_poor_in_symmetry()
    larger.apply_scale(1.01)
    other = make(larger)
    assert find_alignment(model, other, ShapeEqualityParams(tolerance=0.002)) is None
    assert find_alignment(model, other, ShapeEqualityParams(tolerance=0.02)) is not None
