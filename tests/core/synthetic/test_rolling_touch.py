import numpy as np
import pytest
import trimesh

from tactopose_drake.core.poses import make_poses, random_rotations
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.synthetic.rolling_touch import FingertipNoise, RollingTouch
from tactopose_drake.errors import InvalidInputError

SILENT = FingertipNoise(
    position=0.0001,
    normal_deg=0.01,
    stable_position=1e-9,
    stable_normal_deg=1e-9,
    velocity=1e-12,
    angular_velocity=1e-12,
)
RADIUS = 0.009


@pytest.fixture(scope="module")
def ball() -> ObjectModel:
    return ObjectModel.from_mesh(trimesh.creation.icosphere(4, 0.04), cache=False)


def start(model: ObjectModel) -> RollingTouch:
    generator = np.random.default_rng(0)
    X_PO = make_poses(random_rotations(generator, 1), np.array([[0.1, 0.0, 0.0]]))[0]
    p_OC = model.samples.points[[0, 500, 1500, 2500]]
    return RollingTouch(model, X_PO, p_OC, generator, SILENT, RADIUS)


def test_the_fingertips_touch_the_mesh(ball: ObjectModel) -> None:
    touch = start(ball)
    for _ in range(20):
        touch.move(np.array([0.5, 0.2, -0.3, 0.01, 0.0, 0.02]), np.zeros((4, 3)), False, 0.01)
        inside = (touch.p_PC - touch.X_PO[:, 3]) @ touch.X_PO[:, :3]
        np.testing.assert_allclose(np.linalg.norm(inside, axis=1), 0.04, atol=2e-4)
        np.testing.assert_allclose(touch.p_PC + RADIUS * touch.n_PC, touch.p_PF, atol=1e-12)


def test_rolling_fingertips_have_the_objects_velocity_where_they_touch(ball: ObjectModel) -> None:
    touch = start(ball)
    twist, turn = np.array([0.5, 0.2, -0.3, 0.01, 0.0, 0.02]), np.random.default_rng(1).normal(size=(4, 3))
    before = touch.p_PC
    touch.move(twist, turn, False, 1e-5)
    _, velocities = touch.measure()
    for i, name in enumerate(touch.sources):
        of_tip = np.cross(velocities[name][:3], before[i]) + velocities[name][3:]
        of_object = np.cross(twist[:3], before[i]) + twist[3:]
        np.testing.assert_allclose(of_tip, of_object, atol=3e-3)


def test_the_error_of_the_velocity_is_where_the_fingertip_touches(ball: ObjectModel) -> None:
    noise = FingertipNoise(velocity=1e-9, angular_velocity=0.1)
    X_PO = make_poses(np.eye(3), np.array([0.5, -0.3, 0.4]))  # far from where velocities are given
    touch = RollingTouch(ball, X_PO, ball.samples.points[:4], np.random.default_rng(0), noise, RADIUS)
    _, velocities = touch.measure()
    for p_PC, V in zip(touch.p_PC, velocities.values(), strict=True):
        assert np.linalg.norm(V[:3]) > 0.02
        np.testing.assert_allclose(np.cross(V[:3], p_PC) + V[3:], 0.0, atol=1e-7)


def test_sliding_fingertips_hardly_move(ball: ObjectModel) -> None:
    touch = start(ball)
    before, on_object = touch.p_PF, (touch.p_PC - touch.X_PO[:, 3]) @ touch.X_PO[:, :3]
    touch.move(np.array([2.0, 0, 0, 0, 0, 0]), np.zeros((4, 3)), True, 0.01)  # about its middle
    after = (touch.p_PC - touch.X_PO[:, 3]) @ touch.X_PO[:, :3]
    assert np.abs(touch.p_PF - before).max() < 2e-4
    assert np.linalg.norm(after - on_object, axis=1).max() > 5e-4


def test_the_stable_part_of_the_error_stays(ball: ObjectModel) -> None:
    noise = FingertipNoise(position=1e-6, stable_position=0.001, normal_deg=1e-4, stable_normal_deg=3.0)
    touch = RollingTouch(ball, np.eye(3, 4), ball.samples.points[:5], np.random.default_rng(0), noise)
    errors = [touch.measure()[0].p_PC - touch.p_PC for _ in range(3)]
    np.testing.assert_allclose(errors[0], errors[1], atol=1e-5)
    assert np.abs(errors[0]).max() > 5e-4


def test_a_move_takes_time(ball: ObjectModel) -> None:
    touch = start(ball)
    before = touch.X_PO
    with pytest.raises(InvalidInputError, match="duration must be a number > 0, not 0"):
        touch.move(np.ones(6), np.zeros((4, 3)), slides=False, duration=0.0)
    np.testing.assert_array_equal(touch.X_PO, before)
