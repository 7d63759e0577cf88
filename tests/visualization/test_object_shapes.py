import numpy as np
import pytest
import trimesh

from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.visualization.arrow_shapes import TURN_TIP, slide_arrow, turn_arrow
from tactopose_drake.visualization.object_shapes import simplified, smooth_mesh, wire_cage
from tests.core.models import brick


@pytest.fixture(scope="module")
def box() -> ObjectModel:
    return brick(0.06, 0.08, 0.1)


def test_the_wires_run_along_the_surface_and_reach_its_corners(box: ObjectModel) -> None:
    vertices, faces = wire_cage(box)
    thickness = 0.001
    distance, _ = box.grid.distance_and_normal(vertices)
    assert np.abs(distance).max() < thickness
    np.testing.assert_allclose(np.ptp(vertices, axis=0), [0.06, 0.08, 0.1], atol=2 * thickness)
    assert faces.min() >= 0
    assert faces.max() == len(vertices) - 1
    # They leave most of the surface free.
    cage = trimesh.Trimesh(vertices, faces, process=False)
    assert cage.area < 0.25 * trimesh.creation.box((0.06, 0.08, 0.1)).area


def test_a_thin_wall_has_one_ring_where_it_is_cut() -> None:
    solid = ObjectModel.from_mesh(trimesh.creation.cylinder(radius=0.03, height=0.1, sections=48), cache=False)
    pipe = ObjectModel.from_mesh(trimesh.creation.annulus(0.0285, 0.03, 0.1, sections=48), cache=False)
    at_height = []
    for model in (solid, pipe):
        vertices, _ = wire_cage(model)
        ring = np.abs(vertices[:, 2] - 0.26 * 0.1 + 0.05) < 0.001
        at_height.append(np.linalg.norm(vertices[ring, :2], axis=1))
    assert len(at_height[1]) > 50
    assert np.quantile(at_height[1], 0.2) > 0.029  # The outer one, but for the upright wires.


def test_a_smooth_mesh_is_parted_at_its_sharp_edges_alone(box: ObjectModel) -> None:
    vertices, faces = smooth_mesh(box)
    corners = np.unique(np.round(box.vertices, 6), axis=0)
    at_corner = np.all(np.isclose(vertices, corners[0], atol=1e-6), axis=1)
    assert np.count_nonzero(at_corner) == 3  # a corner of each of its sides
    np.testing.assert_allclose(np.sort(vertices[faces].mean(axis=(0, 1))), np.zeros(3), atol=1e-9)


@pytest.mark.parametrize("most", [500, 3000])
def test_a_large_mesh_is_simplified_to_so_many_faces(most: int) -> None:
    ball = trimesh.creation.icosphere(subdivisions=5, radius=0.05)
    vertices, faces = simplified(np.array(ball.vertices), np.array(ball.faces), most)
    assert most / 4 < len(faces) <= most
    radius = np.linalg.norm(vertices, axis=1)
    np.testing.assert_allclose(radius, 0.05, rtol=0.1)


def test_arrows_face_outwards_and_are_of_unit_size() -> None:
    for vertices, faces in (turn_arrow(), slide_arrow()):
        assert trimesh.Trimesh(vertices, faces, process=False).volume > 0.0
    radius = np.linalg.norm(turn_arrow()[0][:, :2], axis=1)
    assert 0.9 < radius.min() < radius.max() < 1.1
    assert np.ptp(slide_arrow()[0][:, 2]) == pytest.approx(1.0)
    # The tip leads the tail counterclockwise about z.
    tip, tail = np.array(TURN_TIP), np.array([1.0, 0.0, 0.0])
    assert np.cross(tail, tip)[2] > 0.9
