import numpy as np
import pytest

from tactopose_drake.core.shape.object_model import ObjectModel


def test_a_ball_turns_by_the_angle_and_falls_off_by_the_sagitta() -> None:
    ball = ObjectModel.from_sphere(0.05, samples=6000, cache=False)
    height, turn = ball.unevenness.variances(np.array([0.005, 0.008]) / np.sqrt(2.0))
    along = np.array([0.005, 0.008])
    np.testing.assert_allclose(turn, 0.5 * np.arcsin(along / 0.05) ** 2, rtol=0.15)
    np.testing.assert_allclose(height, (0.05 - np.sqrt(0.05**2 - along**2)) ** 2, rtol=0.3)


def test_a_box_is_the_same_all_over_a_face() -> None:
    box = ObjectModel.from_box([0.1, 0.2, 0.3], cache=False)
    height, turn = box.unevenness.variances(np.array([0.0, 0.004, 0.05]))
    np.testing.assert_allclose(height, 0.0, atol=1e-9)
    np.testing.assert_allclose(turn, 0.0, atol=1e-6)


def test_a_point_that_is_not_off_is_compared_with_its_own_place() -> None:
    ball = ObjectModel.from_sphere(0.03, cache=False)
    height, turn = ball.unevenness.variances(np.zeros(1))
    assert height == pytest.approx(0.0, abs=1e-12)
    assert turn == pytest.approx(0.0, abs=1e-12)
