import dataclasses

import numpy as np
import pytest
import trimesh

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.evidence.hand_geometry import HandGeometry
from tactopose_drake.core.grasping.finger_reach import FingerReach, ReachParams
from tactopose_drake.core.grasping.improvement import (
    ReachabilityParams,
    finger_clearance,
    improvement_map,
    reachable_points,
)
from tactopose_drake.core.grasping.quality import grasp_quality
from tactopose_drake.core.poses import make_poses, random_rotations, transform_points
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.errors import InvalidInputError
from tests.core.grasping.fingers import make_finger, translation

BALL = 0.03
P_OC = BALL * np.array([[1.0, 0.0, 0.0], [-0.5, 0.8, 0.33], [-0.5, -0.8, 0.33], [0.0, 0.2, -0.98]])


@pytest.fixture(scope="module")
def ball() -> ObjectModel:
    return ObjectModel.from_mesh(trimesh.creation.icosphere(subdivisions=4, radius=BALL), spacing=0.001, samples=400)


def test_each_point_has_the_quality_of_the_grasp_with_the_finger_there(ball: ObjectModel) -> None:
    X_PO = make_poses(random_rotations(np.random.default_rng(0), 1), np.array([[0.1, 0.2, 0.3]]))[0]
    contacts = Contacts(transform_points(X_PO, P_OC))
    found = improvement_map(ball, contacts, X_PO, 3, friction=0.5, edges=6, points=40)
    now = grasp_quality(ball, contacts, X_PO, friction=0.5, edges=6)
    assert found.current == now.radius > 0.0
    for row in range(0, 40, 8):
        moved = np.concatenate([contacts.p_PC[:3], transform_points(X_PO, found.p_OQ[row][None])])
        there = grasp_quality(ball, Contacts(moved), X_PO, friction=0.5, edges=6)
        assert found.radius[row] == pytest.approx(there.radius, rel=0.02, abs=1e-3)
    assert found.radius.max() > found.current > found.radius.min()


def test_levels_reach_from_a_lost_grasp_to_the_best_one(ball: ObjectModel) -> None:
    found = improvement_map(ball, Contacts(P_OC[:3]), np.eye(3, 4), 0, friction=0.5, edges=6, points=100)
    level = found.level
    assert level[found.radius.argmax()] == 1.0
    assert np.all(level[found.radius == 0.0] == -1.0)
    assert np.any(found.radius == 0.0)
    assert np.all((level > 0) == (found.radius > found.current))
    assert np.all(np.argsort(level, kind="stable")[-5:] == np.argsort(found.radius, kind="stable")[-5:])


def test_a_grasp_that_does_not_hold_can_only_improve(ball: ObjectModel) -> None:
    found = improvement_map(ball, Contacts(P_OC[[1, 2, 2]]), np.eye(3, 4), 2, friction=0.5, edges=6, points=60)
    assert found.current == 0.0
    assert found.level.min() == 0.0
    assert found.level.max() == 1.0


@pytest.fixture(scope="module")
def finger() -> FingerReach:
    return FingerReach(make_finger(), ReachParams(), np.random.default_rng(0))


def test_only_the_side_that_faces_the_finger_is_reached(ball: ObjectModel, finger: FingerReach) -> None:
    X_PO = translation(0.005, -0.075, 0.04)
    reached = reachable_points(finger, ball, X_PO, ball.samples.points, ball.samples.normals, np.random.default_rng(1))
    assert 10 < reached.sum() < 200
    assert np.all(ball.samples.normals[reached] @ [0.0, 1.0, 0.0] > -0.3)
    inside_out = reachable_points(
        finger, ball, X_PO, ball.samples.points, -ball.samples.normals, np.random.default_rng(1)
    )
    assert not inside_out.any()
    through_walls = reachable_points(
        finger,
        ball,
        X_PO,
        ball.samples.points,
        -ball.samples.normals,
        np.random.default_rng(1),
        params=ReachabilityParams(least_alignment=-1.0),
    )
    np.testing.assert_array_equal(through_walls & reached, reached)
    far = reachable_points(
        finger, ball, translation(0, 0.4, 0), ball.samples.points, ball.samples.normals, np.random.default_rng(1)
    )
    assert not far.any()


def test_what_another_finger_bars_is_not_reached(ball: ObjectModel, finger: FingerReach) -> None:
    X_PO = translation(0.005, -0.075, 0.04)
    free = reachable_points(finger, ball, X_PO, ball.samples.points, ball.samples.normals, np.random.default_rng(1))
    blocked_side = HandGeometry(np.array([[0.035, -0.045, 0.06]]), np.array([0.02]))
    some = reachable_points(
        finger, ball, X_PO, ball.samples.points, ball.samples.normals, np.random.default_rng(1), others=blocked_side
    )
    assert 0 < some.sum() < free.sum()
    assert not np.any(some & ~free)


def test_the_clearance_is_that_of_the_nearest_pair(finger: FingerReach) -> None:
    q = np.array([[0.0, 0.0, 0.0], [0.0, np.pi / 2, 0.0]])
    others = HandGeometry(np.array([[0.0, 0.0, 0.12], [5.0, 0.0, 0.0]]), np.array([0.01, 0.001]))
    straight, bent = finger_clearance(finger, q, others)
    assert straight == pytest.approx(0.12 - 0.089 - 0.009 - 0.01)
    assert bent == pytest.approx(np.hypot(0.015, 0.12) - 0.007 - 0.01)


def test_a_last_link_that_is_all_fingertip_is_one_of_the_last_two(finger: FingerReach) -> None:
    q, whole = np.array([[0.0, np.pi / 2, 0.0]]), make_finger()
    at_knuckle = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.005]])
    bare = dataclasses.replace(whole, body=np.array([0, 1]), p_BH=at_knuckle, radius=np.full(2, 0.007))
    others = HandGeometry(np.array([[0.0, 0.0, -0.02]]), np.array([0.02]))  # in which the knuckle is
    # The proximal link's sphere lies 5 mm beside the joint, the fingertip farther out.
    expected = np.hypot(0.005, 0.02) - 0.007 - 0.02
    assert finger_clearance(FingerReach(bare, ReachParams(), np.random.default_rng(0)), q, others)[0] == pytest.approx(
        expected
    )
    lone = dataclasses.replace(whole, body=np.array([0]), p_BH=at_knuckle[:1], radius=np.full(1, 0.007))
    assert finger_clearance(FingerReach(lone, ReachParams(), np.random.default_rng(0)), q, others)[0] > 0.03


def test_impossible_questions_are_refused(ball: ObjectModel) -> None:
    contacts = Contacts(P_OC)
    with pytest.raises(InvalidInputError, match="finger must be an integer from 0 to 3, not 4"):
        improvement_map(ball, contacts, np.eye(3, 4), 4, friction=0.5)
    with pytest.raises(InvalidInputError, match=r"points must be .*, not 401"):
        improvement_map(ball, contacts, np.eye(3, 4), 0, friction=0.5, points=401)
