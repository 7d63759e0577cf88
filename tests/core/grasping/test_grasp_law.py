import numpy as np
import pytest

from tactopose_drake.core.grasping.grasp_law import (
    ClosingMotion,
    GraspLaw,
    commanded_positions,
    joint_torques,
    update_push,
)

LAW = GraspLaw()
PERIOD = 0.01
MOTION = ClosingMotion(np.array([0.0, 0.1]), np.array([0.5, 0.9]), np.array([0.02, -0.01]), 3.0)


def test_command_goes_from_open_over_touch_to_beyond():
    np.testing.assert_allclose(commanded_positions(MOTION, -LAW.approach_push, LAW), MOTION.q_open)
    np.testing.assert_allclose(commanded_positions(MOTION, -np.inf, LAW), MOTION.q_open)
    halfway = 0.5 * (MOTION.q_open + MOTION.q_touch)
    np.testing.assert_allclose(commanded_positions(MOTION, -0.5 * LAW.approach_push, LAW), halfway)
    np.testing.assert_allclose(commanded_positions(MOTION, 0.0, LAW), MOTION.q_touch)
    np.testing.assert_allclose(commanded_positions(MOTION, 2.0, LAW), MOTION.q_touch + 2.0 * MOTION.closing)


def test_command_is_continuous_in_the_push():
    just_before = commanded_positions(MOTION, -1e-9, LAW)
    np.testing.assert_allclose(just_before, commanded_positions(MOTION, 1e-9, LAW), atol=1e-8)


def press(stiffness: float, holding: bool = False, steps: int = 600, push: float = -LAW.approach_push) -> float:
    """The force in the end against something that gives `stiffness` newtons for each newton of push."""
    force = 0.0
    for _ in range(steps):
        push = update_push(push, force, 3.0, holding, PERIOD, LAW)
        force = stiffness * max(push - 0.5, 0.0)
    return force


@pytest.mark.parametrize("stiffness", [0.4, 1.0, 1.3])
def test_force_settles_at_the_set_force(stiffness):
    assert press(stiffness) == pytest.approx(3.0, rel=1e-3)


def test_a_finger_that_touches_nothing_stops():
    push = -LAW.approach_push
    for _ in range(2000):
        push = update_push(push, 0.0, 3.0, False, PERIOD, LAW)
    assert push == LAW.most_push_share * 3.0


def test_push_slows_down_from_half_of_the_set_force_on() -> None:
    steps = [update_push(1.0, share * 3.0, 3.0, False, PERIOD, LAW) - 1.0 for share in (0.2, 0.5, 0.75, 1.0, 1.25, 1.8)]
    np.testing.assert_allclose(steps, LAW.push_rate * PERIOD * np.array([1.0, 1.0, 0.5, 0.0, -0.5, -1.0]), atol=1e-12)


def test_push_never_changes_faster_than_its_rate():
    for force in (0.0, 2.9, 3.1, 50.0, np.nan):
        assert abs(update_push(1.0, force, 3.0, False, PERIOD, LAW) - 1.0) <= LAW.push_rate * PERIOD + 1e-12


def test_a_finger_that_is_pressed_from_outside_does_not_wind_up():
    push = 1.0
    for _ in range(2000):
        push = update_push(push, 6.0, 3.0, False, PERIOD, LAW)
    assert push == -LAW.approach_push


def test_no_reading_counts_as_no_force_until_the_hand_holds():
    for set_force in (0.5, 3.0):
        no_force = update_push(1.0, 0.0, set_force, False, PERIOD, LAW)
        assert update_push(1.0, np.nan, set_force, False, PERIOD, LAW) == no_force
    assert update_push(1.0, np.nan, 3.0, True, PERIOD, LAW) == 1.0


def test_holding_leaves_all_but_slack_fingers_alone():
    assert update_push(1.0, 2.5, 3.0, True, PERIOD, LAW) == 1.0
    assert update_push(1.0, 9.0, 3.0, True, PERIOD, LAW) == 1.0
    assert update_push(1.0, 1.5, 3.0, True, PERIOD, LAW) > 1.0


def test_torques_pull_towards_the_command_and_against_the_motion():
    q, v = np.array([0.3, -0.4]), np.array([0.0, 1.0])
    torques = joint_torques(q, v, q + np.array([0.1, 0.0]), np.full(2, 5.0), np.full(2, 0.2))
    np.testing.assert_allclose(torques, [0.5, -0.2])
