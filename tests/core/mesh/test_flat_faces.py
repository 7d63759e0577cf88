import itertools

import numpy as np
import pytest
import trimesh

from tactopose_drake.core.mesh.flat_faces import without_flat_faces
from tactopose_drake.errors import InvalidMeshError
from tests.core.meshes import cube

CUBE = cube()
SIZE = float(np.linalg.norm(CUBE.extents))


def with_vertices_on_an_edge(shares: list[float]) -> trimesh.Trimesh:
    """A cube one face of which has vertices along an edge; faces without area, one on the other, join them to it."""
    a, b, c = CUBE.faces[0].tolist()
    ends = CUBE.vertices[[a, b]]
    vertices = np.vstack([CUBE.vertices, *[ends[:1] + share * (ends[1:] - ends[:1]) for share in shares]])
    chain = [a, *range(8, 8 + len(shares)), b]
    fan = [[p, q, c] for p, q in itertools.pairwise(chain)]
    flat = [[a, q, p] for p, q in itertools.pairwise(chain[1:])]
    return trimesh.Trimesh(vertices, [*CUBE.faces[1:].tolist(), *fan, *flat], process=False)


@pytest.mark.parametrize("shares", [[0.5], [0.3, 0.6], [0.1, 0.2, 0.5, 0.8, 0.9], [0.5, 0.5 + 1e-7], [1e-7]])
def test_faces_without_area_go_and_the_mesh_stays_closed(shares: list[float]) -> None:
    mesh = with_vertices_on_an_edge(shares)
    assert mesh.is_watertight
    repairs: list[str] = []
    faces = without_flat_faces(np.array(mesh.vertices), np.array(mesh.faces), SIZE, repairs)
    solid = trimesh.Trimesh(mesh.vertices, faces, process=False)
    assert solid.is_watertight
    assert solid.is_winding_consistent
    assert solid.area_faces.min() > 1e-12 * SIZE**2
    np.testing.assert_allclose(solid.volume, CUBE.volume, rtol=1e-6)
    assert len(repairs) == 1
    assert repairs[0].startswith("removed ")


def test_faces_that_cannot_be_removed_are_named() -> None:
    line = np.outer(np.linspace(0.0, 0.1, 4), [1.0, 0.0, 0.0])
    faces = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]])
    with pytest.raises(InvalidMeshError, match="must have faces whose corners do not lie on one line, but 4, one"):
        without_flat_faces(line, faces, 0.1, [])
