"""Fingers of a grasp stay beside each other with all their links, and with the straight parts of their tips."""

import numpy as np
import pytest

from tactopose_drake.core import poses
from tactopose_drake.core.grasping.finger_geometry import FingerGeometry
from tactopose_drake.core.grasping.finger_sides import FingerShape
from tactopose_drake.core.grasping.serial_chain import SerialChain

LINK, TIP = 0.04, 0.01
FLAT, UPRIGHT, DOWN = (0.5 * np.pi, 0.0, 0.0), (0.0, 0.0, 0.0), (np.pi, 0.0, 0.0)


def finger(x: float, z: float, thickness: float, straight_part: float = 0.0) -> FingerGeometry:
    """Three links upwards that turn about y, a ball in the middle of each; the tip's ball is 12 cm from the root."""
    up = poses.make_poses(np.eye(3), np.array([0.0, 0.0, LINK]))
    chain = SerialChain(
        X_parent=np.stack([poses.make_poses(np.eye(3), np.array([x, 0.0, z])), up, up]),
        axis=np.tile([0.0, 1.0, 0.0], (3, 1)),
        X_child=np.tile(np.eye(3, 4), (3, 1, 1)),
        coupling=np.eye(3),
        X_last_sensor=up,
        lower=np.full(3, -4.0),
        upper=np.full(3, 4.0),
        bodies=("first", "second", "third"),
    )
    middle = np.tile([0.0, 0.0, 0.5 * LINK], (3, 1))
    start = np.array([0.0, 0.0, -straight_part]) if straight_part else None
    return FingerGeometry(chain, np.zeros(3), TIP, np.arange(3), middle, np.full(3, thickness), p_SL=start)


# The one lies along x; the ball of the other's first link, 2 cm thick, is 2 cm above its tip's, so that they meet
# nearer than the root of (3 cm)^2 - (2 cm)^2.
@pytest.mark.parametrize(("beyond", "apart"), [(0.0230, True), (0.0220, False)])
def test_the_end_of_a_finger_stays_off_the_first_link_of_another(beyond: float, apart: bool) -> None:
    lying = FingerShape.of(finger(0.0, 0.0, 0.02), np.array([FLAT]))
    other = FingerShape.of(finger(0.12 + beyond, 0.0, 0.02), np.array([UPRIGHT, FLAT]))
    assert lying.apart(other, 0.0).shape == (1, 2)
    assert lying.apart(other, 0.0)[0, 0] == other.apart(lying, 0.0)[0, 0] == apart


def test_first_links_are_where_the_palm_has_them() -> None:
    left = FingerShape.of(finger(0.0, 0.0, 0.02), np.array([[0.0, -1.5, 0.0]]))
    right = FingerShape.of(finger(0.03, 0.0, 0.02), np.array([[0.0, 1.5, 0.0]]))  # nearer than two radii
    assert left.apart(right, 0.0).all()


@pytest.mark.parametrize(("straight_part", "apart"), [(0.0, True), (0.03, False)])
def test_a_tips_straight_part_is_as_thick_as_its_end(straight_part: float, apart: bool) -> None:
    lying = FingerShape.of(finger(0.0, 0.0, 0.013, straight_part), np.array([FLAT]))
    # Its tip comes down on the other's last link, beside the ball in that, 1.5 cm from it along x.
    other = FingerShape.of(finger(0.085, 0.12 + 0.0185, 0.013), np.array([DOWN]))
    assert lying.apart(other, 0.0).item() is apart


def test_of_slim_fingers_the_sides_count() -> None:
    lying = FingerShape.of(finger(0.0, 0.0, TIP), np.array([FLAT]))
    other = FingerShape.of(finger(0.13, 0.0, TIP), np.array([UPRIGHT]))
    assert lying.apart(other, 0.0).all()  # from its last two links, which are above
