import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from tactopose_drake.core import poses
from tactopose_drake.core.kernels import pose_kernels

vectors = arrays(np.float64, 3, elements=st.floats(-3.0, 3.0))
ANGLES = [0.0, 1e-8, 1e-5, 1.0, np.pi - 1e-6, np.pi]


def random_poses(seed: int, count: int) -> np.ndarray:
    generator = np.random.default_rng(seed)
    return poses.make_poses(poses.random_rotations(generator, count), generator.normal(size=(count, 3)))


@given(vectors)
def test_exp_gives_rotations(w: np.ndarray) -> None:
    R = poses.exp_so3(w)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(R) == pytest.approx(1.0)


@pytest.mark.parametrize("angle", ANGLES)
def test_log_undoes_exp(angle: float) -> None:
    axis = np.array([0.36, -0.48, 0.8])
    w = poses.log_so3(poses.exp_so3(axis * angle))
    # At a half turn both signs of the axis are the same rotation.
    w = w if w @ axis >= 0 else -w
    np.testing.assert_allclose(w, axis * angle, atol=1e-9)


@given(st.integers(0, 1000))
def test_group_laws(seed: int) -> None:
    A, B, C = random_poses(seed, 3)
    np.testing.assert_allclose(poses.compose(A, poses.compose(B, C)), poses.compose(poses.compose(A, B), C), atol=1e-12)
    np.testing.assert_allclose(poses.compose(A, poses.inverse(A)), np.eye(3, 4), atol=1e-12)


@given(st.integers(0, 1000))
def test_points_are_transformed_as_poses_compose(seed: int) -> None:
    A, B = random_poses(seed, 2)
    points = np.random.default_rng(seed).normal(size=(5, 3))
    np.testing.assert_allclose(
        poses.transform_points(poses.compose(A, B), points),
        poses.transform_points(A, poses.transform_points(B, points)),
        atol=1e-12,
    )


@pytest.mark.parametrize("shape", [(), (4,), (2, 3)])
@pytest.mark.parametrize("angle", [0.0, 1e-8, 1.0, 3.0])
def test_increments_between_undoes_retract(shape: tuple[int, ...], angle: float) -> None:
    generator = np.random.default_rng(1)
    X = np.broadcast_to(random_poses(0, 1)[0], (*shape, 3, 4))
    axis = generator.normal(size=(*shape, 3))
    w = angle * axis / np.linalg.norm(axis, axis=-1, keepdims=True)
    increment = np.concatenate([w, generator.normal(size=(*shape, 3))], axis=-1)
    np.testing.assert_allclose(poses.increments_between(X, poses.retract(X, increment)), increment, atol=1e-9)


@given(st.integers(0, 1000))
def test_an_image_moves_with_the_pose_that_it_is_of(seed: int) -> None:
    X, image = random_poses(seed, 2)
    steps = 1e-6 * np.eye(6)
    moved = poses.increments_between(poses.compose(X, image), poses.compose(poses.retract(X, steps), image))
    J = poses.increments_of_images(np.stack([X, X]), poses.compose(X, np.stack([np.eye(3, 4), image])))
    np.testing.assert_allclose(J[0], np.eye(6), atol=1e-12)
    np.testing.assert_allclose(J[1], moved.T / 1e-6, atol=1e-5)


@given(st.integers(0, 1000))
def test_quaternions_round_trip(seed: int) -> None:
    R = poses.random_rotations(np.random.default_rng(seed), 8)
    np.testing.assert_allclose(poses.matrix_from_quaternion(poses.quaternion_from_matrix(R)), R, atol=1e-12)


@given(st.integers(0, 1000))
def test_compiled_retract_equals_the_plain_one(seed: int) -> None:
    X = random_poses(seed, 4)
    increments = np.random.default_rng(seed).normal(size=(4, 6)) * np.array([[0.0], [1e-9], [1e-3], [1.0]])
    out = np.empty_like(X)
    pose_kernels.retract(X, increments, out)
    np.testing.assert_allclose(out, poses.retract(X, increments), atol=1e-12)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-4, 1.0, 2.99, 3.0, 3.01, 3.1, np.pi - 1e-6, np.pi])
def test_the_compiled_increment_leads_from_one_pose_to_the_other(angle: float) -> None:
    """Above 172 degrees the axis comes from the symmetric part of the rotation."""
    generator = np.random.default_rng(2)
    axes = generator.normal(size=(20, 3))
    w, out = angle * axes / np.linalg.norm(axes, axis=1, keepdims=True), np.empty(6)
    X = random_poses(2, 1)[0]
    for Y in poses.retract(X, np.concatenate([w, axes], axis=1)):
        pose_kernels.increment_between(X, Y, out)
        np.testing.assert_allclose(poses.retract(X, out), Y, atol=1e-12)
        assert np.linalg.norm(out[:3]) == pytest.approx(angle, abs=1e-7)


@pytest.mark.parametrize("angle", [0.0, 1e-6, 0.9e-3, 1.1e-3, 1.0, 3.0])
def test_the_right_jacobian_turned_is_the_left_one(angle: float) -> None:
    w = angle * np.array([0.36, -0.48, 0.8])
    left = poses.exp_so3(w) @ poses.right_jacobian(w)
    np.testing.assert_allclose(left, poses.right_jacobian(w).T, atol=1e-11)
    np.testing.assert_allclose(left, poses.right_jacobian(-w), atol=1e-11)


@pytest.mark.parametrize("shape", [(3,), (50, 3), (5, 4, 3)])
def test_axes_across_make_right_handed_frames(shape: tuple[int, ...]) -> None:
    z = np.random.default_rng(0).normal(size=shape)
    z /= np.linalg.norm(z, axis=-1, keepdims=True)
    R = np.stack([*poses.axes_across(z), z], axis=-1)
    np.testing.assert_allclose(R @ np.swapaxes(R, -1, -2), np.broadcast_to(np.eye(3), R.shape), atol=1e-14)
    np.testing.assert_allclose(np.linalg.det(R), 1.0)
