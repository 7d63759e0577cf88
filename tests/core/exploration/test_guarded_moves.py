import numpy as np
import pytest
import trimesh

from tactopose_drake.core.evidence.hand_geometry import HandGeometry
from tactopose_drake.core.exploration.guarded_moves import GuardedMoves
from tactopose_drake.core.grasping.finger_geometry import FingerGeometry
from tactopose_drake.core.grasping.serial_chain import SerialChain
from tactopose_drake.core.poses import compose, inverse, make_poses, random_rotations, transform_points
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.errors import InvalidInputError
from tests.core.models import brick

BALL, TIP = 0.03, 0.008
START = np.array([[0.1, 0.0, 0.0], [0.1, 0.02, 0.0], [0.1, 0.06, 0.0]])
TOWARDS = np.tile([-1.0, 0.0, 0.0], (3, 1))


@pytest.fixture(scope="module")
def ball() -> ObjectModel:
    return ObjectModel.from_mesh(trimesh.creation.icosphere(subdivisions=5, radius=BALL), spacing=0.001, samples=200)


def test_a_fingertip_meets_a_ball_where_geometry_says(ball: ObjectModel) -> None:
    moves = GuardedMoves.lines(START, TOWARDS, 0.2, radius=TIP)
    felt = moves.feel(ball, np.eye(3, 4)[None])
    assert list(felt.is_hit[0]) == [True, True, False]
    reach = BALL + TIP
    half = np.sqrt(reach**2 - 0.02**2)
    np.testing.assert_allclose(felt.way[0, :2], [0.1 - reach, 0.1 - half], atol=2e-4)
    normals = np.array([[1.0, 0.0, 0.0], [half / reach, 0.02 / reach, 0.0]])
    np.testing.assert_allclose(felt.n_PC[0, :2], normals, atol=0.02)
    np.testing.assert_allclose(felt.p_PC[0, :2], BALL * normals, atol=5e-4)
    np.testing.assert_allclose(felt.facing[0, :2], normals[:, 0], atol=0.01)


def test_what_is_felt_moves_with_the_palm(ball: ObjectModel) -> None:
    generator = np.random.default_rng(0)
    X_QP = make_poses(random_rotations(generator, 1), generator.normal(size=(1, 3)))[0]
    X_PO = make_poses(random_rotations(generator, 4), 0.01 * generator.normal(size=(4, 3)))
    here = GuardedMoves.lines(START, TOWARDS, 0.2, radius=TIP).feel(ball, X_PO)
    moved = GuardedMoves.lines(transform_points(X_QP, START), TOWARDS @ X_QP[:, :3].T, 0.2, radius=TIP)
    there = moved.feel(ball, compose(X_QP, X_PO))
    np.testing.assert_array_equal(there.is_hit, here.is_hit)
    hit = here.is_hit
    np.testing.assert_allclose(there.way[hit], here.way[hit], atol=1e-9)
    back = transform_points(inverse(X_QP), there.p_PC.reshape(-1, 3)).reshape(here.p_PC.shape)
    np.testing.assert_allclose(back[hit], here.p_PC[hit], atol=1e-9)
    np.testing.assert_allclose((there.n_PC @ X_QP[:, :3])[hit], here.n_PC[hit], atol=1e-9)


def test_a_needle_feels_a_thin_wall() -> None:
    wall = ObjectModel.from_mesh(trimesh.creation.box((0.003, 0.08, 0.08)), max_grid_bytes=8_000_000, samples=200)
    felt = GuardedMoves.lines([[0.05, 0.0, 0.0]], [[-1.0, 0.0, 0.0]], 0.1).feel(wall, np.eye(3, 4)[None])
    assert felt.way[0, 0] == pytest.approx(0.05 - 0.0015, abs=3e-4)


def test_motions_are_clear_when_only_the_fingertip_meets_the_object(ball: ObjectModel) -> None:
    moves = GuardedMoves.lines(START[:1].repeat(4, axis=0), TOWARDS[:1].repeat(4, axis=0), 0.2, radius=TIP)
    # A knuckle behind the tip; one in front of it; one beside it that would meet the ball only after the tip has.
    offsets = np.array([[0.03, 0.0, 0.0], [-0.02, 0.0, 0.0], [0.0, 0.042, 0.0]])
    body = moves.tip[:3, :, None] + offsets[:, None, None]
    fingers = GuardedMoves(moves.tip[:3], TIP, body, np.array([0.01]))
    assert list(fingers.are_clear(ball, np.eye(3, 4)[None])[0]) == [True, False, True]
    inside = make_poses(np.eye(3), np.array([0.09, 0.0, 0.0]))
    assert not GuardedMoves.lines(START, TOWARDS, 0.1, radius=TIP).are_clear(ball, inside[None])[0, 0]


def test_motions_keep_off_the_rest_of_the_hand_until_they_end(ball: ObjectModel) -> None:
    tips = GuardedMoves.lines(START[[0, 2]], TOWARDS[:2], 0.2, radius=TIP)
    # A knuckle that trails the tip, in a base that it never quite leaves.
    moves = GuardedMoves(tips.tip, TIP, tips.tip[:, :, None] + [0.03, 0.0, 0.0], np.array([0.01]))
    here = np.eye(3, 4)[None]

    def apart(*centre: float) -> list[bool]:
        return list(moves.stay_apart(HandGeometry(np.array([centre]), np.array([0.01])), ball, here))

    assert apart(0.06, 0.0, 0.015) == [False, True]
    assert apart(0.06, 0.06, 0.0) == [True, False]
    assert apart(0.0, 0.06, 0.0) == [True, False], "the second meets no object and goes on"
    assert apart(0.0, 0.0, 0.0) == [True, True], "the first has met the object before"
    assert apart(0.14, 0.0, 0.0) == [True, True], "where it is joined to the hand"
    assert apart(0.06, 0.0, 0.019) == [True, True]
    # The farther the object may be, the farther the motion may go.
    away = make_poses(np.eye(3), np.array([0.0, 0.5, 0.0]))
    assert not moves.stay_apart(HandGeometry(np.zeros((1, 3)), np.array([0.01])), ball, np.stack([here[0], away]))[0]


def test_a_motion_that_starts_inside_ends_at_once(ball: ObjectModel) -> None:
    felt = GuardedMoves.lines([[0.02, 0.0, 0.0]], [[-1.0, 0.0, 0.0]], 0.1).feel(ball, np.eye(3, 4)[None])
    assert felt.is_hit[0, 0]
    assert felt.way[0, 0] < 1e-9


def test_a_fingers_motion_is_straight_in_its_joints() -> None:
    up = make_poses(np.eye(3), np.array([0.0, 0.0, 0.04]))
    chain = SerialChain(
        X_parent=np.stack([np.eye(3, 4), up]),
        axis=np.tile([0.0, 1.0, 0.0], (2, 1)),
        X_child=np.tile(np.eye(3, 4), (2, 1, 1)),
        coupling=np.eye(2),
        X_last_sensor=up,
        lower=np.full(2, -2.0),
        upper=np.full(2, 2.0),
        bodies=("first", "second"),
    )
    knuckles = np.array([[0.01, 0.0, 0.02], [0.0, 0.005, 0.03]])
    finger = FingerGeometry(chain, np.array([0.0, 0.0, 0.01]), TIP, np.arange(2), knuckles, np.array([0.009, 0.007]))
    q_start, q_goal = np.array([0.2, -0.4]), np.array([[1.0, 0.6], [-0.5, 0.1], [0.2, -0.3]])
    for start in (q_start, np.tile(q_start, (3, 1))):
        moves = GuardedMoves.of_finger(finger, start, q_goal, places=5)
        assert moves.tip.shape == (3, 5, 3)
        assert moves.radius == TIP
        for m, goal in enumerate(q_goal):
            for s, (a, b) in enumerate(np.linspace(q_start, goal, 5)):
                # Angles about y add up, from z towards x.
                first, both = np.array([np.sin(a), 0.0, np.cos(a)]), np.array([np.sin(a + b), 0.0, np.cos(a + b)])
                aside = np.array([np.cos(a), 0.0, -np.sin(a)])
                np.testing.assert_allclose(moves.tip[m, s], 0.04 * first + 0.05 * both, atol=1e-12)
                expected = [0.02 * first + 0.01 * aside, 0.04 * first + 0.03 * both + [0.0, 0.005, 0.0]]
                np.testing.assert_allclose(moves.body[m, s, :2], expected, atol=1e-12)
        np.testing.assert_array_equal(moves.body_radius[:2], [0.009, 0.007])
        assert moves.body.shape[2] == len(moves.body_radius)


def test_some_of_the_motions_can_be_taken() -> None:
    moves = GuardedMoves.lines(START, TOWARDS, 0.2, radius=TIP, step=0.05)
    assert moves.tip.shape == (3, 5, 3)
    np.testing.assert_array_equal(moves.take(np.array([2])).tip, moves.tip[2:])


def test_impossible_motions_are_refused() -> None:
    with pytest.raises(InvalidInputError, match=r"direction\[0\] must have the length .*, not 2"):
        GuardedMoves.lines(START, 2 * TOWARDS, 0.1)
    with pytest.raises(InvalidInputError, match=r"length must be .*, not 0"):
        GuardedMoves.lines(START, TOWARDS, 0.0)
    with pytest.raises(InvalidInputError, match="at least 2 places"):
        GuardedMoves(np.zeros((3, 1, 3)), TIP, np.zeros((3, 1, 0, 3)), np.zeros(0))
    with pytest.raises(InvalidInputError, match=r"body must have the shape .*"):
        GuardedMoves(np.zeros((3, 2, 3)), TIP, np.zeros((3, 2, 1, 3)), np.zeros(0))


@pytest.mark.parametrize(("x", "is_apart"), [(0.035, False), (0.02, True)])
def test_where_a_motion_ends_the_finger_keeps_off_others_and_beyond_it_does_not_come(x: float, is_apart: bool) -> None:
    """A fingertip of 8 mm that comes in steps of 5 mm, and meets a face at 30 mm when its centre is at 35 mm."""
    box = brick(0.06, 0.09, 0.13)
    moves = GuardedMoves.lines([[0.1, 0.0, 0.0]], [[-1.0, 0.0, 0.0]], 0.09, radius=0.008, step=0.005)
    beside = HandGeometry(np.array([[x, 0.012, 0.0]]), np.array([0.0045]))
    assert moves.stay_apart(beside, box, np.eye(3, 4)[None])[0] == is_apart
