import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactopose_drake.core import poses
from tactopose_drake.core.grasping.serial_chain import SLIDING_ARM, SerialChain


def make_chain(
    generator: np.random.Generator, joints: int = 4, actuated: int = 3, sliding: frozenset[int] = frozenset()
) -> SerialChain:
    """Random joints; the last one follows the one before it, with an offset."""
    coupling = np.eye(joints, actuated)
    coupling[actuated:, -1] = 0.7
    axes = generator.normal(size=(joints, 3))
    return SerialChain(
        poses.make_poses(poses.random_rotations(generator, joints), 0.05 * generator.normal(size=(joints, 3))),
        axes / np.linalg.norm(axes, axis=1, keepdims=True),
        poses.make_poses(poses.random_rotations(generator, joints), 0.05 * generator.normal(size=(joints, 3))),
        coupling,
        poses.make_poses(poses.random_rotations(generator, 1)[0], np.array([0.0, 0.01, 0.02])),
        np.full(actuated, -1.0),
        np.full(actuated, 1.0),
        tuple(f"body_{i}" for i in range(joints)),
        sliding,
        np.append(np.zeros(joints - 1), 0.2),
    )


def test_planar_arm_by_hand():
    link = np.hstack([np.eye(3), [[0.3], [0.0], [0.0]]])
    chain = SerialChain(
        np.stack([np.eye(3, 4), link]),
        np.array([[0.0, 0.0, 1.0]] * 2),
        np.stack([np.eye(3, 4)] * 2),
        np.eye(2),
        link,
        np.zeros(2),
        np.ones(2),
        ("upper", "lower"),
    )
    X_PS = chain.sensor_poses(np.array([[np.pi / 2, -np.pi / 2], [0.0, np.pi / 2]]))
    np.testing.assert_allclose(X_PS[:, :, 3], [[0.3, 0.3, 0.0], [0.3, 0.3, 0.0]], atol=1e-12)
    np.testing.assert_allclose(X_PS[0, :, :3], np.eye(3), atol=1e-12)


@pytest.mark.parametrize("sliding", [frozenset(), frozenset({1}), frozenset({0, 3})])
@pytest.mark.parametrize("angle", [0.0, 1e-8, 1.0, np.pi])
def test_jacobian_against_central_differences(angle, sliding):
    generator = np.random.default_rng(3)
    chain = make_chain(generator, sliding=sliding)
    q, p_SQ, h = np.array([[angle, -0.4, angle]]), generator.normal(size=3) * 0.02, 1e-6
    _, J = chain.point_jacobians(q, p_SQ)
    for k in range(3):
        step = h * np.eye(3)[k]
        ahead, behind = chain.point_jacobians(q + step, p_SQ)[0], chain.point_jacobians(q - step, p_SQ)[0]
        np.testing.assert_allclose(J[:, :, k], (ahead - behind) / (2 * h), atol=1e-8)


def test_a_sliding_joint_moves_along_its_axis_and_counts_by_its_arm():
    chain = make_chain(np.random.default_rng(3), sliding=frozenset({0}))
    at, moved = chain.sensor_poses(np.array([[0.0, 0.3, -0.2], [0.05, 0.3, -0.2]]))
    np.testing.assert_allclose(moved[:, :3], at[:, :3], atol=1e-12)
    np.testing.assert_allclose(moved[:, 3] - at[:, 3], 0.05 * chain.X_parent[0, :, :3] @ chain.axis[0], atol=1e-12)
    np.testing.assert_array_equal(chain.arms, [SLIDING_ARM, 1.0, 1.0])


@given(seed=st.integers(0, 1000))
def test_a_batch_gives_what_its_rows_give(seed):
    generator = np.random.default_rng(seed)
    chain = make_chain(generator)
    q = generator.uniform(-1, 1, (5, 3))
    rows = np.concatenate([chain.sensor_poses(row[None]) for row in q])
    np.testing.assert_allclose(chain.sensor_poses(q), rows, atol=1e-12)
    np.testing.assert_allclose(
        poses.compose(chain.body_poses(q)[:, -1], chain.X_last_sensor), chain.sensor_poses(q), atol=1e-12
    )
