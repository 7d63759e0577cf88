import numpy as np
import pytest

from tactopose_drake.core.mesh.solid import DENSITY, solid_properties
from tactopose_drake.errors import InvalidMeshError
from tests.core.meshes import arrays, create, cube

SIDES = np.array([0.03, 0.05, 0.08])
INERTIA = DENSITY * SIDES.prod() * np.diag((SIDES**2).sum() - SIDES**2) / 12.0


@pytest.mark.parametrize("offset", [0.0, 0.1, 1.0, 20.0, 90.0])
def test_the_integrals_keep_their_digits_far_from_the_origin(offset: float) -> None:
    vertices, faces = arrays(create.box(SIDES))
    place = offset * np.array([0.6, -0.8, 0.0])
    properties = solid_properties(vertices + place, faces)
    assert properties.volume == pytest.approx(SIDES.prod(), rel=1e-9)
    np.testing.assert_allclose(properties.centroid, place, atol=1e-10)
    np.testing.assert_allclose(properties.inertia, INERTIA, rtol=1e-9, atol=1e-9 * INERTIA.max())


def test_a_body_that_is_no_alike_on_all_sides_turns_about_its_centroid() -> None:
    """A tetrahedron of edges a, b and c from a right corner, as tables have it."""
    a, b, c = 0.03, 0.05, 0.08
    vertices = np.array([[0.0, 0.0, 0.0], [a, 0.0, 0.0], [0.0, b, 0.0], [0.0, 0.0, c]]) + 0.02
    properties = solid_properties(vertices, np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]))
    mass = DENSITY * a * b * c / 6.0
    assert properties.volume == pytest.approx(a * b * c / 6.0)
    np.testing.assert_allclose(properties.centroid, 0.02 + np.array([a, b, c]) / 4.0)
    diagonal = 3.0 / 80.0 * mass * np.array([b**2 + c**2, a**2 + c**2, a**2 + b**2])
    products = mass / 80.0 * np.array([[0.0, a * b, a * c], [a * b, 0.0, b * c], [a * c, b * c, 0.0]])
    np.testing.assert_allclose(properties.inertia, np.diag(diagonal) + products, rtol=1e-9)


def test_an_edge_without_a_second_face_is_refused() -> None:
    vertices, faces = arrays(cube())
    with pytest.raises(InvalidMeshError, match="must be closed after all repairs, but 3 edges have no face beyond"):
        solid_properties(vertices, faces[1:])


def test_faces_that_show_different_sides_are_refused() -> None:
    vertices, faces = arrays(cube())
    faces[0] = faces[0, ::-1]
    with pytest.raises(InvalidMeshError, match="must be closed after all repairs, but"):
        solid_properties(vertices, faces)


def test_an_edge_of_four_faces_is_refused() -> None:
    vertices, faces = arrays(cube())
    with pytest.raises(InvalidMeshError, match="36 edges are of more than two faces"):
        solid_properties(vertices, np.vstack([faces, faces]))


@pytest.mark.parametrize("index", [-1, 8])
def test_faces_of_no_vertex_are_refused(index: int) -> None:
    vertices, faces = arrays(cube())
    faces[3, 1] = index
    with pytest.raises(InvalidMeshError, match="must have faces, all of them of finite vertices that exist"):
        solid_properties(vertices, faces)


def test_a_mesh_inside_out_is_no_solid() -> None:
    vertices, faces = arrays(cube())
    with pytest.raises(InvalidMeshError, match="must enclose a volume"):
        solid_properties(vertices, faces[:, ::-1])
