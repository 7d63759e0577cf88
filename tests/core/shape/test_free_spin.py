import numpy as np
import pytest

from tactopose_drake.core.poses import compose, exp_so3, make_poses, random_rotations, rotation_angles, transform_points
from tactopose_drake.core.shape.free_spin import nearest_images, turn_alike, turn_toward, turn_toward_nearest
from tactopose_drake.core.shape.symmetry import RotationalSymmetry, symmetry_group

POINT = np.array([0.02, -0.01, 0.03])


def axis(direction: list[float], order: int = 0) -> RotationalSymmetry:
    return RotationalSymmetry(np.array(direction), POINT, order)


def poses(count: int) -> np.ndarray:
    generator = np.random.default_rng(1)
    return make_poses(random_rotations(generator, count), generator.normal(size=(count, 3)))


def test_a_turn_keeps_the_axis_in_place_and_comes_nearest() -> None:
    X, reference = poses(20), np.eye(3, 4)
    symmetry = axis([0.6, 0.0, 0.8])
    turned = turn_toward(X, reference, [symmetry])
    for t in (0.0, 0.1):
        on_axis = (POINT + t * symmetry.axis)[None]
        np.testing.assert_allclose(transform_points(turned, on_axis), transform_points(X, on_axis), atol=1e-12)
    angle = rotation_angles(turned[:, :, :3], reference[:, :3])
    for t in np.linspace(0.05, 6.2, 50):
        assert np.all(angle <= rotation_angles(turned[:, :, :3] @ exp_so3(t * symmetry.axis), reference[:, :3]) + 1e-7)


def test_poses_that_differ_by_a_turn_become_the_same() -> None:
    X = poses(1)[0]
    symmetry = axis([0.0, 0.0, 1.0])
    R = exp_so3(np.array([[0, 0, 0.3], [0, 0, 2.9], [0, 0, -1.2]]))
    turned = make_poses(X[:, :3] @ R, X[:, 3] + (POINT - R @ POINT) @ X[:, :3].T)
    found = turn_toward(turned, poses(2)[1], [symmetry])
    np.testing.assert_allclose(found, np.broadcast_to(found[0], found.shape), atol=1e-12)


def test_upside_down_too_poses_that_differ_by_a_turn_become_the_same() -> None:
    symmetry, reference = axis([0.0, 0.0, 1.0]), make_poses(np.eye(3), np.zeros(3))
    generator = np.random.default_rng(4)
    # Tilted a little either way from upside down, where every turn is as far from the reference.
    tilts = exp_so3(0.01 * generator.normal(size=(40, 3)) * [1.0, 1.0, 0.0])
    spins = exp_so3(generator.uniform(-np.pi, np.pi, size=(40, 1)) * symmetry.axis)
    R = tilts @ exp_so3(np.array([np.pi, 0.0, 0.0])) @ spins
    X = make_poses(R, -R @ POINT)
    found = turn_alike(X, reference, [symmetry], np.eye(3, 4)[None])
    on_axis = np.array([POINT, POINT + 0.1 * symmetry.axis])
    np.testing.assert_allclose(
        [transform_points(pose, on_axis) for pose in found], [transform_points(pose, on_axis) for pose in X], atol=1e-12
    )
    assert rotation_angles(found[:, :, :3], found[0, :, :3]).max() < 0.1
    assert rotation_angles(turn_toward(X, reference, [symmetry])[:, :, :3], found[0, :, :3]).max() > 1.0
    np.testing.assert_array_equal(turn_alike(X[:0], reference, [symmetry], np.eye(3, 4)[None]), X[:0])


def test_a_symmetry_that_turns_the_axis_upside_down_brings_poses_together_whatever_axis_it_is_about() -> None:
    symmetry, reference = axis([0.0, 0.0, 1.0]), make_poses(np.eye(3), np.zeros(3))
    for angle in np.linspace(0.0, np.pi, 7):
        flip = exp_so3(np.pi * np.array([np.cos(angle), np.sin(angle), 0.0]))
        group = np.stack([np.eye(3, 4), make_poses(flip, POINT - flip @ POINT)])
        spin = exp_so3(2.0 * symmetry.axis)
        X = make_poses(flip @ spin, -flip @ spin @ POINT)[None]
        found = turn_alike(X, reference, [symmetry], group)
        images = compose(found, group)
        assert rotation_angles(images[:, :, :3], reference[:, :3]).min() < 1e-6


def test_each_pose_turns_toward_the_nearest_reference_however_both_are_turned() -> None:
    symmetry, references = axis([0.6, 0.0, 0.8]), poses(4)
    generator = np.random.default_rng(5)
    near = np.array([2, 0, 3, 3, 1])
    R = references[near, :, :3] @ exp_so3(0.03 * generator.normal(size=(5, 3)))
    on_axis = np.einsum("bij,j->bi", references[near, :, :3], POINT) + references[near, :, 3]
    spun = R @ exp_so3(generator.uniform(-np.pi, np.pi, size=(5, 1)) * symmetry.axis)
    X = make_poses(spun, on_axis + 0.01 * generator.normal(size=(5, 3)) - spun @ POINT)
    found = turn_toward_nearest(X, references, [symmetry], 0.1)
    expected = [turn_toward(X[i : i + 1], references[near[i]], [symmetry])[0] for i in range(5)]
    np.testing.assert_allclose(found, expected, atol=1e-12)
    assert turn_toward_nearest(X[:0], references, [symmetry], 0.1).shape == (0, 3, 4)
    np.testing.assert_array_equal(turn_toward_nearest(X, references, [], 0.1), X)


def test_a_sphere_has_but_one_rotation() -> None:
    sphere = [axis(row) for row in np.eye(3).tolist()]
    found = turn_toward(poses(30), np.eye(3, 4), sphere)
    assert rotation_angles(found[:, :, :3], np.eye(3)).max() < np.radians(2.0)


def test_finite_symmetries_turn_nothing() -> None:
    np.testing.assert_array_equal(turn_toward(poses(3), np.eye(3, 4), [axis([0.0, 0.0, 1.0], order=4)]), poses(3))


@pytest.mark.parametrize("angle", [1e-9, np.pi])
def test_small_and_half_turns_are_no_exception(angle: float) -> None:
    R = exp_so3(np.array([[0.0, 0.0, angle]]))
    X = make_poses(R, (POINT - R @ POINT))
    np.testing.assert_allclose(turn_toward(X, np.eye(3, 4), [axis([0.0, 0.0, 1.0])])[0], np.eye(3, 4), atol=1e-8)


def test_the_nearest_image_looks_the_same_and_no_image_is_nearer() -> None:
    X, reference = poses(40), poses(1)[0]
    turns = symmetry_group([axis([0.0, 0.0, 1.0], order=6), axis([1.0, 0.0, 0.0], order=2)])
    found = nearest_images(X, reference, turns, [])
    images = compose(X[:, None], turns)
    assert np.all(np.abs(images - found[:, None]).max(axis=(2, 3)).min(axis=1) < 1e-9)
    angles = rotation_angles(images[..., :3], reference[:, :3])
    np.testing.assert_allclose(rotation_angles(found[:, :, :3], reference[:, :3]), angles.min(axis=1), atol=1e-6)
    assert np.any(angles.argmin(axis=1) != 0)


def test_the_nearest_image_of_a_body_of_revolution_that_may_be_flipped() -> None:
    X = poses(1)[0]
    symmetries = [axis([0.0, 0.0, 1.0]), axis([1.0, 0.0, 0.0], order=2)]
    turns = compose(
        symmetry_group(symmetries)[:, None], RotationalSymmetry(symmetries[0].axis, POINT, 12).poses()
    ).reshape(-1, 3, 4)
    R = exp_so3(np.array([0.0, 0.0, 1.0])) @ exp_so3(np.array([np.pi, 0.0, 0.0]))
    image = compose(X, make_poses(R, POINT - R @ POINT))
    np.testing.assert_allclose(nearest_images(image[None], X, turns, symmetries)[0], X, atol=1e-9)
