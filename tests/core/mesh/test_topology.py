import numpy as np
import pytest
import trimesh

from tactopose_drake.core.mesh import topology as mesh_topology
from tactopose_drake.errors import InvalidMeshError
from tests.core.meshes import ball, create, cube, joined, without


def test_closed_meshes_link_every_half_edge_once() -> None:
    faces = np.array(ball().faces)
    links = mesh_topology.link_faces(faces)
    np.testing.assert_array_equal(np.sort(links.pairs.ravel()), np.arange(3 * len(faces)))
    assert not len(links.open)
    assert not links.crowded
    start, end = mesh_topology.half_edges(faces)
    np.testing.assert_array_equal(start[links.pairs[:, 0]], end[links.pairs[:, 1]])


def test_holes_have_rims() -> None:
    mesh = ball()
    mesh = without(mesh, np.abs(mesh.triangles_center[:, 2]) > 0.03)
    faces = np.array(mesh.faces)
    links = mesh_topology.link_faces(faces)
    loops = mesh_topology.boundary_loops(faces, links.open)
    assert len(loops) == 2
    assert sum(map(len, loops)) == len(links.open)
    for loop in loops:
        z = mesh.vertices[loop, 2]
        assert np.all(np.sign(z) == np.sign(z[0]))


@pytest.mark.parametrize("share", [0.1, 0.4])
def test_faces_are_turned_to_agree(share: float) -> None:
    faces = np.array(joined(ball(), cube(at=(0.2, 0, 0))).faces)
    turned = np.random.default_rng(0).random(len(faces)) < share
    turned[0] = True  # the first face, with which the others are compared, is in the minority
    mixed = np.where(turned[:, None], faces[:, ::-1], faces)
    agreed, count = mesh_topology.agree_on_sides(mixed, mesh_topology.link_faces(mixed).pairs)
    assert count == turned.sum()
    np.testing.assert_array_equal(np.sort(agreed, axis=1), np.sort(faces, axis=1))
    start, end = mesh_topology.half_edges(agreed)
    pairs = mesh_topology.link_faces(agreed).pairs
    np.testing.assert_array_equal(start[pairs[:, 0]], end[pairs[:, 1]])


def test_one_sided_surfaces_are_refused() -> None:
    # A band of triangles closed with a twist.
    faces = np.array([[k, k + 1, k + 2] if k % 2 else [k + 1, k, k + 2] for k in range(9)])
    faces %= 9
    with pytest.raises(InvalidMeshError, match="only one side"):
        mesh_topology.agree_on_sides(faces, mesh_topology.link_faces(faces).pairs)


def merged_pair(offset: tuple[float, float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Two cubes of side one that share the vertices where they touch."""
    mesh = joined(cube(1.0), cube(1.0, offset))
    vertices, index = np.unique(np.round(mesh.vertices, 6), axis=0, return_inverse=True)
    return vertices, index.ravel()[mesh.faces]


@pytest.mark.parametrize(
    ("offset", "shared"),
    [((1.0, 1.0, 0.0), 1), ((1.0, 0.0, 0.0), 4), ((1.0, 1.0, 1.0), 0)],
    ids=["edge", "face", "corner"],
)
def test_bodies_that_touch_are_told_apart(offset: tuple[float, float, float], shared: int) -> None:
    vertices, faces = merged_pair(offset)
    links = mesh_topology.link_faces(faces)
    assert len(links.crowded) >= shared
    resolved = [mesh_topology.pair_around_edge(vertices, faces, crowd) for crowd in links.crowded]
    split, old = mesh_topology.split_vertices(faces, np.concatenate([links.pairs, *resolved]))
    assert len(old) == 16
    np.testing.assert_array_equal(old[split], faces)
    body = mesh_topology.body_labels(split)
    assert body.max() == 1
    for label in (0, 1):
        corners = vertices[old[split[body == label]]]
        np.testing.assert_allclose(np.ptp(corners.reshape(-1, 3), axis=0), 1.0)


@pytest.mark.parametrize("turn", [0.0, 1.0, 2.5, 4.0])
def test_pairing_around_an_edge_bounds_the_solid(turn: float) -> None:
    # Three wedges of solid around the z axis, their faces in random order.
    angles = np.array([[0.1, 0.9], [1.5, 2.0], [4.0, 5.5]]) + turn
    vertices = [[0, 0, 0], [0, 0, 1]]
    faces, wedge = [], []
    for n, (begin, stop) in enumerate(angles):
        for angle, along in ((begin, False), (stop, True)):
            vertices.append([np.cos(angle), np.sin(angle), 0.3])
            faces.append([0, 1, len(vertices) - 1] if along else [1, 0, len(vertices) - 1])
            wedge.append(n)
    order = np.random.default_rng(3).permutation(len(faces))
    shuffled = np.array(faces)[order]
    (crowd,) = mesh_topology.link_faces(shuffled).crowded
    pairs = mesh_topology.pair_around_edge(np.array(vertices, dtype=float), shuffled, crowd)
    found = np.array(wedge)[order][pairs // 3]
    np.testing.assert_array_equal(found[:, 0], found[:, 1])


@pytest.mark.parametrize("noise", [-1e-6, 0.0, 1e-6])  # rad, as of single precision
def test_wedges_whose_faces_coincide_but_for_rounding_are_told_apart(noise: float) -> None:
    for seed in range(40):
        generator = np.random.default_rng(seed)
        begin, shared, stop = np.sort(generator.uniform(0.0, 5.8, 3)) + 0.1 * np.arange(3)
        ends = [(begin, False), (shared, True), (shared + noise, False), (stop, True)]
        tips = [[np.cos(angle), np.sin(angle), 0.3] for angle, _ in ends]
        faces = np.array([[0, 1, 2 + n] if along else [1, 0, 2 + n] for n, (_, along) in enumerate(ends)])
        order = generator.permutation(4)
        (crowd,) = mesh_topology.link_faces(faces[order]).crowded
        pairs = mesh_topology.pair_around_edge(np.array([[0, 0, 0], [0, 0, 1], *tips], float), faces[order], crowd)
        assert sorted(sorted(pair) for pair in order[pairs // 3].tolist()) == [[0, 1], [2, 3]]


def test_edges_of_an_odd_number_of_faces_are_refused() -> None:
    box = cube(1.0)
    vertices = np.vstack([box.vertices, [[3.0, 3.0, 3.0]]])
    faces = np.vstack([box.faces, [[*box.faces[0][:2], 8]]])
    (crowd,) = mesh_topology.link_faces(faces).crowded
    with pytest.raises(InvalidMeshError, match=r"must be manifold, .*, not with 3 faces that share the edge at"):
        mesh_topology.pair_around_edge(vertices, faces, crowd)


def test_sound_meshes_are_left_as_they_are() -> None:
    for mesh in (ball(), create.torus(0.04, 0.01), cube()):
        faces = np.array(mesh.faces)
        split, old = mesh_topology.split_vertices(faces, mesh_topology.link_faces(faces).pairs)
        np.testing.assert_array_equal(old[split], faces)
        assert len(old) == len(mesh.vertices)


def test_two_edges_between_the_same_vertices_are_told_apart_by_a_vertex_in_between() -> None:
    """Two tetrahedra with one edge in common, whose vertices stay common."""
    vertices = np.array([[0, 0, 0], [0, 0, 1], [1, 0, 0], [0.5, 1, 0], [-1, 0, 0], [-0.5, -1, 0]], dtype=np.float64)
    one, other = [[0, 2, 3], [0, 1, 2], [2, 1, 3], [0, 3, 1]], [[0, 4, 5], [0, 1, 4], [4, 1, 5], [0, 5, 1]]
    pairs = [mesh_topology.link_faces(np.array(faces)).pairs + 12 * n for n, faces in enumerate((one, other))]
    faces = np.array(one + other)
    assert len(mesh_topology.link_faces(faces).crowded) == 1
    split, pieces = mesh_topology.split_repeated_edges(
        vertices, faces, mesh_topology.edge_labels(8, np.concatenate(pairs))
    )
    links = mesh_topology.link_faces(pieces)
    assert len(links.pairs) * 2 == 3 * len(pieces) == 30
    np.testing.assert_array_equal(split[6:], [[0.0, 0.0, 0.5]])
    before, after = (trimesh.Trimesh(*mesh, process=False).volume for mesh in ((vertices, faces), (split, pieces)))
    assert after == pytest.approx(before)
    assert before != 0.0
