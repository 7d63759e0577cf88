import math

import numpy as np
import pytest
import trimesh
from scipy.special import erf

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.objectives.surface_contact import SurfaceContact
from tactopose_drake.core.objectives.surface_density import DENSITY_FLOOR, SurfaceDensity
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.shape.surfels import LEAST_SPACING, SPACING_SIGMAS, Surfels, make_surfels, surfel_spacing
from tactopose_drake.core.validation import FloatArray

SIGMA, BEND = 0.001, 0.1
IDENTITY = np.eye(3, 4)[None]


@pytest.fixture(scope="module")
def box() -> ObjectModel:
    return ObjectModel.from_mesh(trimesh.creation.box((0.06, 0.06, 0.06)))


def discs_of(surfels: Surfels) -> FloatArray:
    """One disc a column, without those that fill blocks, shape (9, n)."""
    rows = np.concatenate(list(surfels.blocks), axis=1).astype(np.float64)
    return np.asarray(rows[:, rows[6] > 0.0])


def test_discs_of_a_ball_are_as_rough_as_they_are_wide() -> None:
    """On a ball of radius r a place that is d off has a normal that is d / r off."""
    mesh, r = trimesh.creation.icosphere(5, 0.03), 0.03
    discs = discs_of(make_surfels(mesh.vertices, mesh.faces.astype(np.int32), mesh.area, 0.006))
    whole = discs[:, discs[6] > 0.5 * np.median(discs[6])]
    assert np.mean(whole[8] * r**2 / whole[7]) == pytest.approx(1.0, rel=0.1)
    assert discs[6].sum() == pytest.approx(mesh.area, rel=1e-3)


def test_discs_of_what_is_much_bent_are_single_points_of_even_squares() -> None:
    mesh = trimesh.creation.icosphere(4, 0.001)
    discs = discs_of(make_surfels(mesh.vertices, mesh.faces.astype(np.int32), mesh.area, 0.002))
    single = discs[:, discs[8] == 0.0]
    assert single.shape[1] > 0.9 * discs.shape[1]
    np.testing.assert_allclose(single[7], single[6] / 12.0, rtol=1e-5)


def cost(model: ObjectModel, p: list[float], n: list[float] | None, sigma: float = SIGMA) -> float:
    contacts = Contacts([p], None if n is None else [n], sigma_position=sigma, sigma_normal=BEND)
    return float(SurfaceDensity(model, contacts).cost(IDENTITY)[0])


@pytest.mark.parametrize("sigma", [0.0005, 0.001, 0.003])
def test_the_discs_cover_the_surface_once(box: ObjectModel, sigma: float) -> None:
    surfels = box.surfels(sigma)
    discs = discs_of(surfels)
    assert discs[6].sum() == pytest.approx(box.area, rel=1e-4)
    assert np.abs(np.abs(discs[:3]).max(axis=0) - 0.03).max() < 1e-6
    np.testing.assert_allclose(np.linalg.norm(discs[3:6], axis=0), 1.0, atol=1e-6)
    assert box.surfels(sigma) is surfels


@pytest.mark.parametrize(("out", "turn"), [(0.0, 0.0), (0.001, 0.0), (-0.002, 0.1), (0.0005, -0.15)])
@pytest.mark.parametrize("place", [(0.0, 0.0), (0.0103, -0.0071)])
def test_on_a_flat_surface_it_is_the_squared_distance_and_angle(
    box: ObjectModel, out: float, turn: float, place: tuple[float, float]
) -> None:
    n = [math.sin(turn), 0.0, math.cos(turn)]
    expected = 0.5 * (out / SIGMA) ** 2 + 0.5 * (2 * math.sin(turn / 2) / BEND) ** 2
    p = [*place, 0.03 + out]
    assert cost(box, p, n) == pytest.approx(expected, abs=0.1)
    assert cost(box, p, None) == pytest.approx(0.5 * (out / SIGMA) ** 2, abs=0.1)
    smooth = SurfaceContact(box.grid, Contacts([p], [n], sigma_position=SIGMA, sigma_normal=BEND)).cost(IDENTITY)[0]
    assert cost(box, p, n) == pytest.approx(smooth, abs=0.15)


@pytest.mark.parametrize("beside", [-0.002, -0.001, 0.0, 0.0007, 0.0015])
def test_beyond_an_edge_there_is_less_and_less_of_the_face(box: ObjectModel, beside: float) -> None:
    # The normal says that the face is +z, at whose edge the contact lies: the rest of the plane is missing.
    expected = -math.log(0.5 * (1.0 - erf(beside / SIGMA / math.sqrt(2.0))))
    assert cost(box, [0.03 + beside, 0.002, 0.03], [0.0, 0.0, 1.0]) == pytest.approx(expected, abs=0.15)


def test_without_a_normal_both_faces_of_an_edge_count(box: ObjectModel) -> None:
    # Half a plane each.
    assert cost(box, [0.03, 0.002, 0.03], None) == pytest.approx(0.0, abs=0.1)


def test_the_normal_says_which_side_of_a_thin_wall_is_touched() -> None:
    plate = ObjectModel.from_mesh(trimesh.creation.box((0.08, 0.08, 0.002)))
    for z in (-0.001, 0.0, 0.0004, 0.001):
        up, down = (0.5 * ((z - side * 0.001) / SIGMA) ** 2 for side in (1, -1))
        assert cost(plate, [0.001, 0.002, z], [0, 0, 1]) == pytest.approx(up, abs=0.1)
        assert cost(plate, [0.001, 0.002, z], [0, 0, -1]) == pytest.approx(down, abs=0.1)
        both = -math.log(math.exp(-up) + math.exp(-down))
        assert cost(plate, [0.001, 0.002, z], None) == pytest.approx(both, abs=0.1)


def test_rough_normals_are_expected_with_their_spread() -> None:
    # A fine tessellation whose faces differ from the mean by far more than the sensor's noise.
    generator = np.random.default_rng(0)
    mesh = trimesh.creation.box((0.06, 0.06, 0.02)).subdivide_to_size(0.001)
    inside = np.abs(mesh.vertices[:, :2]).max(axis=1) < 0.028
    mesh.vertices[inside & (mesh.vertices[:, 2] > 0.0), 2] += 0.00005 * generator.normal(
        size=int(np.sum(inside & (mesh.vertices[:, 2] > 0.0)))
    )
    rough = ObjectModel.from_mesh(mesh, symmetry="none")
    top = (rough.samples.points[:, 2] > 0.009) & (np.abs(rough.samples.points[:, :2]).max(axis=1) < 0.025)
    tilt = np.arccos(np.clip(rough.samples.normals[top, 2], -1, 1))
    assert 0.05 < np.sqrt(np.mean(tilt**2) / 2) < 0.3
    # The touched faces' own normals cost what is usual, not what a smooth plane would say.
    points, normals = rough.samples.points[top][:100], rough.samples.normals[top][:100]
    narrow = Contacts(points, normals, sigma_position=SIGMA, sigma_normal=0.02)
    plane = 0.5 * np.sum((normals - [0, 0, 1]) ** 2) / 0.02**2
    assert SurfaceDensity(rough, narrow).cost(IDENTITY)[0] < 0.75 * plane


def test_it_moves_with_the_object(box: ObjectModel) -> None:
    R = trimesh.transformations.euler_matrix(0.3, -1.0, 2.0)[:3, :3]
    p, n = np.array([[0.0305, 0.001, 0.029], [0.0, 0.0305, 0.01]]), np.array([[1.0, 0, 0], [0, 1.0, 0]])
    X = np.column_stack([R, [0.1, -0.2, 0.3]])[None]
    here = SurfaceDensity(box, Contacts(p, n)).cost(IDENTITY)
    there = SurfaceDensity(box, Contacts(p @ R.T + X[0, :, 3], n @ R.T)).cost(X)
    np.testing.assert_allclose(here, there, atol=1e-3)


def test_far_from_the_surface_the_cost_stays_finite(box: ObjectModel) -> None:
    far = cost(box, [3.0, 0.0, 0.0], [1, 0, 0])
    assert math.isfinite(far)
    assert far == pytest.approx(cost(box, [0.0, 0.0, 0.0], [1, 0, 0]))
    assert far == pytest.approx(-math.log(DENSITY_FLOOR))


def test_the_spacing_follows_the_noise_within_what_the_surface_allows() -> None:
    assert surfel_spacing(1e-5, 0.01) == pytest.approx(LEAST_SPACING, rel=0.1)
    assert surfel_spacing(0.002, 0.01) == pytest.approx(2 * surfel_spacing(0.001, 0.01))
    assert surfel_spacing(1e-5, 100.0) > 0.01
    assert surfel_spacing(0.002, 0.01) == pytest.approx(SPACING_SIGMAS * 0.002, rel=0.1)


@pytest.mark.parametrize("height", [0.06, 0.002])
def test_it_is_the_sum_over_all_discs_each_once(height: float) -> None:
    # Contacts at faces, edges and corners, so that runs of discs begin and end anywhere; in the plate they follow on
    # each other.
    half = np.array([0.03, 0.03, 0.5 * height])
    model = ObjectModel.from_mesh(trimesh.creation.box(2.0 * half))
    generator = np.random.default_rng(0)
    p = np.sign(generator.normal(size=(300, 3))) * (half + 0.0005)
    inside = generator.uniform(size=(300, 3)) < 0.5
    p[inside] = (generator.uniform(-1.0, 1.0, size=(300, 3)) * half)[inside]
    p[inside.all(axis=1), 2] = half[2] + 0.0005
    n = np.sign(p) * (np.abs(p) > half)
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    x, m, (area, spread, rough) = (rows.astype(float) for rows in np.split(discs_of(model.surfels(SIGMA)), [3, 6]))
    for i in range(len(p)):
        way = p[i][:, None] - x
        d = np.sum(way * m, axis=0)
        across = np.sum(way**2, axis=0) - d**2
        wider, rougher = SIGMA**2 + spread, 1.0 + rough / BEND**2
        exponent = 0.5 * d**2 / SIGMA**2 + 0.5 * across / wider + (1.0 - n[i] @ m) / (BEND**2 * rougher)
        density = np.sum(area / (2.0 * np.pi * wider * rougher) * np.exp(-exponent))
        found = cost(model, p[i].tolist(), n[i].tolist())
        # Where hardly any disc counts, it is as good as nothing.
        assert min(found, 12.0) == pytest.approx(min(-math.log(density), 12.0), abs=0.03)


def test_contacts_that_are_less_sure_count_by_discs_of_their_own() -> None:
    box = ObjectModel.from_box([0.06, 0.06, 0.06])
    p = np.array([[0.0305, 0.001, 0.029], [0.0, 0.04, 0.01], [0.002, 0.0302, 0.001]])
    n = np.array([[1.0, 0, 0], [0, 1.0, 0], [0, 1.0, 0]])
    sigma = np.array([SIGMA, 40 * SIGMA, 1.5 * SIGMA])
    together = SurfaceDensity(box, Contacts(p, n, sigma_position=sigma, sigma_normal=BEND)).densities(IDENTITY)
    assert max(box._surfels) > 20 * min(box._surfels)
    alone = [
        SurfaceDensity(box, Contacts(p[i : i + 1], n[i : i + 1], sigma_position=sigma[i], sigma_normal=BEND))
        for i in range(3)
    ]
    expected = [density.densities(IDENTITY)[0, 0] for density in alone]
    np.testing.assert_allclose(together[0], expected, rtol=0.03)
