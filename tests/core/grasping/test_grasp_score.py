import dataclasses

import numpy as np
import pytest

from tactopose_drake.core.grasping.grasp_score import ContactTerms, ScoreParams, balance, score_grasp
from tactopose_drake.core.poses import exp_so3, random_rotations

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


def test_what_a_touch_tells_is_how_the_object_moves_under_it():
    """By an increment (w, v) about the centre of mass, in the palm's axes: of the distance, and of the normal."""
    generator = np.random.default_rng(2)
    n = generator.normal(size=(5, 3))
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    p = 0.05 * generator.normal(size=(5, 3))
    of = terms(p, n)
    for u in generator.normal(size=(6, 6)):
        moved = np.cross(u[:3], p) + u[3:]
        np.testing.assert_allclose(PARAMS.touch_position * of.distance @ u, np.sum(n * moved, axis=1), atol=1e-12)
        turned = PARAMS.touch_normal * of.normal @ u
        np.testing.assert_allclose(np.abs(turned), np.abs(np.cross(u[:3], n)), atol=1e-12)
    # What both tell adds up; of the information's entropy a half counts.
    rows = np.concatenate([of.distance, of.normal.reshape(-1, 6)])
    prior = np.diag(np.repeat([PARAMS.prior_rotation, PARAMS.prior_translation], 3) ** -2.0)
    few = dataclasses.replace(PARAMS, least_contacts=6)
    expected = 0.25 * np.linalg.slogdet(rows.T @ rows + prior)[1] + 5.0 - 0.7
    assert score_grasp(of, 0.7, LOAD, few).value == pytest.approx(expected)


@pytest.mark.parametrize(("least_force", "most_force"), [(1.0, 2.5), (3.5, 8.0)])
def test_forces_that_are_out_of_their_range_cost_by_how_far_they_are(least_force: float, most_force: float):
    p, n = ring(4)
    force, _ = balance(terms(p, n), LOAD, PARAMS)
    narrow = dataclasses.replace(PARAMS, least_force=least_force, most_force=most_force)
    wide, clipped = (score_grasp(terms(p, n), 0.0, LOAD, params) for params in (PARAMS, narrow))
    out = np.abs(force - np.clip(force, least_force, most_force)).sum()
    assert out > 1.5
    assert wide.value - clipped.value == pytest.approx(PARAMS.clipping_cost * out)
    np.testing.assert_allclose(clipped.force, np.clip(force, least_force, most_force))


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


def test_fingers_push_and_never_pull():
    """An object lies on three fingers without friction, and does not hang from them."""
    params = dataclasses.replace(PARAMS, friction=0.0)
    angle = np.arange(3) * 2 * np.pi / 3
    p = 0.03 * np.stack([np.cos(angle), np.sin(angle), np.zeros(3)], axis=1)
    for up in (1.0, -1.0):
        n = np.tile([0.0, 0.0, -up], (3, 1))  # outward, on the object's lower side or on its upper one
        force, imbalance = balance(ContactTerms.of(p + 0.02 * n, n, params), 9.0 * LOAD, params)
        if up > 0.0:
            np.testing.assert_allclose(force, 3.0, rtol=1e-6)
            assert imbalance < 1e-6
        else:
            assert imbalance > 8.9


def test_a_load_aside_is_carried_by_the_law_of_the_lever():
    params = dataclasses.replace(PARAMS, friction=0.0, balance_weight=1e3)
    p = np.array([[0.02, 0.03, -0.01], [0.02, -0.03, -0.01], [-0.06, 0.0, -0.01]])
    force, imbalance = balance(ContactTerms.of(p, np.tile(LOAD, (3, 1)), params), 8.0 * LOAD, params)
    np.testing.assert_allclose(force, [3.0, 3.0, 2.0], rtol=1e-3)
    assert imbalance < 1e-3


def test_three_contacts_may_balance_and_two_do_not():
    three, two = (score_grasp(terms(*ring(count)), 0.0, LOAD, PARAMS) for count in (3, 2))
    assert three.balanced
    assert not two.balanced
    np.testing.assert_array_equal(two.force, np.zeros(2))


def test_a_finger_with_hardly_any_force_balances_nothing():
    """Two fingers oppose each other, and what a third one adds only their little friction can take."""
    params = dataclasses.replace(PARAMS, friction=0.03, most_imbalance=2.0)
    n = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    contacts = ContactTerms.of(0.03 * n, n, params)
    force, _ = balance(contacts, np.zeros(3), params)
    assert force[:2].min() > 2.0
    assert force[2] < 0.5 * params.least_force
    score = score_grasp(contacts, 0.0, np.zeros(3), params)
    assert not score.balanced
    np.testing.assert_allclose(score.force, [*force[:2], params.least_force])
    assert score_grasp(contacts, 0.0, np.zeros(3), dataclasses.replace(params, least_force=0.0)).balanced


def test_what_touches_tell_is_what_their_measurements_tell_of_the_pose():
    """By differences of distance and normal when the object moves, for touches of as many fingers and equal costs."""
    generator = np.random.default_rng(6)
    sigma = np.repeat([PARAMS.prior_rotation, PARAMS.prior_translation], 3)
    told, expected = [], []
    for _ in range(6):
        n = random_rotations(generator, 2)[:, 0]
        p = 0.05 * generator.normal(size=(2, 3))

        def measured(u: np.ndarray, n: np.ndarray = n, p: np.ndarray = p) -> np.ndarray:
            """Distances of fixed points from the object's tangent planes, and the normals; whitened."""
            normals = n @ exp_so3(u[:3]).T
            distances = np.einsum("ki,ki->k", normals, p - (p @ exp_so3(u[:3]).T + u[3:]))
            return np.concatenate([distances / PARAMS.touch_position, normals.ravel() / PARAMS.touch_normal])

        J = np.array([(measured(step) - measured(-step)) / 2e-6 for step in 1e-6 * np.eye(6)]).T
        expected.append(np.linalg.slogdet(J.T @ J + np.diag(sigma**-2.0))[1])
        told.append(score_grasp(terms(p, n), 0.0, LOAD, PARAMS).value)
    gain = np.diff(told) @ np.diff(expected) / np.sum(np.diff(expected) ** 2)
    assert gain > 0.0
    np.testing.assert_allclose(np.diff(told), gain * np.diff(expected), rtol=1e-4, atol=1e-6)
