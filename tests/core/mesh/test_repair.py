import re
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from tactopose_drake.core.mesh.loading import RawMesh, load_mesh
from tactopose_drake.core.mesh.repair import RepairedMesh, repair_mesh
from tactopose_drake.errors import InvalidMeshError, MeshUnitsError
from tactopose_drake.resources import model_path
from tests.core.meshes import ball, create, cube, inside_out, joined, random_pose, raw, without

CUBE, BALL = cube(), ball()


def repaired(mesh: trimesh.Trimesh) -> tuple[trimesh.Trimesh, tuple[str, ...]]:
    result = repair_mesh(raw(mesh), "thing")
    assert result.faces.dtype == np.int32
    return trimesh.Trimesh(result.vertices, result.faces, process=False), result.repairs


def soup(mesh: trimesh.Trimesh, noise: float = 0.0) -> trimesh.Trimesh:
    """Every triangle with vertices of its own."""
    corners = np.array(mesh.triangles).reshape(-1, 3)
    corners += noise * np.random.default_rng(0).uniform(-1, 1, corners.shape)
    return trimesh.Trimesh(corners, np.arange(len(corners)).reshape(-1, 3), process=False)


def with_faces(mesh: trimesh.Trimesh, faces: object) -> trimesh.Trimesh:
    return trimesh.Trimesh(mesh.vertices, faces, process=False)


def with_a_flat_face() -> trimesh.Trimesh:
    """A cube with a vertex on an edge of one face only, the gap filled by a triangle without area."""
    a, b, c = CUBE.faces[0].tolist()
    vertices = np.vstack([CUBE.vertices, CUBE.vertices[[a, b]].mean(axis=0)])
    return trimesh.Trimesh(vertices, [*CUBE.faces[1:].tolist(), [a, 8, c], [8, b, c], [a, b, 8]], process=False)


def every_seventh_turned(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    faces = np.array(mesh.faces)
    faces[::7] = faces[::7, ::-1]
    return with_faces(mesh, faces)


REPAIRABLE = {
    "sound": (BALL, ()),
    "duplicate_vertices": (soup(BALL), ()),
    "unused_vertices": (trimesh.Trimesh(np.vstack([[np.nan] * 3, BALL.vertices]), BALL.faces + 1, process=False), ()),
    "cracked": (soup(BALL, 1e-7), (r"welded cracks up to 1.4 um wide",)),
    "collapsed_faces": (
        with_faces(BALL, np.vstack([BALL.faces, [[5, 5, 9], [1, 1, 1]]])),
        ("removed 2 faces with two corners in one place",),
    ),
    "flat_faces": (with_a_flat_face(), ("removed 1 face without area",)),
    "repeated_faces": (with_faces(BALL, np.vstack([BALL.faces, BALL.faces[:5]])), ("removed 5 repeated faces",)),
    "double_sided": (
        with_faces(BALL, np.vstack([BALL.faces, BALL.faces[:, ::-1]])),
        (f"removed {len(BALL.faces)} repeated faces",),
    ),
    "partly_double_sided": (
        with_faces(BALL, np.vstack([BALL.faces, BALL.faces[:90, ::-1], BALL.faces[700:701, ::-1]])),
        ("removed 91 repeated faces",),
    ),
    "one_of_two_double_sided": (
        joined(inside_out(BALL), BALL, cube(at=(0.1, 0.0, 0.0))),
        (f"removed {len(BALL.faces)} repeated faces", "flipped 1 body", "kept 2 separate bodies as one rigid object"),
    ),
    "inside_out": (inside_out(BALL), ("flipped the mesh, turned inside out",)),
    "mixed_sides": (every_seventh_turned(BALL), (r"turned \d+ faces to show the same side as the others",)),
    "open": (without(BALL, BALL.triangles_center[:, 2] > 0.037), ("closed the open mesh. Holes: at",)),
    "touching": (
        joined(cube(), cube(at=(0.06, 0.06, 0.0))),
        ("separated bodies that touch along 1 edge$", "kept 2 separate bodies as one rigid object"),
    ),
    "touching_along_a_face": (
        joined(cube(), cube(at=(0.06, 0.0, 0.0))),
        ("separated bodies that touch along 4 edges$", "united 2 touching bodies"),
    ),
    "touching_along_a_part_of_a_face": (joined(cube(), cube(0.02, (0.04, 0.01, 0.0))), ("united 2 touching bodies",)),
    "overlapping": (joined(cube(), cube(at=(0.03, 0.02, 0.01))), ("united 2 overlapping bodies",)),
    "debris": (joined(BALL, cube(0.002, (0.1, 0, 0))), ("dropped 1 separate piece of less than 0.1 %",)),
}


@pytest.mark.parametrize(("mesh", "expected"), REPAIRABLE.values(), ids=REPAIRABLE)
def test_broken_meshes_are_repaired_and_say_so(mesh: trimesh.Trimesh, expected: tuple[str, ...]) -> None:
    solid, repairs = repaired(mesh)
    assert len(repairs) == len(expected)
    for repair, wanted in zip(repairs, expected, strict=True):
        assert re.match(wanted, repair)
    assert solid.is_watertight
    assert solid.is_winding_consistent
    assert solid.volume > 0
    assert np.all(solid.area_faces > 0)


@pytest.mark.parametrize(
    "name",
    ["duplicate_vertices", "cracked", "collapsed_faces", "repeated_faces", "double_sided", "partly_double_sided"],
)
def test_repaired_balls_are_the_ball_again(name: str) -> None:
    solid, _ = repaired(REPAIRABLE[name][0])
    assert len(solid.vertices) == len(BALL.vertices)
    assert len(solid.faces) == len(BALL.faces)
    np.testing.assert_allclose(solid.volume, BALL.volume, rtol=1e-5)


def test_walls_that_no_finger_reaches_are_left_out_and_their_cavity_weighs_nothing() -> None:
    """A hollow cube with a ball in it, that nothing holds."""
    hollow, loose = inside_out(cube(0.04)), ball(0.01)
    result = repair_mesh(raw(joined(CUBE, hollow, loose)), "thing")
    assert result.repairs == ("kept 2 separate bodies as one rigid object", "left out the walls of 1 sealed cavity")
    np.testing.assert_allclose(np.unique(np.abs(result.vertices)), [0.03])
    assert result.properties.volume == pytest.approx(CUBE.volume - 0.04**3 + loose.volume)


@pytest.mark.parametrize("side", [0.06, 0.02])
def test_no_surface_is_left_between_bodies_that_touch_along_a_face(side: float) -> None:
    solid, _ = repaired(joined(cube(), cube(side, (0.03 + side / 2, 0.0, 0.0))))
    assert solid.volume == pytest.approx(0.06**3 + side**3)
    assert solid.area == pytest.approx(6 * 0.06**2 + 4 * side**2, rel=1e-9)


@pytest.mark.parametrize("turn", range(8))
def test_parts_of_an_assembly_may_touch_anyhow(turn: int) -> None:
    places = [(0.06 * i, 0.06 * j, 0.06 * k) for i in range(2) for j in range(2) for k in range(2)]
    parts = joined(*(cube(at=place) for place in places)).apply_transform(random_pose(np.random.default_rng(turn)))
    single = trimesh.Trimesh(parts.vertices.astype(np.float32), parts.faces, process=False)
    solid, _ = repaired(single)
    assert solid.volume == pytest.approx(8 * 0.06**3, rel=1e-5)
    # Of faces that coincide but for rounding some may be left.
    assert 0.999 * 24 * 0.06**2 <= solid.area <= 1.001 * 48 * 0.06**2


def turned_band() -> trimesh.Trimesh:
    angle = np.linspace(0, 2 * np.pi, 40, endpoint=False)
    rims = []
    for side in (-0.01, 0.01):
        radius = 0.04 + side * np.cos(angle / 2)
        rims.append(np.stack([radius * np.cos(angle), radius * np.sin(angle), side * np.sin(angle / 2)], axis=1))
    faces = [[k, k + 40, k + 1] for k in range(39)] + [[k + 1, k + 40, k + 41] for k in range(39)]
    return trimesh.Trimesh(np.concatenate(rims), [*faces, [39, 79, 40], [40, 79, 0]], process=False)


def with_a_fin() -> trimesh.Trimesh:
    vertices = np.vstack([CUBE.vertices, [[0.1, 0.1, 0.1]]])
    return trimesh.Trimesh(vertices, [*CUBE.faces.tolist(), [*CUBE.faces[0][:2].tolist(), 8]], process=False)


def with_a_nan() -> trimesh.Trimesh:
    vertices = np.array(CUBE.vertices)
    vertices[3, 1] = np.nan
    return trimesh.Trimesh(vertices, CUBE.faces, process=False)


def with_a_corner_pulled_through() -> trimesh.Trimesh:
    """A tetrahedron on whose back a larger one, inside out, hangs by a neck: the whole is of positive volume."""
    vertices = np.array(BALL.vertices)
    top = vertices[:, 2] > 0.025
    vertices[top] = [0.0, 0.0, -0.14] + 0.9 * (vertices[top] - [0.0, 0.0, 0.025])
    return trimesh.Trimesh(vertices, BALL.faces, process=False)


def grid_of_cubes(side: int) -> trimesh.Trimesh:
    places = 0.05 * np.stack(np.meshgrid(*[np.arange(side)] * 3), axis=-1).reshape(-1, 3)
    small = cube(0.01)
    vertices = (small.vertices + places[:, None]).reshape(-1, 3)
    return trimesh.Trimesh(
        vertices, (small.faces + 8 * np.arange(len(places))[:, None, None]).reshape(-1, 3), process=False
    )


REFUSED = {
    "empty": (trimesh.Trimesh(), "thing must have faces, but is empty, cut short, or made of points alone"),
    "nan": (with_a_nan(), r"thing must have vertices of finite numbers, not of \[.*nan.*\] as vertex 3"),
    "index": (
        with_faces(CUBE, [[0, 1, 99]]),
        r"thing must have faces of vertex numbers from 0 to 7, not of \[0, 1, 99\] as face 0",
    ),
    "point": (
        trimesh.Trimesh(np.zeros((3, 3)), [[0, 1, 2]], process=False),
        "thing must enclose a volume, but is a single point",
    ),
    "collapsed": (
        with_faces(CUBE, [[0, 0, 1], [1, 2, 2]]),
        "thing must have faces with an area, but all are degenerate",
    ),
    "flat": (create.box((0.1, 0.1, 1e-9)), "thing must enclose a volume, but is flat"),
    "sheet": (
        without(CUBE, CUBE.face_normals[:, 2] < 0.9),
        "thing must enclose a volume, but of its \\d+ pieces? none does",
    ),
    "pipe": (without(CUBE, np.abs(CUBE.face_normals[:, 2]) > 0.9), "thing is open, and inside cannot be told"),
    "fin": (with_a_fin(), r"thing must be manifold, .*, not with 3 faces that share the edge at \[.*\] m"),
    "one_sided": (turned_band(), "thing must have an inside, not only one side"),
    "far": (
        cube(at=(1e4, 0, 0)),
        r"thing must lie at most 20 times its size from .*, not 9.62e\+04 times, 1e\+04 m",
    ),
    "through_itself": (with_a_corner_pulled_through(), "thing must not pass through itself.* are those of no body"),
    "too_many_bodies": (grid_of_cubes(18), "thing must have at most 5000 separate bodies, not 5832"),
}


@pytest.mark.parametrize(("mesh", "message"), REFUSED.values(), ids=REFUSED)
def test_hopeless_meshes_are_refused(mesh: trimesh.Trimesh, message: str) -> None:
    with pytest.raises(InvalidMeshError, match=message):
        repair_mesh(raw(mesh), "thing")


@pytest.mark.parametrize(
    ("scale", "message"),
    [
        (1000.0, r"must have a diagonal from 0.002 to 3 m, not 104 m; it measures 60 x 60 x 60 m. Scale it by 0.001"),
        (0.01, r"not 0.00104 m; it measures 0.0006 x .* Scale it by 1000"),
    ],
)
def test_other_units_are_named(scale: float, message: str) -> None:
    with pytest.raises(MeshUnitsError, match=message):
        repair_mesh(RawMesh(np.array(CUBE.vertices) * scale, np.array(CUBE.faces)), "thing")


def test_a_thousand_equal_balls_are_no_debris() -> None:
    small = ball(0.002, 0)
    places = 0.01 * np.stack(np.meshgrid(*[np.arange(11)] * 3), axis=-1).reshape(-1, 3)
    vertices = (small.vertices + places[:, None]).reshape(-1, 3)
    faces = (small.faces + len(small.vertices) * np.arange(len(places))[:, None, None]).reshape(-1, 3)
    solid, repairs = repaired(trimesh.Trimesh(vertices, faces, process=False))
    assert repairs == ("kept 1331 separate bodies as one rigid object",)
    np.testing.assert_allclose(solid.volume, 1331 * small.volume)


def test_equal_open_balls_are_no_debris() -> None:
    small = ball(0.002, 1)
    small = without(small, small.triangles_center[:, 2] > 0.0018)
    places = 0.01 * np.stack(np.meshgrid(*[np.arange(11)] * 3), axis=-1).reshape(-1, 3)
    vertices = (small.vertices + places[:, None]).reshape(-1, 3)
    faces = (small.faces + len(small.vertices) * np.arange(len(places))[:, None, None]).reshape(-1, 3)
    solid, repairs = repaired(trimesh.Trimesh(vertices, faces, process=False))
    assert repairs[-1] == "kept 1331 separate bodies as one rigid object"
    assert solid.body_count == 1331


@pytest.mark.parametrize("scale", [1e30, 1e155, 1e300])
def test_numbers_beyond_all_measure_are_refused_without_a_warning(scale: float) -> None:
    with pytest.raises(MeshUnitsError, match="diagonal"):
        repair_mesh(RawMesh(np.array(CUBE.vertices) * scale, np.array(CUBE.faces)), "thing")


def test_a_heap_of_vertices_is_not_searched_for_cracks() -> None:
    generator = np.random.default_rng(0)
    heap = 1e-6 * generator.random((9_000, 3))
    opened = without(BALL, BALL.triangles_center[:, 2] > 0.037)
    faces = np.vstack([opened.faces, len(BALL.vertices) + np.arange(9_000).reshape(-1, 3)])
    mesh = trimesh.Trimesh(np.vstack([BALL.vertices, heap]), faces, process=False)
    tracemalloc.start()
    repaired(mesh)
    assert tracemalloc.get_traced_memory()[1] < 200 * 2**20
    tracemalloc.stop()


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=10)
def test_repairs_do_not_depend_on_pose_or_order(seed: int) -> None:
    generator = np.random.default_rng(seed)
    mesh = joined(
        cube(), inside_out(cube(0.01)), cube(at=(0.05, 0.02, 0.01)), ball(0.02).apply_translation((0.2, 0, 0))
    )
    still, stated = repaired(mesh)
    shuffled = soup(with_faces(mesh, generator.permutation(mesh.faces))).apply_transform(random_pose(generator))
    moved, stated_moved = repaired(shuffled)
    assert stated == stated_moved
    np.testing.assert_allclose(moved.volume, still.volume, rtol=1e-9)
    np.testing.assert_allclose(moved.area, still.area, rtol=1e-6)


@pytest.mark.parametrize("path", sorted(model_path("objects").glob("*.obj")), ids=lambda path: path.stem)
def test_shipped_objects_need_no_repair(path: Path) -> None:
    result = repair_mesh(load_mesh(path), path.stem)
    assert isinstance(result, RepairedMesh)
    assert result.repairs == ()


def test_a_mesh_may_lie_some_sizes_from_the_origin() -> None:
    size = float(np.linalg.norm(CUBE.extents))
    solid, repairs = repaired(cube(at=(0.0, 19.9 * size, 0.0)))
    assert repairs == ()
    np.testing.assert_allclose(solid.bounds.mean(axis=0), [0.0, 19.9 * size, 0.0], atol=1e-12)
    with pytest.raises(InvalidMeshError, match=r"must lie at most 20 times its size .*, not 20\.1 times"):
        repaired(cube(at=(0.0, 20.1 * size, 0.0)))
