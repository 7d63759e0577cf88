import numpy as np
import pytest

from tactopose_drake.core.poses import exp_so3
from tactopose_drake.core.vision.vision_model import hidden_share, segments_hit_spheres

NO_SPHERES = (np.zeros((0, 3)), np.zeros(0))


def ball(centre: tuple[float, float, float], radius: float, count: int = 4000) -> tuple[np.ndarray, np.ndarray]:
    """Points, evenly spread over a sphere, and their normals."""
    normals = np.random.default_rng(0).normal(size=(count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return np.array(centre) + radius * normals, normals


def test_nothing_hides_without_spheres() -> None:
    assert hidden_share(*ball((0, 0, 1), 0.05), *NO_SPHERES) == 0.0


def test_a_large_sphere_before_the_object_hides_all_of_it() -> None:
    assert hidden_share(*ball((0, 0, 1), 0.05), np.array([[0, 0, 0.6]]), np.array([0.2])) == 1.0


def test_a_sphere_behind_the_object_hides_nothing() -> None:
    assert hidden_share(*ball((0, 0, 1), 0.05), np.array([[0, 0, 1.4]]), np.array([0.2])) == 0.0


def test_the_far_side_of_the_object_does_not_count() -> None:
    assert hidden_share(*ball((0, 0, 1), 0.05), np.array([[0, 0, 1.25]]), np.array([0.23])) == 0.0


def test_a_sphere_behind_the_camera_hides_nothing() -> None:
    assert hidden_share(*ball((0, 0, 1), 0.05), np.array([[0, 0, -0.4]]), np.array([0.2])) == 0.0


def test_where_no_surface_faces_the_camera_nothing_is_hidden() -> None:
    points, normals = ball((0, 0, 1), 0.05)
    beyond = points[:, 2] > 1.01  # the far side alone, behind a sphere that hides all of it
    assert hidden_share(points[beyond], normals[beyond], np.array([[0, 0, 0.6]]), np.array([0.2])) == 0.0


def test_a_sphere_that_covers_half_the_view_hides_half() -> None:
    wall = np.array([[2.0, 0.0, 0.5]])  # so large that it is a wall whose edge passes through the axis
    assert hidden_share(*ball((0, 0, 1), 0.05), wall, np.array([2.0])) == pytest.approx(0.5, abs=0.05)


def test_more_spheres_hide_no_less_and_a_turned_camera_sees_the_same() -> None:
    points, normals = ball((0, 0, 1), 0.05)
    generator = np.random.default_rng(1)
    centres = np.array([0, 0, 0.8]) + generator.normal(scale=0.03, size=(12, 3))
    radius = np.full(12, 0.01)
    shares = [hidden_share(points, normals, centres[:k], radius[:k]) for k in range(13)]
    assert np.all(np.diff(shares) >= 0)
    assert 0.0 < shares[-1] < 1.0
    R = exp_so3(np.array([0.3, -1.0, 0.8]))
    assert hidden_share(points @ R.T, normals @ R.T, centres @ R.T, radius) == shares[-1]


def test_a_segment_that_ends_before_the_sphere_or_passes_it_is_free() -> None:
    ends = np.array([[0, 0, 1.0], [0, 0, 0.3], [0.2, 0, 1.0], [0, 0, 0]])
    hit = segments_hit_spheres(ends, np.array([[0, 0, 0.5]]), np.array([0.05]))
    np.testing.assert_array_equal(hit, [True, False, False, False])
