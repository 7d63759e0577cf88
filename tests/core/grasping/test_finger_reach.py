import dataclasses

import numpy as np
import pytest
import trimesh

from tactopose_drake.core.grasping.finger_geometry import FingerGeometry
from tactopose_drake.core.grasping.finger_reach import FingerReach, ReachParams, alignment
from tactopose_drake.core.grasping.serial_chain import SLIDING_ARM
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.errors import InvalidInputError
from tests.core.grasping.fingers import RADIUS, make_finger, translation

BALL = 0.03


@pytest.fixture(scope="module")
def ball() -> ObjectModel:
    return ObjectModel.from_mesh(trimesh.creation.icosphere(subdivisions=4, radius=BALL), spacing=0.001, cache=False)


@pytest.fixture(scope="module")
def finger() -> FingerGeometry:
    return make_finger()


@pytest.fixture(scope="module")
def reach(finger) -> FingerReach:
    return FingerReach(finger, ReachParams(), np.random.default_rng(0))


X_PO = translation(0.005, -0.075, 0.04)


@pytest.fixture(scope="module")
def touches(reach, ball):
    return reach.touches(ball.grid, X_PO, np.random.default_rng(1), 20)


def test_spheres_ride_on_their_bodies(finger):
    straight, bent = finger.spheres(np.array([[0.0, 0.0, 0.0], [0.0, 0.0, np.pi / 2]]))
    np.testing.assert_allclose(straight, [[0, 0, 0.015], [0, 0, 0.03], [0, 0, 0.05]], atol=1e-12)
    np.testing.assert_allclose(bent, [[0, 0, 0.015], [0, 0, 0.03], [0, -0.005, 0.045]], atol=1e-12)


def test_touches_lie_on_the_object_with_its_normals(touches):
    assert len(touches) >= 5
    from_center = touches.p_PC - X_PO[:, 3]
    np.testing.assert_allclose(np.linalg.norm(from_center, axis=1), BALL, atol=4e-4)
    cosines = np.einsum("ni,ni->n", from_center / BALL, touches.n_PC)
    assert cosines.min() > np.cos(np.radians(3))


def test_fingertip_is_tangent_and_the_finger_clear(touches, finger):
    gap = np.linalg.norm(finger.tip(touches.q) - X_PO[:, 3], axis=1) - BALL
    np.testing.assert_allclose(gap, RADIUS, atol=4e-4)
    bones = np.linalg.norm(finger.spheres(touches.q) - X_PO[:, 3], axis=2) - BALL - finger.radius
    assert bones.min() > ReachParams().clearance - 5e-4


def test_closing_presses_inwards_with_the_stated_force(touches, finger):
    params = ReachParams()
    for i in range(len(touches)):
        _, J = finger.chain.point_jacobians(touches.q[i : i + 1], finger.p_ST)
        # The springs' torques at one newton of push are those of one newton against the normal.
        np.testing.assert_allclose(params.stiffness * touches.closing[i], -J[0].T @ touches.n_PC[i], atol=0.02)
        assert touches.n_PC[i] @ J[0] @ touches.closing[i] < 0


def test_a_joint_that_slides_gives_way_as_if_it_turned_at_its_arm(finger, ball):
    chain = finger.chain
    limits = {"lower": np.append(-0.02, chain.lower[1:]), "upper": np.append(0.02, chain.upper[1:])}
    sliding = dataclasses.replace(finger, chain=dataclasses.replace(chain, sliding=frozenset({0}), **limits))
    params = ReachParams()
    found = FingerReach(sliding, params, np.random.default_rng(0)).touches(
        ball.grid, X_PO, np.random.default_rng(1), 20
    )
    assert len(found) >= 3
    _, J = sliding.chain.point_jacobians(found.q, sliding.p_ST)
    spring = params.stiffness / np.array([SLIDING_ARM, 1.0, 1.0]) ** 2  # N/m, and N m/rad
    pressed = -np.einsum("nim,ni->nm", J, found.n_PC)  # by 1 N
    np.testing.assert_allclose(found.closing * spring, pressed, atol=1e-9)
    assert np.abs(pressed[:, 0]).max() > 0.05


def test_opening_lifts_the_fingertip(touches, finger):
    gap = np.linalg.norm(finger.tip(touches.q_open) - X_PO[:, 3], axis=1) - BALL - RADIUS
    assert gap.min() > 0.4 * ReachParams().lift - 5e-4


def test_touches_come_by_rising_cost(touches):
    assert np.all(np.diff(touches.cost) >= 0)


def test_sharp_edges_are_left_alone(reach):
    box = ObjectModel.from_mesh(trimesh.creation.box((0.05, 0.05, 0.05)), spacing=0.001, cache=False)
    found = reach.touches(box.grid, X_PO, np.random.default_rng(1), 20)
    assert len(found) >= 3
    # Every touch lies on a face, at least a millimetre from the next face.
    p_OC = np.sort(np.abs(found.p_PC - X_PO[:, 3]), axis=1)
    np.testing.assert_allclose(p_OC[:, 2], 0.025, atol=3e-4)
    assert p_OC[:, 1].max() < 0.024


def test_joint_limits_are_kept(touches, finger):
    for q in (touches.q, touches.q_open):
        assert np.all(q >= finger.chain.lower - 1e-12)
        assert np.all(q <= finger.chain.upper + 1e-12)


def test_nothing_to_touch_far_away(reach, ball):
    assert len(reach.touches(ball.grid, translation(0.0, -0.4, 0.0), np.random.default_rng(1), 20)) == 0


def test_no_touch_from_within_a_swallowed_finger(reach, ball):
    assert len(reach.touches(ball.grid, translation(0.0, 0.0, 0.04), np.random.default_rng(1), 20)) == 0


@pytest.fixture(scope="module")
def long_tip(finger) -> FingerReach:
    """The same finger with a fingertip that is as thick as its round end from the last joint on."""
    bare = dataclasses.replace(finger, p_SL=np.array([0.0, 0.0, -0.02]), body=finger.body[:2], p_BH=finger.p_BH[:2])
    bare = dataclasses.replace(bare, radius=bare.radius[:2])
    return FingerReach(bare, ReachParams(), np.random.default_rng(0))


def test_a_straight_part_touches_only_when_it_may(long_tip, ball):
    ends = long_tip.touches(ball.grid, X_PO, np.random.default_rng(1), 60)
    sides = long_tip.touches(ball.grid, X_PO, np.random.default_rng(1), 400, with_sides=True)
    geometry = long_tip.geometry
    along = np.concatenate([geometry.along_straight_part(3), geometry.p_ST[None]])
    for found in (ends, sides):
        # Nothing of the fingertip is deeper in the object than where it touches.
        gaps = np.linalg.norm(geometry.fixed_points(found.q, along) - X_PO[:, 3], axis=2) - BALL - RADIUS
        assert gaps.min() > -8e-4
        np.testing.assert_allclose(gaps.min(axis=1), 0.0, atol=8e-4)
        np.testing.assert_allclose(np.linalg.norm(found.p_PC - X_PO[:, 3], axis=1), BALL, atol=4e-4)

    def from_end(found):
        return np.linalg.norm(geometry.tip(found.q) - X_PO[:, 3], axis=1) - BALL - RADIUS

    assert from_end(ends).max() < 4e-4
    assert from_end(sides).max() > 2e-3
    assert np.all(np.diff(sides.cost) >= 0)


def test_a_finger_waits_clear_of_the_object_farthest_first(reach, ball):
    q = reach.waiting(ball.grid, X_PO, 0.004)
    assert len(q) > 10
    centres, radius = reach.geometry.all_spheres(q)
    gaps = (np.linalg.norm(centres - X_PO[:, 3], axis=2) - BALL - radius).min(axis=1)
    assert gaps.min() > 0.004 - 5e-4
    assert gaps[0] == pytest.approx(gaps.max(), abs=5e-4)
    assert len(reach.waiting(ball.grid, translation(0.0, 0.0, 0.0), 0.004)) == 0


def test_a_fingertip_that_a_push_does_not_move_is_not_aligned():
    slides_along_x = np.diag([0.001, 0.0, 0.0])
    cosine = alignment(np.stack([slides_along_x, slides_along_x]), np.eye(3)[:2])
    np.testing.assert_array_equal(cosine, [1.0, 0.0])


def test_bad_parameter_is_named():
    with pytest.raises(InvalidInputError, match=r"ReachParams\.lift must be .*, not -1"):
        ReachParams(lift=-1.0).validate()
