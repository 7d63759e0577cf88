import numpy as np
import pytest
import trimesh
from pydrake.geometry import Meshcat, MeshcatParams

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.grasping.improvement import ImprovementMap, improvement_map
from tactopose_drake.core.grasping.quality import grasp_quality
from tactopose_drake.core.grasping.wrench_space import WrenchSpace, convex_hull
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.visualization.wrench_spaces import (
    draw_improvement,
    draw_wrench_space,
    level_colours,
    vertex_levels,
)
from tests.recording_meshcat import RecordingMeshcat

BALL = 0.03
P_OC = BALL * np.array([[1.0, 0.0, 0.0], [-0.5, 0.8, 0.33], [-0.5, -0.8, 0.33]])


@pytest.fixture(scope="module")
def ball() -> ObjectModel:
    return ObjectModel.from_mesh(trimesh.creation.icosphere(subdivisions=3, radius=BALL), spacing=0.001, samples=300)


def test_the_scale_goes_from_red_over_grey_to_blue() -> None:
    red, _, grey, _, blue = level_colours(np.array([-1.0, -0.5, 0.0, 0.5, 1.0]))
    assert red[0] > 2 * red[2]
    assert blue[2] > 2 * blue[0]
    assert np.ptp(grey) < 0.1
    assert np.all(np.diff(level_colours(np.linspace(-1, 0, 9))[:, 2]) > 0)


def test_meshcat_is_given_amounts_of_light(ball: ObjectModel, monkeypatch: pytest.MonkeyPatch) -> None:
    given: list[np.ndarray] = []
    monkeypatch.setattr(RecordingMeshcat, "SetTriangleColorMesh", lambda *told: given.append(told[-1]), raising=False)
    found = ImprovementMap(0.1, ball.samples.points, ball.samples.normals, np.full(len(ball.samples.points), 0.2))
    draw_improvement(RecordingMeshcat(), "/map", ball, found)  # type: ignore[arg-type]
    shown = level_colours(vertex_levels(ball, found))
    # An sRGB channel is about the power 1/2.2 of its light.
    np.testing.assert_allclose(given[0].T, shown**2.2, atol=0.01)


def test_a_vertex_has_the_colour_of_the_points_on_its_own_side() -> None:
    # A wall: good outside, bad inside, and the points lie nearer to each other than the vertices.
    wall = ObjectModel.from_mesh(trimesh.creation.box((0.004, 0.1, 0.1)), max_grid_bytes=4_000_000, samples=400)
    points, normals = wall.samples.points, wall.samples.normals
    found = ImprovementMap(0.1, points, normals, np.where(normals[:, 0] > 0.5, 0.2, 0.05))
    level = vertex_levels(wall, found)
    assert np.all(level[wall.vertices[:, 0] > 0] > 0.0)
    assert np.all(level[wall.vertices[:, 0] < 0] < 0.0)


def test_hulls_are_seen_from_outside() -> None:
    corners = np.random.default_rng(0).normal(size=(30, 3))
    hull = convex_hull(corners)
    assert hull is not None
    a, b, c = np.swapaxes(hull.vertices[hull.simplices], 0, 1)
    outward = np.einsum("fi,fi->f", np.cross(b - a, c - a), hull.normals)
    assert np.all(outward > 0)
    assert np.einsum("fi,fi->f", a, np.cross(b, c)).sum() / 6 == pytest.approx(hull.volume, rel=1e-6)


def test_hulls_are_as_large_as_the_scale_says(ball: ObjectModel) -> None:
    space = grasp_quality(ball, Contacts(P_OC), np.eye(3, 4), friction=0.5).space
    forces = space.projection("force")
    assert forces is not None
    for scale in (0.1, 0.3):
        meshcat = RecordingMeshcat()
        draw_wrench_space(meshcat, "/wrenches", space, scale=scale)  # type: ignore[arg-type]
        for part in ("faces", "edges"):
            vertices, *_ = meshcat.objects[f"/wrenches/forces/{part}"]  # type: ignore[misc]
            np.testing.assert_allclose(vertices.T, scale * forces.vertices)


def test_the_nearest_points_count_most_for_a_vertex(ball: ObjectModel) -> None:
    found = ImprovementMap(0.1, ball.samples.points, ball.samples.normals, 0.1 + ball.samples.points[:, 2])
    nearest = np.array([np.linalg.norm(found.p_OQ - vertex, axis=1).argmin() for vertex in ball.vertices])
    level = vertex_levels(ball, found)
    beside = np.linalg.norm(found.p_OQ[nearest] - ball.vertices, axis=1) < 3e-4
    assert np.count_nonzero(beside) > 5
    np.testing.assert_allclose(level[beside], found.level[nearest[beside]], atol=0.05)


def test_the_sum_of_the_fingers_forces_is_their_cones_sum(ball: ObjectModel) -> None:
    space = grasp_quality(ball, Contacts(P_OC), np.eye(3, 4), friction=0.5, norm="Linf").space
    together = WrenchSpace(space.primitives)
    directions = np.random.default_rng(1).normal(size=(20, 3))
    for part, columns in (("torque", slice(0, 3)), ("force", slice(3, 6))):
        wide = np.zeros((20, 6))
        wide[:, columns] = directions
        for either in (space, together):
            hull = either.projection(part)  # type: ignore[arg-type]
            assert hull is not None
            np.testing.assert_allclose((hull.vertices @ directions.T).max(axis=0), either.support(wide)[0], atol=1e-7)


def test_meshcat_takes_all_of_it(ball: ObjectModel) -> None:
    meshcat = Meshcat(MeshcatParams(host="localhost"))
    quality = grasp_quality(ball, Contacts(P_OC), np.eye(3, 4), friction=0.5)
    draw_wrench_space(meshcat, "/wrenches", quality.space)
    for part in ("forces", "torques"):
        assert meshcat.HasPath(f"/wrenches/{part}/faces")
    found = improvement_map(ball, Contacts(P_OC), np.eye(3, 4), 0, friction=0.5, edges=4, points=50)
    reachable = found.n_OQ[:, 0] > 0.0
    draw_improvement(meshcat, "/map", ball, found, reachable)
    assert meshcat.HasPath("/map/surface")
    rows = np.flatnonzero(reachable)
    assert meshcat.HasPath(f"/map/reachable/{rows[0]}")
    assert not meshcat.HasPath(f"/map/reachable/{np.flatnonzero(~reachable)[0]}")
    draw_improvement(meshcat, "/map", ball, found)
    assert not meshcat.HasPath("/map/reachable")
