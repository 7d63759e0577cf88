import numpy as np
import pytest
import trimesh

from tactopose_drake.core.poses import compose, make_poses, random_rotations
from tactopose_drake.core.sensing.height_maps import HeightMapSensor
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.synthetic.synthetic_height_map import press_gel

SENSOR = HeightMapSensor(pixel=1e-4, most_depth=0.003)
RADIUS = 0.02


@pytest.fixture(scope="module")
def ball() -> ObjectModel:
    return ObjectModel.from_mesh(trimesh.creation.icosphere(subdivisions=5, radius=RADIUS), cache=False)


@pytest.mark.parametrize("depth", [0.001, 0.005])
def test_a_ball_leaves_a_cap(ball: ObjectModel, depth: float) -> None:
    # A ball in front of the pad, off the image's middle, along its rows and columns.
    generator = np.random.default_rng(0)
    X_PT = make_poses(random_rotations(generator, 1)[0], np.array([0.1, 0.0, -0.2]))
    X_TO = make_poses(np.eye(3), np.array([0.002, -0.001, RADIUS - depth]))
    found = press_gel(ball, compose(X_PT, X_TO), X_PT, SENSOR, (120, 160), generator, sigma_depth=0.0)
    x, y = np.meshgrid((np.arange(160) - 79.5) * 1e-4 - 0.002, (np.arange(120) - 59.5) * 1e-4 + 0.001)
    height = RADIUS - np.sqrt(RADIUS**2 - x**2 - y**2)
    np.testing.assert_allclose(found, np.clip(depth - height, 0.0, SENSOR.most_depth), atol=4e-5)
    assert np.isclose(found.max(), min(depth, SENSOR.most_depth), atol=1e-4)


def test_nothing_touches_a_pad_beside(ball: ObjectModel) -> None:
    X_PT = make_poses(np.eye(3), np.array([0.0, 0.0, RADIUS + 0.001]))
    # z of the pad points away from the ball.
    assert not press_gel(ball, np.eye(3, 4), X_PT, SENSOR, (60, 80), np.random.default_rng(0)).any()


def test_noise_is_of_what_is_touched(ball: ObjectModel) -> None:
    X_PO = make_poses(np.eye(3), np.array([0.0, 0.0, RADIUS - 0.001]))
    exact, noisy = (
        press_gel(ball, X_PO, np.eye(3, 4), SENSOR, (120, 160), np.random.default_rng(0), sigma_depth=sigma)
        for sigma in (0.0, 3e-5)
    )
    touched = exact > 1e-4
    assert not noisy[exact == 0.0].any()
    assert np.std((noisy - exact)[touched]) == pytest.approx(3e-5, rel=0.1)
