import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from tactopose_drake.core.poses import transform_points
from tactopose_drake.core.shape.signed_distance import build_grid
from tactopose_drake.core.shape.surface_samples import sample_surface
from tactopose_drake.core.shape.symmetry import RotationalSymmetry, symmetry_group
from tactopose_drake.core.shape.symmetry_detection import detect_likenesses, detect_near_symmetries, detect_symmetries
from tactopose_drake.core.shape.symmetry_judge import JudgedShape, SymmetryDetectionParams
from tests.core.meshes import arrays, ball, create, cube, die, joined, random_pose, scanned_can, shape_poor_in_symmetry

Z = np.array([0.0, 0.0, 1.0])


def symmetries_of(mesh: trimesh.Trimesh, **params: float) -> tuple[RotationalSymmetry, ...]:
    return detect_symmetries(shape_of(mesh), SymmetryDetectionParams(**params))


def near_symmetries_of(mesh: trimesh.Trimesh) -> tuple[RotationalSymmetry, ...]:
    shape = shape_of(mesh)
    return detect_near_symmetries(shape, detect_symmetries(shape))


def shape_of(mesh: trimesh.Trimesh) -> JudgedShape:
    vertices, faces = arrays(mesh)
    grid, samples = build_grid(vertices, faces, max_bytes=16 * 250_000), sample_surface(vertices, faces, 2000)
    properties = trimesh.triangles.mass_properties(vertices[faces])
    size = float(np.linalg.norm(np.ptp(vertices, axis=0)))
    return JudgedShape(samples, grid, np.array(properties.center_mass), np.array(properties.inertia), size)


def prism(sides: int, radius: float = 0.03, height: float = 0.08) -> trimesh.Trimesh:
    return create.cylinder(radius, height, sections=sides)


def tetrahedron() -> trimesh.Trimesh:
    corners = 0.03 * np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
    return trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]], process=False)


# Name: the shape, the orders that are found, the number of rotations they generate.
KNOWN = {
    "box": (create.box((0.05, 0.08, 0.12)), [2, 2, 2], 4),
    "cube": (cube(), [4] * 3 + [3] * 4 + [2] * 6, 24),
    "square_prism": (create.box((0.06, 0.06, 0.1)), [4] + [2] * 4, 8),
    "triangular_prism": (prism(3), [3] + [2] * 3, 6),
    "pentagonal_prism": (prism(5), [5] + [2] * 5, 10),
    "hexagonal_prism": (prism(6), [6] + [2] * 6, 12),
    "octagonal_prism": (prism(8), [8] + [2] * 8, 16),
    "seven_sides_and_equal_moments": (prism(7, 0.03, 0.05), [7] + [2] * 7, 14),
    "eleven_sides_and_equal_moments": (create.cone(0.03, 0.06, sections=11), [11], 11),
    "sheet": (create.box((0.2, 0.15, 0.0002)), [2, 2, 2], 4),  # thinner than the grid's spacing
    "disc": (create.cylinder(0.05, 0.0002), [0, 2], 2),
    "needle": (create.box((0.002, 0.003, 0.3)), [2, 2, 2], 4),
    "pyramid": (create.cone(0.03, 0.08, sections=4), [4], 4),
    "tetrahedron": (tetrahedron(), [3] * 4 + [2] * 3, 12),
    "icosahedron": (create.icosahedron().apply_scale(0.03), [5] * 6 + [3] * 10 + [2] * 15, 60),
    "cylinder": (prism(64), [0, 2], 2),
    "cylinder_with_equal_moments": (prism(64, 0.03, 0.03 * np.sqrt(3)), [0, 2], 2),
    "cone": (create.cone(0.03, 0.08, sections=64), [0], 1),
    "capsule": (create.capsule(0.06, 0.02), [0, 2], 2),
    "torus": (create.torus(0.04, 0.015, major_sections=64), [0, 2], 2),
    "ball": (ball(), [0, 0, 0], 1),
    "boxes": (shape_poor_in_symmetry(), [], 1),
    "can_with_a_handle": (
        trimesh.boolean.union(
            [
                prism(64),
                create.box((0.02, 0.01, 0.04), transform=trimesh.transformations.translation_matrix((0.035, 0, 0))),
            ],
            engine="manifold",
        ),
        [2],
        2,
    ),
}


@pytest.mark.parametrize(("mesh", "orders", "count"), KNOWN.values(), ids=KNOWN)
def test_symmetries_of_known_shapes(mesh: trimesh.Trimesh, orders: list[int], count: int) -> None:
    found = symmetries_of(mesh)
    assert [symmetry.order for symmetry in found] == orders
    assert len(symmetry_group(found)) == count
    for symmetry in found:
        np.testing.assert_allclose(np.cross(symmetry.point - mesh.center_mass, symmetry.axis), 0.0, atol=1e-6)


@pytest.mark.parametrize("name", ["box", "cube", "hexagonal_prism", "cylinder", "cone"])
@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=3)
def test_axes_turn_with_the_mesh_and_map_it_onto_itself(name: str, seed: int) -> None:
    mesh, orders, count = KNOWN[name]
    X = random_pose(np.random.default_rng(seed))
    moved = mesh.copy().apply_transform(X)
    found = symmetries_of(moved)
    assert [symmetry.order for symmetry in found] == orders
    group = symmetry_group(found)
    assert len(group) == count
    surface = trimesh.sample.sample_surface(moved, 300, seed=0)[0]
    turned = transform_points(group, surface).reshape(-1, 3)
    assert distance_to(moved, turned).max() < 0.004 * float(np.linalg.norm(mesh.extents))
    if orders[0] == 0:
        assert abs(found[0].axis @ X[:3, :3] @ Z) > np.cos(np.radians(0.5))


def distance_to(mesh: trimesh.Trimesh, points: np.ndarray) -> np.ndarray:
    best = np.full(len(points), np.inf)
    for triangle in mesh.triangles:
        closest = trimesh.triangles.closest_point(np.broadcast_to(triangle, (len(points), 3, 3)), points)
        best = np.minimum(best, np.linalg.norm(closest - points, axis=1))
    return best


def test_the_tolerance_decides_what_counts() -> None:
    almost = create.box((0.06, 0.0622, 0.1))  # a quarter turn moves its sides by 1.1 mm, 0.8 % of its size
    assert [s.order for s in symmetries_of(almost, tolerance=0.005)] == [2, 2, 2]
    assert symmetries_of(almost, tolerance=0.012)[0].order == 4


def test_a_small_feature_breaks_the_symmetry() -> None:
    # 2 % of the surface, but five tolerances off.
    bump = create.box((0.012, 0.008, 0.008), transform=trimesh.transformations.translation_matrix((0.0, 0.031, 0.02)))
    bottle = trimesh.boolean.union([prism(64), bump], engine="manifold")
    assert symmetries_of(bottle) == ()


def test_a_thin_rod_is_judged_by_its_thickness() -> None:
    assert symmetries_of(prism(6, 0.0035, 0.18))[0].order == 6
    oval = prism(64, 0.0035, 0.18).apply_scale([1.0, 1.07, 1.0])  # off by 0.14 % of the length
    assert [s.order for s in symmetries_of(oval)] == [2, 2, 2]


def test_normals_count_where_distances_do_not() -> None:
    knurled = prism(72)
    crest = np.round(np.arctan2(knurled.vertices[:, 1], knurled.vertices[:, 0]) / (np.pi / 36)).astype(int) % 2 == 0
    scale = np.where(crest, 1.0, 0.97)
    knurled.vertices[:, :2] *= scale[:, None]
    assert symmetries_of(knurled, tolerance=0.02)[0].order == 18  # of 36
    assert symmetries_of(prism(72), tolerance=0.02)[0].order == 0


def test_separate_bodies_are_turned_as_one() -> None:
    pair = joined(cube(0.03, (0.03, 0.0, 0.0)), cube(0.03, (-0.03, 0.0, 0.0)))
    assert sorted(s.order for s in symmetries_of(pair)) == [2, 2, 2, 2, 4]


@pytest.mark.parametrize("sides", [13, 15, 20])
def test_axes_of_high_order_are_found(sides: int) -> None:
    fluted = prism(2 * sides)
    crest = np.round(np.arctan2(fluted.vertices[:, 1], fluted.vertices[:, 0]) / (np.pi / sides)).astype(int) % 2 == 0
    fluted.vertices[:, :2] *= np.where(crest, 1.0, 0.9)[:, None] * (1.0 - 2.0 * fluted.vertices[:, 2:])
    assert [symmetry.order for symmetry in symmetries_of(fluted)] == [sides]


def test_turns_that_are_made_of_others_count_for_themselves() -> None:
    # Two flips within the tolerance, of the teeth and of the square hole, would make turns of 80 degrees.
    gear = create.cylinder(0.03, 0.02, sections=18 * 8)
    tooth = np.floor(np.arctan2(gear.vertices[:, 1], gear.vertices[:, 0]) / (2.0 * np.pi / 18) * 2.0 + 1e-6) % 2 == 0
    gear.vertices[:, :2] *= np.where(tooth, 1.0, 0.94)[:, None]
    gear = trimesh.boolean.difference([gear, create.box((0.014, 0.014, 0.06))], engine="manifold")
    group = symmetry_group(symmetries_of(gear))
    surface = trimesh.sample.sample_surface(gear, 300, seed=0)[0]
    moved = transform_points(group, surface).reshape(-1, 3)
    assert len(group) <= 4
    assert distance_to(gear, moved).max() < 0.004 * float(np.linalg.norm(gear.extents))


def test_no_order_beyond_the_highest_is_looked_for() -> None:
    found = symmetries_of(prism(6), highest_order=5)
    assert [symmetry.order for symmetry in found[:2]] == [3, 2]


def test_a_scan_of_a_can_is_nearly_unchanged_by_turns() -> None:
    X = random_pose(np.random.default_rng(3))
    assert not any(symmetry.is_continuous for symmetry in symmetries_of(scanned_can()))
    for mesh, axis in ((scanned_can(), Z), (scanned_can().apply_transform(X), X[:3, :3] @ Z)):
        (near,) = near_symmetries_of(mesh)
        assert near.is_continuous
        assert abs(near.axis @ axis) > np.cos(np.radians(1.0))
        np.testing.assert_allclose(near.point, mesh.center_mass, atol=1e-6)


def test_an_uneven_ball_is_nearly_unchanged_by_any_turn() -> None:
    uneven = ball()
    uneven.vertices *= [1.04, 1.02, 1.0]
    assert not any(symmetry.is_continuous for symmetry in symmetries_of(uneven))
    assert len(near_symmetries_of(uneven)) == 3


NOT_NEARLY = {
    "cylinder": prism(64),  # it is unchanged exactly
    "hexagonal_prism": prism(6),
    "pencil": prism(6, 0.0035, 0.18),  # off by less than a contact's error, but as it is meant to be
    "can_off_round_by_a_tenth": scanned_can(5.0),
    "can_with_a_handle": KNOWN["can_with_a_handle"][0],
    "box": KNOWN["square_prism"][0],
}


@pytest.mark.parametrize("mesh", NOT_NEARLY.values(), ids=NOT_NEARLY)
def test_what_is_meant_to_be_so_is_not_nearly_round(mesh: trimesh.Trimesh) -> None:
    assert near_symmetries_of(mesh) == ()


def noisy_nut() -> trimesh.Trimesh:
    nut = create.annulus(0.012, 0.02, 0.019, sections=6).subdivide().subdivide().subdivide()
    nut.vertices += np.random.default_rng(0).normal(scale=3e-4, size=nut.vertices.shape)
    return nut


LIKENESSES = {
    "die": (die(), 24),
    "noisy_nut": (noisy_nut(), 12),
    "box": (create.box((0.05, 0.08, 0.12)), 1),  # half turns alone, about its principal axes
    "scanned_can": (scanned_can(), 1),  # any rotation about its axis
    "ball": (ball(), 1),
    "cube": (cube(), 1),  # all are symmetries
}


@pytest.mark.parametrize(("mesh", "count"), LIKENESSES.values(), ids=LIKENESSES)
def test_likenesses_are_the_rotations_that_leave_the_object_roughly_unchanged(
    mesh: trimesh.Trimesh, count: int
) -> None:
    shape = shape_of(mesh.apply_transform(random_pose(np.random.default_rng(5))))
    likenesses = detect_likenesses(shape, detect_symmetries(shape))
    np.testing.assert_array_equal(likenesses[0], np.eye(3, 4))
    assert len(likenesses) == count
    off = np.abs(shape.grid.distance(transform_points(likenesses, shape.samples.points)))
    assert np.percentile(off, 95, axis=1).max() < 0.04 * 0.11
