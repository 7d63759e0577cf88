"""Fingers of a grasp stay beside each other with all their links, and with the straight parts of their tips."""

import dataclasses
import itertools

import numpy as np
import pytest

from tactopose_drake.core import poses
from tactopose_drake.core.grasping.finger_geometry import FingerGeometry
from tactopose_drake.core.grasping.finger_sides import FingerShape, half_width, sides
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


def test_of_a_slim_and_a_thick_finger_all_links_of_the_thick_one_stay_off_the_sides_of_the_slim_one() -> None:
    """By all pairs of their spheres, and the same whichever of both is asked."""
    generator = np.random.default_rng(0)
    q_slim, q_thick = generator.uniform(-2.0, 2.0, size=(2, 40, 3))
    slim, thick = finger(0.0, 0.0, TIP), finger(0.07, 0.02, 0.016)
    joints = slim.axis(q_slim)  # about which a slim finger is as wide as its balls
    tip = np.array([0.0, 0.0, 0.0])
    links = np.concatenate([thick.spheres(q_thick), thick.fixed_points(q_thick, tip[None])], axis=1)
    radii = np.array([0.016, 0.016, 0.016, TIP])
    gaps = np.linalg.norm(joints[:, None, :, None] - links[None, :, None], axis=-1) - TIP - radii
    expected = gaps.min(axis=(2, 3)) > 0.001
    assert 0.2 < expected.mean() < 0.8
    assert (expected != (gaps[..., 1:].min(axis=(2, 3)) > 0.001)).any()  # the first link decides in some
    one, other = FingerShape.of(slim, q_slim), FingerShape.of(thick, q_thick)
    np.testing.assert_array_equal(one.apart(other, 0.001), expected)
    np.testing.assert_array_equal(other.apart(one, 0.001), expected.T)


@pytest.mark.parametrize("bent", [0.0, 0.6])
def test_a_finger_is_as_wide_as_its_last_links_reach_from_the_line_through_its_joints(bent: float) -> None:
    generator = np.random.default_rng(1)
    straight = finger(0.03, -0.02, 0.004)
    chain = dataclasses.replace(straight.chain, lower=np.full(3, bent - 1.0), upper=np.full(3, bent + 1.0))
    body = np.repeat([0, 1, 2], 4)
    p_BH = generator.uniform(-0.005, 0.005, size=(12, 3)) + generator.uniform(0.0, LINK, size=(12, 1)) * [0, 0, 1]
    radius = np.where(body == 0, 0.03, generator.uniform(0.001, 0.003, size=12))  # the first link does not count
    geometry = dataclasses.replace(straight, chain=chain, tip_radius=0.001, body=body, p_BH=p_BH, radius=radius)
    posture = np.full((1, 3), bent)
    corners, share = geometry.axis(posture)[0], np.linspace(0.0, 1.0, 20_001)[:, None]
    line = np.concatenate([a + share * (b - a) for a, b in itertools.pairwise(corners)])
    reach = [np.linalg.norm(line - p, axis=1).min() for p in geometry.spheres(posture)[0, 4:]] + radius[4:]
    assert half_width(geometry) == pytest.approx(reach.max(), abs=2e-6)
    # A tip 1.2 times as thin is that of a slim finger, whose sides are as wide as that about its joints.
    for share_of_tip, slim in ((1.19, True), (1.21, False)):
        with_tip = dataclasses.replace(geometry, tip_radius=half_width(geometry) / share_of_tip)
        centres, radii = sides(with_tip, posture)
        assert len(radii) == centres.shape[1] == (4 if slim else 9)
        if slim:
            np.testing.assert_array_equal(centres[0], corners)
            np.testing.assert_allclose(radii, half_width(geometry))
