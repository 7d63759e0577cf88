import numpy as np
import pytest
import trimesh

from tactopose_drake.core.mesh.holes import HoleParams, close_holes
from tactopose_drake.errors import InvalidMeshError
from tests.core.meshes import ball, create, cube, inside_out, joined, without

BALL = ball(subdivisions=4)
CUBE = cube()
CYLINDER = create.cylinder(0.03, 0.1)


def closed(mesh: trimesh.Trimesh, **params: float) -> tuple[trimesh.Trimesh, list[str]]:
    repairs: list[str] = []
    size = float(np.linalg.norm(mesh.extents))
    vertices, faces = close_holes(np.array(mesh.vertices), np.array(mesh.faces), size, repairs, HoleParams(**params))
    return trimesh.Trimesh(vertices, faces, process=False), repairs


def ball_below(height: float) -> trimesh.Trimesh:
    mesh = without(BALL, BALL.triangles_center[:, 2] > height)
    mesh.remove_unreferenced_vertices()
    return mesh


CLOSABLE = {
    "ball_with_a_hole": (ball_below(0.035), BALL.volume, 2e-2),
    "half_a_ball": (ball_below(0.0), 0.5 * BALL.volume, 3e-2),
    "cube_without_a_side": (without(CUBE, CUBE.face_normals[:, 2] > 0.9), CUBE.volume, 1e-9),
    "inside_out": (inside_out(ball_below(0.035)), -BALL.volume, 2e-2),
}


@pytest.mark.parametrize(("mesh", "volume", "tolerance"), CLOSABLE.values(), ids=CLOSABLE)
def test_a_hole_is_closed_where_the_inside_can_be_told(mesh: trimesh.Trimesh, volume: float, tolerance: float) -> None:
    solid, (repair,) = closed(mesh)
    assert solid.is_watertight
    assert repair.startswith("closed the open mesh. Holes: at [")
    np.testing.assert_allclose(solid.volume, volume, rtol=tolerance)


def test_the_hole_s_place_and_size_are_stated() -> None:
    _, (repair,) = closed(without(CUBE, CUBE.face_normals[:, 2] > 0.9))
    assert repair == "closed the open mesh. Holes: at [0.0, 0.0, 0.03] m, 84.9 mm across, rim of 4 edges"


def test_a_hole_is_no_wider_than_what_it_is_in() -> None:
    # Two triangles of two sides: the middle of the rim is not halfway between two of its vertices.
    box = trimesh.creation.box([0.04, 0.06, 0.1])
    _, (repair,) = closed(without(box, np.arange(12) < 2))
    assert "123 mm across, rim of 4 edges" in repair


OPEN = {
    "tube": without(CUBE, np.abs(CUBE.face_normals[:, 2]) > 0.9),
    "corner": without(CUBE, (CUBE.face_normals[:, 2] > 0.9) | (CUBE.face_normals[:, 1] > 0.9)),
    "pipe": without(CYLINDER, np.abs(CYLINDER.face_normals[:, 2]) > 0.9),
}


@pytest.mark.parametrize("mesh", OPEN.values(), ids=OPEN)
@pytest.mark.parametrize("turned", [False, True])
def test_what_may_be_a_pipe_is_refused_with_its_holes(mesh: trimesh.Trimesh, turned: bool) -> None:
    mesh = inside_out(mesh) if turned else mesh
    with pytest.raises(
        InvalidMeshError,
        match=r"is open, .* must agree on at least \d+ % of the surface, not \d+ %\. Holes: at \[.* mm across",
    ):
        closed(mesh)
    solid, _ = closed(mesh, agreement=0.1)
    assert solid.is_watertight


def test_what_a_refusal_states_is_less_than_what_it_asks_for() -> None:
    tattered = without(BALL, np.random.default_rng(0).random(len(BALL.faces)) < 0.06)
    with pytest.raises(InvalidMeshError, match="must agree on at least 98 % of the surface, not 97 %"):
        closed(tattered)


@pytest.mark.parametrize("turned", [False, True])
def test_sheets_are_refused(turned: bool) -> None:
    sheet = trimesh.Trimesh([[0, 0, 0], [0.1, 0, 0], [0.1, 0.1, 0], [0, 0.1, 0]], [[0, 1, 2], [0, 2, 3]], process=False)
    with pytest.raises(InvalidMeshError, match="must enclose a volume, but of its 1 piece none does"):
        closed(inside_out(sheet) if turned else sheet)


def test_loose_sheets_beside_a_body_are_dropped() -> None:
    sheet = trimesh.Trimesh([[0, 0, 0.05], [0.1, 0, 0.05], [0.1, 0.1, 0.05]], [[0, 1, 2]], process=False)
    solid, repairs = closed(joined(BALL, sheet))
    assert repairs == ["dropped 1 open piece around less than 0.1 % of the volume"]
    assert len(solid.faces) == len(BALL.faces)


def test_an_edge_that_meets_a_vertex_midway_is_no_hole() -> None:
    a, b, c = CUBE.faces[0]
    vertices = np.vstack([CUBE.vertices, CUBE.vertices[[a, b]].mean(axis=0)])
    split = trimesh.Trimesh(vertices, [*CUBE.faces[1:].tolist(), [a, 8, c], [8, b, c]], process=False)
    solid, repairs = closed(split)
    assert repairs == ["closed 1 crack without area, where an edge meets a vertex midway"]
    np.testing.assert_allclose(solid.volume, CUBE.volume)


def test_many_holes_are_counted() -> None:
    generator = np.random.default_rng(0)
    mesh = without(BALL, generator.random(len(BALL.faces)) < 0.01)
    solid, (repair,) = closed(mesh)
    assert solid.is_watertight
    assert "smaller" in repair
    np.testing.assert_allclose(solid.volume, BALL.volume, rtol=1e-3)


def test_closed_meshes_are_left_as_they_are() -> None:
    solid, repairs = closed(BALL)
    assert not repairs
    np.testing.assert_array_equal(solid.faces, BALL.faces)
