"""The shipped objects are sound closed surfaces, as their README says."""

import re
from itertools import product

import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from .object_files import CATALOGUE, FOLDER, shipped

GENUS = {"mug": 1}


def crossings(mesh: trimesh.Trimesh) -> int:
    """How many edges pass through a triangle that they share no corner with."""
    V, F, E = mesh.vertices, mesh.faces, mesh.edges_unique
    edge, face = candidates(mesh)
    apart = ~(E[edge][:, :, None] == F[face][:, None, :]).any(axis=(1, 2))
    edge, face = edge[apart], face[apart]
    corners = V[F]
    p, d = V[E[edge, 0]], V[E[edge, 1]] - V[E[edge, 0]]
    a, u, v = corners[face, 0], corners[face, 1] - corners[face, 0], corners[face, 2] - corners[face, 0]
    h = np.cross(d, v)
    volume = np.einsum("ij,ij->i", u, h)
    volume = np.where(np.abs(volume) < 1e-22, np.inf, volume)
    s = p - a
    b_1 = np.einsum("ij,ij->i", s, h) / volume
    q = np.cross(s, u)
    b_2 = np.einsum("ij,ij->i", d, q) / volume
    t = np.einsum("ij,ij->i", v, q) / volume
    hit = np.isfinite(volume) & (b_1 >= 0) & (b_2 >= 0) & (b_1 + b_2 <= 1) & (t >= 0) & (t <= 1)
    return len(np.unique(edge[hit]))


def candidates(mesh: trimesh.Trimesh) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of an edge and a triangle whose bounding boxes overlap, as two arrays of their places."""
    ends = mesh.vertices[mesh.edges_unique]
    low, high = ends.min(axis=1), ends.max(axis=1)
    corners = mesh.vertices[mesh.faces]
    bottom, top = corners.min(axis=1), corners.max(axis=1)
    middles, radii = 0.5 * (bottom + top), 0.5 * np.linalg.norm(top - bottom, axis=1)
    found = []
    # Triangles of about one size are sought together: samples along the edges are as close as they are large.
    size = np.floor(np.log2(np.maximum(radii, 1e-9))).astype(int)
    for some in (np.flatnonzero(size == one) for one in np.unique(size)):
        reach = radii[some].max()
        counts = np.ceil(mesh.edges_unique_length / reach).astype(int)
        edge = np.repeat(np.arange(len(ends)), counts)
        share = (np.arange(len(edge)) - np.repeat(np.cumsum(counts) - counts, counts) + 0.5) / counts[edge]
        samples = cKDTree(ends[edge, 0] + share[:, None] * (ends[edge, 1] - ends[edge, 0]))
        near = samples.sparse_distance_matrix(cKDTree(middles[some]), 1.5 * reach, output_type="coo_matrix")
        pairs = np.unique(edge[near.row] * len(corners) + some[near.col])
        e, f = np.divmod(pairs, len(corners))
        found.append(pairs[((low[e] <= top[f]) & (bottom[f] <= high[e])).all(axis=1)])
    edge, face = np.divmod(np.concatenate(found), len(corners))
    return edge, face


def test_every_object_is_shipped_and_listed() -> None:
    assert {path.stem for path in FOLDER.glob("*.obj")} == set(CATALOGUE)
    assert {path.stem for path in FOLDER.glob("*.sdf")} == set(CATALOGUE)
    wanted = "cube cylinder soda_can tea_box thermal_bottle wine_glass pencil light_bulb mug bust spray_bottle"
    assert set(wanted.split()) <= set(CATALOGUE)


@pytest.mark.parametrize("name", CATALOGUE)
def test_surface_is_closed_manifold_and_outward(name: str) -> None:
    mesh = shipped(name)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.volume > 0
    assert mesh.body_count == 1
    assert mesh.euler_number == 2 - 2 * GENUS.get(name, 0)
    # Manifold at the vertices too: the faces at each form one fan, so a vertex has as many neighbours as faces.
    fans = np.bincount(mesh.faces.ravel(), minlength=len(mesh.vertices))
    assert np.array_equal(np.bincount(mesh.edges_unique.ravel(), minlength=len(mesh.vertices)), fans)
    assert len(np.unique(mesh.vertices, axis=0)) == len(mesh.vertices)
    sides = np.linalg.norm(np.diff(mesh.triangles[:, [0, 1, 2, 0]], axis=1), axis=2).max(axis=1)
    assert (2 * mesh.area_faces / sides).min() > 3e-5, "a triangle without height"


@pytest.mark.parametrize("name", CATALOGUE)
def test_surface_does_not_cross_itself(name: str) -> None:
    assert crossings(shipped(name)) == 0


def test_crossing_surfaces_are_found() -> None:
    one = trimesh.creation.icosphere(subdivisions=2, radius=0.03)
    assert crossings(one) == 0
    assert crossings(trimesh.util.concatenate([one, one.copy().apply_translation([0.04, 0.001, 0.002])])) > 0


@pytest.mark.parametrize("name", CATALOGUE)
def test_size_counts_and_frame(name: str) -> None:
    mesh = shipped(name)
    assert 1000 <= len(mesh.faces) <= 16500
    assert (FOLDER / f"{name}.obj").stat().st_size < 1.1e6
    assert abs(mesh.bounds[0, 2]) < 1e-5, "stands on z = 0"
    assert 0.05 < mesh.extents.max() < 0.25, "metres, and of a size for a hand"
    assert np.abs(mesh.bounds[:, :2]).max() < 0.08
    base = mesh.vertices[mesh.vertices[:, 2] < 0.002]
    assert np.abs(base[:, :2].max(axis=0) + base[:, :2].min(axis=0)).max() < 0.008, "the base is around the origin"


def test_bust_is_finely_sculpted() -> None:
    assert len(shipped("bust").vertices) >= 8000


@pytest.mark.parametrize("name", CATALOGUE)
def test_normals_are_unit_outward_and_one_a_vertex(name: str) -> None:
    lines = (FOLDER / f"{name}.obj").read_text().splitlines()
    normals = np.array([line.split()[1:] for line in lines if line.startswith("vn ")], dtype=float)
    mesh = shipped(name)
    assert normals.shape == mesh.vertices.shape
    assert np.abs(np.linalg.norm(normals, axis=1) - 1).max() < 2e-4
    agreement = np.einsum("fij,fj->fi", normals[mesh.faces], mesh.face_normals)
    assert agreement.min() > 0.2
    assert np.percentile(agreement, 5) > 0.75
    assert all(re.fullmatch(r"f (\d+)//\1 (\d+)//\2 (\d+)//\3", line) for line in lines if line.startswith("f "))


def best_self_match(mesh: trimesh.Trimesh) -> float:
    """How far (95th percentile, m) the surface is from itself after the best rotation or reflection of its inertia.

    A symmetry of a solid keeps its centre and its principal axes, so the sign changes of those are the candidates;
    where two moments agree nothing is said.
    """
    points = trimesh.sample.sample_surface(mesh, 4000, seed=0)[0]
    targets = cKDTree(trimesh.sample.sample_surface(mesh, 40000, seed=1)[0])
    axes = np.linalg.eigh(mesh.moment_inertia)[1]
    local = (points - mesh.center_mass) @ axes
    flips = [signs for signs in product((1, -1), repeat=3) if signs != (1, 1, 1)]
    return min(np.percentile(targets.query((local * s) @ axes.T + mesh.center_mass)[0], 95) for s in flips)


@pytest.mark.parametrize("name", ["bust", "spray_bottle"])
def test_objects_without_symmetry_have_none(name: str) -> None:
    assert best_self_match(shipped(name)) > 0.003


def test_symmetry_is_seen_where_there_is_one() -> None:
    assert best_self_match(shipped("tea_box")) < 0.0015
    assert best_self_match(shipped("mug")) < 0.0015  # its mirror plane


@pytest.mark.parametrize(
    ("name", "turn"),
    [("cube", 90), ("tea_box", 180), ("pencil", 60), ("screwdriver", 180)]
    + [(name, 35) for name in ("cylinder", "soda_can", "thermal_bottle", "wine_glass", "light_bulb")],
)
def test_stated_rotations_map_the_vertices_onto_themselves(name: str, turn: float) -> None:
    vertices = shipped(name).vertices
    turned = Rotation.from_euler("z", turn, degrees=True).apply(vertices)
    assert cKDTree(vertices).query(turned)[0].max() < 2e-6


def test_readme_tells_the_truth() -> None:
    rows = re.findall(
        r"^\| `(\w+)` \|[^|]*\| ([\d x]+) \| ([\d.]+) \|[^|]*\| (\d+) \|$", (FOLDER / "README.md").read_text(), re.M
    )
    assert {name for name, *_ in rows} == set(CATALOGUE)
    for name, size, mass, vertices in rows:
        mesh = shipped(name)
        assert [float(part) for part in size.split("x")] == pytest.approx(1000 * mesh.extents, abs=0.51)
        assert float(mass) == CATALOGUE[name].mass
        assert int(vertices) == len(mesh.vertices)
