import numpy as np
import pytest
import scipy.optimize
import trimesh
from pydrake.geometry import (
    Box,
    Capsule,
    Cylinder,
    Ellipsoid,
    FramePoseVector,
    GeometryFrame,
    GeometryInstance,
    ProximityProperties,
    Role,
    SceneGraph,
    Shape,
    Sphere,
)
from pydrake.math import RigidTransform
from scipy.spatial.transform import Rotation

from tactopose_drake.core.poses import compose, make_poses, random_rotations
from tactopose_drake.core.shape import ConvexShape, build_tree, join_shapes
from tactopose_drake.core.shape.convex_shape_kernels import find_deepest
from tactopose_drake.core.validation import FloatArray

TOLERANCE = 2e-5  # m
FINE = 1e-6  # m, a tolerance that stands for none
ROUNDING = 1e-12  # m


def hull_of(mesh: trimesh.Trimesh) -> ConvexShape:
    return ConvexShape.hull(mesh.face_normals, np.einsum("ij,ij->i", mesh.face_normals, mesh.triangles_center))


def pyramid() -> trimesh.Trimesh:
    """The mean of its vertices is nowhere near its deepest point."""
    base = [[0.02, 0.02, 0], [-0.02, 0.02, 0], [-0.02, -0.02, 0], [0.02, -0.02, 0]]
    return trimesh.Trimesh([*base, [0.0, 0.0, 0.08]], []).convex_hull


SHAPES = {
    "ball": ConvexShape.capsule(0.01, 0.0),
    "capsule": ConvexShape.capsule(0.009, 0.03),
    "cylinder": ConvexShape.cylinder(0.01, 0.03),
    "flat cylinder": ConvexShape.cylinder(0.02, 0.006),
    "box": ConvexShape.box(np.array([0.03, 0.02, 0.04])),
    "ellipsoid": ConvexShape.ellipsoid(np.array([0.01, 0.008, 0.02])),
    "pyramid": hull_of(pyramid()),
    "hull of 320 planes": hull_of(trimesh.creation.icosphere(2, 0.01)),
}
every_shape = pytest.mark.parametrize("shape", SHAPES.values(), ids=SHAPES)


def drake_distances(shape: Shape, p_GQ: FloatArray) -> FloatArray:
    scene_graph = SceneGraph()
    source = scene_graph.RegisterSource("test")
    frame = scene_graph.RegisterFrame(source, GeometryFrame("shape"))
    geometry = scene_graph.RegisterGeometry(source, frame, GeometryInstance(RigidTransform(), shape, "shape"))
    scene_graph.AssignRole(source, geometry, ProximityProperties())
    assert scene_graph.model_inspector().NumGeometriesWithRole(Role.kProximity) == 1
    context = scene_graph.CreateDefaultContext()
    poses = FramePoseVector()
    poses.set_value(frame, RigidTransform())
    scene_graph.get_source_pose_port(source).FixValue(context, poses)
    query = scene_graph.get_query_output_port().Eval(context)
    return np.array([query.ComputeSignedDistanceToPoint(p)[0].distance for p in p_GQ])


@pytest.mark.parametrize(
    ("shape", "of_drake", "is_distance_outside"),
    [
        (SHAPES["ball"], Sphere(0.01), True),
        (SHAPES["capsule"], Capsule(0.009, 0.03), True),
        (SHAPES["cylinder"], Cylinder(0.01, 0.03), False),
        (SHAPES["flat cylinder"], Cylinder(0.02, 0.006), False),
        (SHAPES["box"], Box(0.03, 0.02, 0.04), False),
        (SHAPES["ellipsoid"], Ellipsoid(0.01, 0.008, 0.02), True),
    ],
)
def test_depths_are_the_signed_distances_of_drake(
    shape: ConvexShape, of_drake: Shape, is_distance_outside: bool
) -> None:
    points = np.random.default_rng(0).uniform(-0.03, 0.03, (500, 3))
    depth, drake = shape.depths(points), -drake_distances(of_drake, points)
    same = drake >= 0.0 if not is_distance_outside else np.full(500, True)
    assert same.sum() > 10
    # Of an ellipsoid Drake's are iterated to 0.1 mm.
    np.testing.assert_allclose(depth[same], drake[same], atol=1e-4 if isinstance(of_drake, Ellipsoid) else 1e-12)
    assert np.all((depth < 0.0) == (drake < 0.0))
    assert np.all(depth >= drake - 1e-4)


ELLIPSOIDS = {
    "of three axes": (0.01, 0.008, 0.02),
    "prolate": (0.01, 0.01, 0.02),
    "oblate": (0.01, 0.02, 0.02),
    "ball": (0.01, 0.01, 0.01),
    "nearly a ball": (0.01, 0.01 * (1 + 1e-12), 0.01 * (1 - 1e-15)),
    "needle": (1e-4, 2e-4, 0.1),
    "pancake": (0.1, 0.07, 1e-4),
}


def least_distance(semi_axes: FloatArray, p: FloatArray) -> float:
    """To points of the ellipsoid's surface, in the point's octant, by minimisation over two angles."""

    def distance(angles: FloatArray) -> float:
        (st, sf), (ct, cf) = np.sin(angles), np.cos(angles)
        return float(np.linalg.norm(semi_axes * [st * cf, st * sf, ct] - np.abs(p)))

    grid = np.linspace(0.0, 0.5 * np.pi, 25)
    starts = sorted(((a, b) for a in grid for b in grid), key=lambda angles: distance(np.array(angles)))[:6]
    options = {"xatol": 1e-11, "fatol": 1e-15}
    found = [scipy.optimize.minimize(distance, a, method="Nelder-Mead", options=options) for a in starts]
    return min(float(each.fun) for each in found)


@pytest.mark.parametrize("name", ELLIPSOIDS)
def test_an_ellipsoids_depth_is_the_least_distance_to_its_surface(name: str) -> None:
    """Within and without, on axes and in planes of symmetry, and where rounding has left a point beside these."""
    semi_axes = np.array(ELLIPSOIDS[name])
    generator = np.random.default_rng(3)
    directions = generator.normal(size=(24, 3))
    points = semi_axes * directions / np.linalg.norm(directions, axis=1)[:, None]
    points *= generator.uniform(0.1, 1.6, (24, 1))
    residue = generator.choice([0.0, 1e-18, -1e-17, 1e-20, 1e-30, 1e-9], (24, 3))
    points = np.where(generator.random((24, 3)) < 0.4, residue, points)
    inside = ((points / semi_axes) ** 2).sum(axis=1) < 1.0
    expected = [least_distance(semi_axes, p) for p in points]
    depth = ConvexShape.ellipsoid(semi_axes).depths(points)
    np.testing.assert_allclose(depth, np.where(inside, expected, -np.array(expected)), atol=1e-7)


@pytest.mark.parametrize("name", ELLIPSOIDS)
@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("beside", [0.0, 1e-200, 1e-30, 1e-19, 6e-19, 1e-17, -1e-15])
def test_an_ellipsoid_is_as_deep_about_its_middle_as_its_least_semi_axis(name: str, axis: int, beside: float) -> None:
    semi_axes = np.array(ELLIPSOIDS[name])
    point = np.eye(3)[axis] * beside
    depth = ConvexShape.ellipsoid(semi_axes).depths(point[None])[0]
    assert depth == pytest.approx(min(semi_axes), abs=1e-12)


@every_shape
def test_depths_are_concave_and_change_no_faster_than_the_point(shape: ConvexShape) -> None:
    generator = np.random.default_rng(4)
    p, q = generator.uniform(-0.04, 0.04, (2, 3000, 3))
    share = generator.random((3000, 1))
    along = share * p + (1.0 - share) * q
    at_p, at_q = shape.depths(p), shape.depths(q)
    assert np.all(shape.depths(along) >= share[:, 0] * at_p + (1.0 - share[:, 0]) * at_q - ROUNDING)
    assert np.all(np.abs(at_p - at_q) <= np.linalg.norm(p - q, axis=1) + ROUNDING)


@every_shape
def test_no_point_is_deeper_than_the_deepest(shape: ConvexShape) -> None:
    deepest = shape.shapes.deepest
    most = shape.depths(deepest)[0]
    assert most > 0.0
    around = np.random.default_rng(5).normal(size=(4000, 3)) * np.geomspace(1e-6, 0.03, 4000)[:, None]
    assert shape.depths(deepest + around).max() <= most + ROUNDING


def test_the_deepest_point_of_a_hull_is_the_middle_of_the_largest_ball_within() -> None:
    # Of the section through the pyramid's axis, across two sides.
    leg = np.hypot(0.02, 0.08)
    np.testing.assert_allclose(SHAPES["pyramid"].shapes.deepest[0], [0, 0, 0.02 * 0.08 / (0.02 + leg)], atol=1e-9)


def deepest_of(
    mesh: trimesh.Trimesh,
    shapes: list[ConvexShape],
    X_GO: FloatArray,
    tolerance: float = TOLERANCE,
    enough: float = np.inf,
) -> tuple[FloatArray, np.ndarray]:
    """By poses (b, s, 3, 4)."""
    depth, which = np.full(len(X_GO), np.nan), np.full(len(X_GO), -1, dtype=np.int64)
    tree = build_tree(np.asarray(mesh.vertices), np.asarray(mesh.faces))
    find_deepest(tree, join_shapes(shapes), np.ascontiguousarray(X_GO), tolerance, enough, depth, which)
    return depth, which


def sampled_depth(mesh: trimesh.Trimesh, shape: ConvexShape, X_GO: FloatArray) -> float:
    """By points of each triangle, ever closer to its best one, and the deepest point of the shape, if within."""
    triangles = mesh.triangles @ X_GO[:, :3].T + X_GO[:, 3]
    middle = triangles.mean(axis=1)
    reach = shape.depths(middle) + np.linalg.norm(triangles - middle[:, None], axis=2).max(axis=1)
    found = shape.depths(np.concatenate([middle, triangles.reshape(-1, 3)])).max()
    triangles = triangles[reach >= min(reach.max(), found)]
    generator, weights = np.random.default_rng(6), np.full((len(triangles), 3), 1.0 / 3.0)
    for size in np.geomspace(1.0, 1e-4, 60):
        tried = (1.0 - size) * weights[:, None] + size * generator.dirichlet(np.full(3, 0.7), (len(triangles), 20))
        tried = np.concatenate([weights[:, None], tried], axis=1)
        depths = shape.depths(np.einsum("fkj,fji->fki", tried, triangles).reshape(-1, 3)).reshape(len(triangles), -1)
        weights = tried[np.arange(len(triangles)), depths.argmax(axis=1)]
    depth = depths.max()
    p_OD = (shape.shapes.deepest[0] - X_GO[:, 3]) @ X_GO[:, :3]
    vertices = mesh.triangles - p_OD
    norms = np.linalg.norm(vertices, axis=2)
    pairs = [np.einsum("fi,fi->f", vertices[:, i], vertices[:, (i + 1) % 3]) * norms[:, (i + 2) % 3] for i in range(3)]
    angles = 2.0 * np.arctan2(np.linalg.det(vertices), norms.prod(axis=1) + sum(pairs))
    if angles.sum() > 2.0 * np.pi:  # of 4 pi: the winding number is one
        depth = max(depth, shape.depths(shape.shapes.deepest)[0])
    return float(max(0.0, depth))


def sliver() -> trimesh.Trimesh:
    """A tetrahedron 0.2 m long and 10 um thick."""
    return trimesh.Trimesh([[-0.1, 0, 0], [0.1, 0, 0], [0, 1e-5, 0], [0, 0, 1e-5]], []).convex_hull


MESHES = {
    "large triangles": trimesh.creation.box((0.3, 0.2, 0.01)),
    "small": trimesh.creation.icosphere(1, 0.002),
    "of a metre": trimesh.creation.icosphere(2, 1.0),
    "slivers": trimesh.creation.cylinder(0.002, 0.2, sections=64),
    "one sliver": sliver(),
    "ring": trimesh.creation.torus(0.02, 0.004, major_sections=24, minor_sections=12),
    "fine": trimesh.creation.icosphere(4, 0.02),
}


@every_shape
@pytest.mark.parametrize("name", MESHES)
def test_the_deepest_point_of_a_mesh_is_no_deeper_than_it_is_nor_short_by_more_than_the_tolerance(
    shape: ConvexShape, name: str
) -> None:
    mesh = MESHES[name]
    generator = np.random.default_rng(7)
    # A point of the mesh is laid anywhere about the shape.
    most = shape.depths(shape.shapes.deepest)[0]
    R_GO, place = random_rotations(generator, 3), shape.shapes.deepest + 0.5 * most * generator.normal(size=(3, 3))
    p_OQ = mesh.triangles_center[generator.integers(0, len(mesh.faces), 3)]
    X_GO = make_poses(R_GO, place - np.einsum("bij,bj->bi", R_GO, p_OQ))
    found, _ = deepest_of(mesh, [shape], X_GO[:, None])
    exact, _ = deepest_of(mesh, [shape], X_GO[:, None], tolerance=FINE)
    sampled = np.array([sampled_depth(mesh, shape, X) for X in X_GO])
    assert np.any(sampled > 0.0)
    assert np.all(found <= exact + FINE)
    assert np.all(found >= exact - TOLERANCE)
    assert np.all(exact >= sampled - FINE)
    assert np.all(exact <= sampled + 1e-3)  # which now and then stop short


@every_shape
def test_a_mesh_far_from_its_origin_is_as_deep_but_for_rounding(shape: ConvexShape) -> None:
    mesh, far = MESHES["ring"], np.array([300.0, -200.0, 100.0])
    R = random_rotations(np.random.default_rng(8), 6)
    X_GO = make_poses(R, -R @ np.array([0.02, 0.0, 0.0]))
    moved = trimesh.Trimesh(mesh.vertices + far, mesh.faces, process=False)
    near, _ = deepest_of(mesh, [shape], X_GO[:, None], tolerance=FINE)
    beyond, _ = deepest_of(moved, [shape], make_poses(R, X_GO[:, :, 3] - R @ far)[:, None], tolerance=FINE)
    np.testing.assert_allclose(beyond, near, atol=FINE)


@pytest.mark.parametrize("count", [1, 2, 3, 4, 5, 7, 8, 9, 17, 33])
def test_any_number_of_triangles_makes_a_tree(count: int) -> None:
    generator = np.random.default_rng(count)
    triangles = generator.uniform(-0.02, 0.02, (count, 1, 3)) + generator.normal(0.0, 0.004, (count, 3, 3))
    mesh = trimesh.Trimesh(triangles.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3), process=False)
    tree = build_tree(np.asarray(mesh.vertices), np.asarray(mesh.faces))
    kept = tree.triangles.reshape(-1, 3, 3)
    areas = np.linalg.norm(np.cross(kept[:, 1] - kept[:, 0], kept[:, 2] - kept[:, 0]), axis=1)
    assert np.count_nonzero(areas) == count
    found, _ = deepest_of(mesh, [SHAPES["capsule"]], np.eye(3, 4)[None, None], tolerance=FINE)
    inside = max(0.0, *(SHAPES["capsule"].depths(triangle).max() for triangle in triangles))
    assert found[0] >= inside - FINE


def test_faces_without_area_change_nothing() -> None:
    mesh = MESHES["ring"]
    faces = np.concatenate([mesh.faces, [[0, 0, 1], [5, 5, 5], [7, 8, 7]]])
    folded = trimesh.Trimesh(mesh.vertices, faces, process=False)
    X_GO = make_poses(np.eye(3), np.array([0.018, 0.002, -0.001]))[None, None]
    for shape in SHAPES.values():
        assert deepest_of(folded, [shape], X_GO)[0] == pytest.approx(deepest_of(mesh, [shape], X_GO)[0], abs=TOLERANCE)


@every_shape
@pytest.mark.parametrize("wall", [0.001, 1e-4, 1e-6])
def test_a_shape_is_as_deep_in_a_solid_and_in_a_thin_wall_through_its_middle_as_it_is(
    shape: ConvexShape, wall: float
) -> None:
    most = shape.depths(shape.shapes.deepest)[0]
    R = Rotation.from_euler("xyz", [[0.0, 0.0, 0.0], [0.5 * np.pi, 0.0, 0.0], [0.3, 0.7, 1.1]]).as_matrix()
    X_GO = make_poses(R, np.broadcast_to(shape.shapes.deepest[0], (3, 3)))[:, None]
    for thickness in (wall, 0.3):
        plate = trimesh.creation.box((0.3, 0.3, thickness))
        assert deepest_of(plate, [shape], X_GO)[0] == pytest.approx(most, abs=ROUNDING)


@every_shape
def test_a_cavity_is_no_part_of_a_mesh(shape: ConvexShape) -> None:
    outer, inner = trimesh.creation.box((0.3, 0.3, 0.3)), trimesh.creation.box((0.2, 0.2, 0.2))
    inner.invert()
    hollow = trimesh.util.concatenate([outer, inner])
    X_GO = np.eye(3, 4)[None, None]
    assert deepest_of(outer, [shape], X_GO)[0][0] == pytest.approx(shape.depths(shape.shapes.deepest)[0])
    assert deepest_of(hollow, [shape], X_GO)[0][0] == 0.0


def placed(generator: np.random.Generator, count: int, shapes: int) -> FloatArray:
    """Poses (count, shapes, 3, 4) of an object about shapes that stand about each other."""
    X_PG = make_poses(random_rotations(generator, shapes), generator.uniform(-0.03, 0.03, (shapes, 3)))
    X_PO = make_poses(random_rotations(generator, count), generator.uniform(-0.03, 0.03, (count, 3)))
    R_GP = np.swapaxes(X_PG[:, :, :3], 1, 2)
    X_GP = make_poses(R_GP, -np.einsum("sij,sj->si", R_GP, X_PG[:, :, 3]))
    return compose(X_GP[None], X_PO[:, None])


def test_several_shapes_and_poses_are_as_deep_as_each_by_itself() -> None:
    mesh, shapes = MESHES["ring"], list(SHAPES.values())
    X_GO = placed(np.random.default_rng(9), 10, len(shapes))
    together, which = deepest_of(mesh, shapes, X_GO)
    alone = np.stack([deepest_of(mesh, [shape], X_GO[:, [s]])[0] for s, shape in enumerate(shapes)], axis=1)
    np.testing.assert_allclose(together, alone.max(axis=1), atol=TOLERANCE)
    assert np.count_nonzero(together) > 5
    for b in range(10):
        assert alone[b, which[b]] >= alone[b].max() - TOLERANCE
        own, index = deepest_of(mesh, shapes, X_GO[[b]])
        assert (own[0], index[0]) == (together[b], which[b])
    again, index = deepest_of(mesh, shapes, X_GO)
    assert np.array_equal(again, together)
    assert np.array_equal(index, which)


@pytest.mark.parametrize("enough", [0.0, 0.001, 0.004])
def test_beyond_what_is_enough_depths_are_lower_bounds(enough: float) -> None:
    mesh, shapes = MESHES["fine"], list(SHAPES.values())
    X_GO = placed(np.random.default_rng(10), 30, len(shapes))
    exact, _ = deepest_of(mesh, shapes, X_GO)
    bounded, _ = deepest_of(mesh, shapes, X_GO, enough=enough)
    assert np.array_equal(bounded > enough, exact > enough)
    np.testing.assert_array_equal(bounded[exact <= enough], exact[exact <= enough])
    assert np.all(bounded <= exact + TOLERANCE)
