import dataclasses

import numpy as np

from tactopose_drake.core.poses import compose, exp_so3, make_poses, random_rotations, retract, transform_points
from tactopose_drake.core.tracking.keyframes import Keyframe, follow_touch, make_window, move_keyframes, past_cost
from tactopose_drake.core.tracking.motion_prediction import Motion
from tactopose_drake.core.tracking.tracker_params import PoseTrackerParams, WindowParams
from tests.core.tracking.boxes import make_box, read, touch

PARAMS = WindowParams()
NAMES = tuple("abcdef")
X_PO = make_poses(random_rotations(np.random.default_rng(0), 1), np.array([[0.02, 0.0, 0.1]]))[0]


def feel(seed: int = 0) -> Keyframe:
    return Keyframe.of_now(read(touch(X_PO, np.random.default_rng(seed))), NAMES)


def test_contacts_move_with_the_object_and_their_error_is_that_of_all_motions() -> None:
    generator = np.random.default_rng(1)
    frame, moved = feel(), feel()
    roots = 0.01 * generator.normal(size=(2, 6, 6))
    motions = [Motion(0.1 * generator.normal(size=6), root @ root.T) for root in roots]
    for motion in motions:
        (moved,) = move_keyframes((moved,), motion)
    pose = compose(motions[1].pose, motions[0].pose)
    np.testing.assert_allclose(moved.points, transform_points(pose, frame.points), atol=1e-12)
    # Draws of the motions' errors, to first order, move the points as the variances say.
    draws = []
    for _ in range(4000):
        X = np.eye(3, 4)
        for motion, root in zip(motions, 1e-3 * roots, strict=True):
            error = root @ generator.normal(size=6)
            X = compose(np.column_stack([exp_so3(error[:3]), error[3:]]), compose(motion.pose, X))
        draws.append(np.einsum("ki,ki->k", transform_points(X, frame.points) - moved.points, moved.normals))
    np.testing.assert_allclose(1e6 * np.var(draws, axis=0), moved.added_variances[:, 0], rtol=0.15)


def test_the_same_touch_again_is_averaged_and_another_one_is_kept() -> None:
    generator, exact = np.random.default_rng(0), touch(X_PO, np.random.default_rng(0))
    frames: tuple[Keyframe, ...] = ()
    for _ in range(6):
        noisy = dataclasses.replace(exact, p_PC=exact.p_PC + 1e-3 * generator.normal(size=exact.p_PC.shape))
        now = Keyframe.of_now(read(noisy), NAMES)
        frames = follow_touch(frames, now, PARAMS)
    assert len(frames) == 1
    assert frames[0].frames == 6
    off = [np.linalg.norm(one.points - exact.p_PC) for one in (now, frames[0])]
    assert off[1] < 0.7 * off[0]
    fewer = touch(X_PO, np.random.default_rng(9))[:4]
    frames = follow_touch(frames, Keyframe.of_now(read(fewer), NAMES[:4]), PARAMS)
    assert [len(frame.sources) for frame in frames] == [6, 4]
    window = make_window(frames, PARAMS)
    assert window.count == 2
    assert len(window.now.p_PC) == 4
    assert window.past is not None
    assert len(window.past) == 6


def test_a_touch_is_forgotten_when_the_motion_since_is_not_known() -> None:
    frames = follow_touch((), feel(), PARAMS)
    motion = Motion(np.zeros(6), np.diag(np.repeat([0.0, 0.01**2], 3)))
    moved = move_keyframes(frames, motion)
    other = Keyframe.of_now(read(touch(X_PO, np.random.default_rng(1))[:4]), NAMES[:4])
    assert len(follow_touch(frames, other, PARAMS)) == 2
    assert len(follow_touch(moved, other, PARAMS)) == 1
    assert make_window((*moved, other), PARAMS).past is None


def test_fewer_keyframes_than_told_are_kept() -> None:
    frames: tuple[Keyframe, ...] = ()
    for i in range(20):
        contacts = touch(X_PO, np.random.default_rng(i))
        k = 3 + i % 2
        some = type(contacts)(contacts.p_PC[:k], None if contacts.n_PC is None else contacts.n_PC[:k])
        frames = follow_touch(frames, Keyframe.of_now(read(some), NAMES[:k]), PARAMS)
    assert len(frames) == PARAMS.max_keyframes + 1


def test_touches_of_the_past_tell_poses_apart_but_never_outweigh_a_slip() -> None:
    box, params = make_box(), PoseTrackerParams()
    elsewhere = retract(X_PO, np.array([0.0, 0, 0, 0.1, 0, 0]))
    now, both = touch(X_PO, np.random.default_rng(1)), np.stack([X_PO, elsewhere])
    before = Keyframe.of_now(read(touch(X_PO, np.random.default_rng(2))), NAMES)
    fewer = Keyframe.of_now(read(now[:3]), NAMES[:3])
    window = make_window((before, fewer), PARAMS)
    assert window.count == 2
    right, wrong = past_cost(box, params, window, both)
    assert wrong > right
    assert wrong - right < 0.5 * 18 - np.log(PARAMS.slip_probability)
    np.testing.assert_array_equal(
        past_cost(box, params, make_window((Keyframe.of_now(read(now), NAMES),), PARAMS), both), np.zeros(2)
    )
