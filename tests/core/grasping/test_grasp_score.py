import dataclasses

import numpy as np
import pytest

from tactopose_drake.core.grasping.grasp_score import ContactTerms, ScoreParams, balance, score_grasp
from tactopose_drake.core.poses import random_rotations

PARAMS = ScoreParams(friction=0.5, normal_force=3.0, least_force=1.0, most_force=8.0)
LOAD = np.array([0.0, 0.0, -1.0])


def ring(count: int, radius: float = 0.03) -> tuple[np.ndarray, np.ndarray]:
    """Contacts around a circle, pressing inwards."""
    angle = np.arange(count) * 2 * np.pi / count
    n = np.stack([np.cos(angle), np.sin(angle), np.zeros(count)], axis=1)
    return radius * n, n


def terms(p: np.ndarray, n: np.ndarray) -> ContactTerms:
    return ContactTerms.of(p, n, PARAMS)


def test_opposed_fingers_carry_equal_forces():
    p, n = ring(4)
    force, imbalance = balance(terms(p, n), LOAD, PARAMS)
    np.testing.assert_allclose(force, 3.0, rtol=0.02)
    assert imbalance < 0.01


def test_a_heavy_load_asks_for_the_normal_force_that_friction_needs():
    p, n = ring(4)
    force, _ = balance(terms(p, n), np.array([0.0, 0.0, -20.0]), PARAMS)
    # 20 N by friction alone; the hexagon in the friction's circle reaches 87 % of its radius at the least.
    assert 0.99 * 20.0 / 0.5 < force.sum() < 20.0 / (0.5 * 0.86)


def test_one_thumb_carries_as_much_as_two_fingers():
    n = np.array([[1.0, 0, 0], [-1.0, 0, 0], [-1.0, 0, 0]])
    p = 0.03 * n + [[0, 0, 0], [0, 0.02, 0], [0, -0.02, 0]]
    force, _ = balance(terms(p, n), LOAD, PARAMS)
    assert force[0] == pytest.approx(force[1] + force[2], rel=0.05)


def test_fingers_on_one_side_balance_nothing():
    n = np.tile([1.0, 0.0, 0.0], (4, 1))
    p = 0.03 * n + 0.02 * np.array([[0, 1, 1], [0, -1, 1], [0, 1, -1], [0, -1, -1]])
    assert not score_grasp(terms(p, n), 0.0, LOAD, PARAMS).balanced


def test_rotating_everything_changes_nothing():
    generator = np.random.default_rng(5)
    p, n = ring(5)
    p = p + 0.01 * generator.normal(size=p.shape)
    R = random_rotations(generator, 1)[0]
    here, there = (
        score_grasp(terms(p, n), 0.3, LOAD, PARAMS),
        score_grasp(terms(p @ R.T, n @ R.T), 0.3, R @ LOAD, PARAMS),
    )
    # The cones' edges start elsewhere, so the forces agree only as well as a hexagon is round.
    assert here.value == pytest.approx(there.value, abs=0.3)
    np.testing.assert_allclose(here.force, there.force, atol=0.3)


def test_touches_from_all_sides_score_higher_than_from_two():
    p, n = ring(4)
    flat = np.array([[1.0, 0, 0], [1.0, 0, 0], [-1.0, 0, 0], [-1.0, 0, 0]])
    q = 0.03 * flat + 0.01 * np.array([[0, 1, 0], [0, -1, 0], [0, 1, 0], [0, -1, 0]])
    assert score_grasp(terms(p, n), 0.0, LOAD, PARAMS).value > score_grasp(terms(q, flat), 0.0, LOAD, PARAMS).value


def test_cost_counts_against_a_grasp():
    p, n = ring(4)
    assert score_grasp(terms(p, n), 1.0, LOAD, PARAMS).value == pytest.approx(
        score_grasp(terms(p, n), 0.0, LOAD, PARAMS).value - 1.0
    )


def test_what_is_left_out_of_balance_decides():
    p, n = ring(4)
    _, imbalance = balance(terms(p, n), 20.0 * LOAD, PARAMS)
    assert imbalance > 0.01
    for share, balanced in ((1.1, True), (0.9, False)):
        params = dataclasses.replace(PARAMS, most_imbalance=share * imbalance)
        assert score_grasp(terms(p, n), 0.0, 20.0 * LOAD, params).balanced is balanced
