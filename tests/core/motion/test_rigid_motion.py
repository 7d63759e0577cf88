import numpy as np
import pytest

from tactopose_drake.core.motion.rigid_motion import Motion, MotionHistory, error_of_motion, predict_poses
from tactopose_drake.core.poses import (
    compose,
    identity_poses,
    increments_between,
    make_poses,
    random_rotations,
    retract,
)

COVARIANCE = np.diag([0.01, 0.02, 0.03, 1e-4, 2e-4, 3e-4])


def random_pose(seed: int) -> np.ndarray:
    generator = np.random.default_rng(seed)
    return make_poses(random_rotations(generator, 1), 0.1 * generator.normal(size=(1, 3)))[0]


def test_covariances_move_as_samples_do() -> None:
    generator = np.random.default_rng(0)
    X_PO = random_pose(1)
    P = np.diag([4e-4, 1e-4, 2e-4, 1e-6, 4e-6, 2e-6])
    Q = np.diag([1e-4, 3e-4, 2e-4, 4e-6, 1e-6, 2e-6])
    motion = Motion(np.array([0.3, -0.4, 0.2, 0.05, 0.0, -0.03]), Q)
    moved, covariance = predict_poses(X_PO[None], P[None], motion)
    count = 20_000
    before = retract(np.tile(X_PO, (count, 1, 1)), generator.normal(size=(count, 6)) * np.sqrt(np.diag(P)))
    noise = generator.normal(size=(count, 6)) * np.sqrt(np.diag(Q))
    after = compose(retract(identity_poses(count), noise), compose(motion.pose, before))
    u = increments_between(moved[0], after)
    sampled = u.T @ u / count
    scale = np.sqrt(np.diag(covariance[0]))
    np.testing.assert_allclose(sampled / np.outer(scale, scale), covariance[0] / np.outer(scale, scale), atol=0.04)


def test_what_is_unknown_of_a_motion_is_all_that_it_adds_where_it_ends() -> None:
    motion = Motion(np.array([0.3, -0.4, 0.2, 0.05, 0.0, -0.03]), np.diag([1e-4, 3e-4, 2e-4, 4e-6, 1e-6, 2e-6]))
    X_PO, P = np.stack([random_pose(1), random_pose(2)]), np.stack([COVARIANCE, 0.1 * COVARIANCE])
    known = Motion(motion.twist, np.zeros((6, 6)))
    moved, covariance = predict_poses(X_PO, P, motion)
    _, without = predict_poses(X_PO, P, known)
    np.testing.assert_allclose(error_of_motion(moved, motion), covariance - without, atol=1e-12)


def test_a_small_twist_before_a_motion_is_its_adjoint_s_after_it() -> None:
    motion, small = Motion(np.array([0.3, -0.4, 0.2, 0.05, 0.1, -0.03]), COVARIANCE), 1e-5 * np.arange(-2.0, 4.0)
    ahead = compose(motion.pose, Motion(small, COVARIANCE).pose)
    behind = compose(Motion(motion.adjoint @ small, COVARIANCE).pose, motion.pose)
    np.testing.assert_allclose(ahead, behind, atol=1e-9)


def test_a_late_pose_is_brought_along_by_what_moved_since() -> None:
    twist = np.array([0.02, -0.01, 0.03, 0.001, 0.002, -0.001])
    history = MotionHistory((0.0,))
    poses = [random_pose(2)]
    for i in range(50):
        motion = Motion(twist * np.cos(0.1 * i), 1e-8 * np.eye(6))
        history = history.followed_by(motion, 0.01 * (i + 1), 1.0)
        poses.append(compose(motion.pose, poses[-1]))
    for index in (0, 17, 49, 50):
        now = history.predict(0.01 * index, poses[index], COVARIANCE)
        assert now is not None
        np.testing.assert_allclose(now[0], poses[-1], atol=1e-9)
        grown = np.trace(now[1]) - np.trace(COVARIANCE)
        assert grown == pytest.approx((50 - index) * 6e-8, rel=0.1, abs=1e-12)


def test_between_two_frames_a_share_of_the_motion_counts() -> None:
    motion = Motion(np.array([0, 0, 0, 0.01, 0, 0.0]), np.diag(np.full(6, 1e-6)))
    history = MotionHistory((0.0,)).followed_by(motion, 0.01, 1.0)
    now = history.predict(0.0025, np.eye(3, 4), COVARIANCE)
    assert now is not None
    np.testing.assert_allclose(now[0][:, 3], [0.0075, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(now[1][3:, 3:] - COVARIANCE[3:, 3:], 0.75e-6 * np.eye(3), atol=1e-9)


def test_what_is_older_than_the_memory_is_forgotten() -> None:
    """A quarter of a second of frames at 1/64 s: what ended just that long ago is the oldest that is kept."""
    history = MotionHistory((0.0,))
    for i in range(100):
        history = history.followed_by(Motion(np.zeros(6), 1e-8 * np.eye(6)), (i + 1) / 64, 0.25)
    assert history.times == tuple(i / 64 for i in range(83, 101))
    assert len(history.motions) == 17
    assert history.predict(82 / 64, np.eye(3, 4), COVARIANCE) is None
    assert history.predict(101 / 64, np.eye(3, 4), COVARIANCE) is None
    assert history.predict(83 / 64, np.eye(3, 4), COVARIANCE) is not None
