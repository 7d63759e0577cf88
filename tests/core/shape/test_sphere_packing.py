import numpy as np
import pytest

from tactopose_drake.core.shape.sphere_packing import PackingParams, pack_box, pack_capsule, pack_convex

CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)


def share_filled(points: np.ndarray, spheres: tuple[np.ndarray, np.ndarray]) -> float:
    """Share of points (n, 3) that lie in at least one sphere."""
    centres, radii = spheres
    distance = np.linalg.norm(points[:, None] - centres, axis=2)
    return float(np.mean(np.any(distance <= radii, axis=1)))


@pytest.mark.parametrize("length", [0.0, 0.004, 0.03])
def test_a_capsules_spheres_have_its_radius_and_reach_its_ends(length: float) -> None:
    centres, radii = pack_capsule(0.01, length)
    np.testing.assert_array_equal(radii, 0.01)
    np.testing.assert_array_equal(centres[:, :2], 0.0)
    np.testing.assert_allclose([centres[:, 2].min(), centres[:, 2].max()], [-length / 2, length / 2], atol=1e-15)
    assert np.all(np.diff(centres[:, 2]) <= 0.01 + 1e-15)


@pytest.mark.parametrize("size", [(0.08, 0.09, 0.025), (0.02, 0.02, 0.02), (0.01, 0.1, 0.01)])
def test_a_boxs_spheres_stay_inside_and_touch_every_side(size: tuple[float, float, float]) -> None:
    centres, radii = pack_box(np.array(size))
    np.testing.assert_allclose((centres + radii[:, None]).max(axis=0), np.array(size) / 2)
    np.testing.assert_allclose((centres - radii[:, None]).min(axis=0), -np.array(size) / 2)


def test_a_thin_box_is_mostly_filled() -> None:
    size = np.array([0.08, 0.09, 0.025])
    points = (np.random.default_rng(0).random((5000, 3)) - 0.5) * size
    assert share_filled(points, pack_box(size)) > 0.8


def test_the_first_sphere_of_a_cube_is_the_inscribed_one() -> None:
    centres, radii = pack_convex(CORNERS)
    np.testing.assert_allclose(centres[0], 0.5)
    assert radii[0] == pytest.approx(0.5)


def test_a_convex_bodys_spheres_stay_inside_and_mostly_fill_it() -> None:
    size = np.array([0.02, 0.03, 0.09])
    centres, radii = pack_convex(CORNERS * size)
    assert np.all(centres - radii[:, None] >= -1e-12)
    assert np.all(centres + radii[:, None] <= size + 1e-12)
    points = np.random.default_rng(0).random((5000, 3)) * size
    assert share_filled(points, (centres, radii)) > 0.75
    assert len(radii) < 200


def test_smaller_spheres_fill_more() -> None:
    size = np.array([0.02, 0.03, 0.09])
    points = np.random.default_rng(0).random((5000, 3)) * size
    some, more = pack_convex(CORNERS * size), pack_convex(CORNERS * size, PackingParams(least_share=0.2))
    assert len(more[1]) > len(some[1])
    assert share_filled(points, more) > share_filled(points, some) + 0.02
