import dataclasses

import numpy as np

from tactopose_drake.core.evidence.contact_reading import ErrorScales
from tactopose_drake.core.evidence.evidence import Evidence
from tactopose_drake.core.motion.rigid_motion import Motion
from tactopose_drake.core.poses import (
    compose,
    exp_so3,
    make_poses,
    random_rotations,
    retract,
    transform_points,
)
from tactopose_drake.core.tracking.contact_errors import averaged_variances, calibration_excess, with_errors
from tactopose_drake.core.tracking.frame import PoseMeasurement
from tactopose_drake.core.tracking.keyframes import (
    Keyframe,
    Touch,
    follow_touch,
    make_window,
    move_keyframes,
    past_cost,
    past_information,
)
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
    motions = [Motion(0.8 * generator.normal(size=6), root @ root.T) for root in roots]
    for motion in motions:
        (moved,) = move_keyframes((moved,), motion)
    pose = compose(motions[1].pose, motions[0].pose)
    np.testing.assert_allclose(moved.points, transform_points(pose, frame.points), atol=1e-12)
    # Draws of the motions' errors, to first order, move the points as the variances say.
    draws, shifts, tilts = [], [], []
    for _ in range(4000):
        X = np.eye(3, 4)
        for motion, root in zip(motions, 1e-3 * roots, strict=True):
            error = root @ generator.normal(size=6)
            X = compose(np.column_stack([exp_so3(error[:3]), error[3:]]), compose(motion.pose, X))
        shifts.append(1e3 * (transform_points(X, frame.points) - moved.points))
        draws.append(np.einsum("ki,ki->k", shifts[-1], moved.normals))
        tilts.append(1e3 * (frame.n_PC @ X[:, :3].T - moved.normals))
    np.testing.assert_allclose(np.var(draws, axis=0), moved.added_variances[:, 0], rtol=0.1)
    np.testing.assert_allclose(moved.added_variances[:, 1], 0.5 * np.var(tilts, axis=0).sum(axis=1), rtol=0.1)
    # Where no normal is known it is that along any axis.
    anyhow = dataclasses.replace(moved, n_PC=None).added_variances[:, 0]
    np.testing.assert_allclose(np.var(shifts, axis=0).mean(axis=1), anyhow, rtol=0.1)


def test_the_order_of_the_fingers_does_not_matter() -> None:
    before, now, order = feel(0), feel(0), [3, 0, 5, 1, 4, 2]
    generator, step = np.random.default_rng(3), Motion(np.array([0.0, 0.3, 0.0, 0.0, 0.0, 0.1]), np.zeros((6, 6)))
    (before,) = move_keyframes((before,), step)
    noisy = make_poses(exp_so3(step.twist[:3]), step.twist[3:])
    n_PC = now.n_PC @ noisy[:, :3].T + 0.02 * generator.normal(size=(6, 3))
    n_PC /= np.linalg.norm(n_PC, axis=1, keepdims=True)
    p_PC = transform_points(noisy, now.p_PC) + 0.001 * generator.normal(size=(6, 3))
    now = dataclasses.replace(now, p_PC=p_PC, n_PC=n_PC)
    turned = dataclasses.replace(
        now, p_PC=p_PC[order], n_PC=n_PC[order], variances=now.variances[order], sources=tuple(NAMES[i] for i in order)
    )
    assert not before.tells_other_than(now, PARAMS)
    assert not before.tells_other_than(turned, PARAMS)
    joined, other = before.joined_by(now, 8), before.joined_by(turned, 8)
    np.testing.assert_allclose(joined.p_PC, 0.5 * (before.points + p_PC))
    middle = before.normals + n_PC
    np.testing.assert_allclose(joined.n_PC, middle / np.linalg.norm(middle, axis=1, keepdims=True), atol=1e-12)
    np.testing.assert_allclose(other.p_PC, joined.p_PC[order])
    np.testing.assert_allclose(other.n_PC, joined.n_PC[order])
    # Another finger at the place of one of them is news, whatever the order.
    assert before.tells_other_than(dataclasses.replace(turned, sources=(*turned.sources[:5], "g")), PARAMS)


def test_fingers_that_say_no_normals_are_compared_by_their_points() -> None:
    with_normals = feel(0)
    without = dataclasses.replace(with_normals, n_PC=None)
    assert not without.tells_other_than(with_normals, PARAMS)
    assert not with_normals.tells_other_than(without, PARAMS)
    assert without.joined_by(with_normals, 8).n_PC is not None
    # Also where their order differs.
    turned = Keyframe.of_now(read(touch(X_PO, np.random.default_rng(0))[::-1]), NAMES[::-1])
    assert not without.tells_other_than(turned, PARAMS)
    elsewhere = [dataclasses.replace(feel(seed), n_PC=n_PC) for seed, n_PC in ((1, None), (2, feel(2).n_PC))]
    fewer = Keyframe.of_now(read(touch(X_PO, np.random.default_rng(3))[:3]), NAMES[:3])
    past = make_window((*elsewhere, fewer), PARAMS).past
    assert past is not None
    assert len(past) == 12
    assert past.n_PC is None


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


def test_the_mean_of_a_touch_is_as_sure_as_the_calibration_seems_to_be() -> None:
    params, contacts = PoseTrackerParams(), touch(X_PO, np.random.default_rng(0))
    factors = np.array([4.0, 2.25])
    reading = with_errors(read(contacts), ErrorScales(calibration=factors), params)
    mean = dataclasses.replace(feel(), p_PC=contacts.p_PC + 0.001, frames=5)
    seen = PoseMeasurement(0.0, X_PO, np.diag(np.repeat([0.1, 0.01], 3) ** 2))
    felt = Touch(Evidence(contacts), reading, (mean,), seen).averaged(params)
    expected = averaged_variances(contacts, params, 5) + calibration_excess(contacts, params, factors)
    np.testing.assert_allclose(np.square(felt.contacts.sigma_position), expected[:, 0])
    np.testing.assert_allclose(np.square(felt.contacts.sigma_normal), expected[:, 1])
    np.testing.assert_array_equal(felt.contacts.p_PC, mean.p_PC)
    assert felt.prior is not None
    np.testing.assert_allclose(felt.prior.sigmas, np.repeat([0.1, 0.01], 3))


def test_a_touch_is_forgotten_when_the_motion_since_is_not_known() -> None:
    frames = follow_touch((), feel(), PARAMS)
    motion = Motion(np.zeros(6), np.diag(np.repeat([0.0, 0.01**2], 3)))
    moved = move_keyframes(frames, motion)
    other = Keyframe.of_now(read(touch(X_PO, np.random.default_rng(1))[:4]), NAMES[:4])
    assert len(follow_touch(frames, other, PARAMS)) == 2
    assert len(follow_touch(moved, other, PARAMS)) == 1
    assert make_window((*moved, other), PARAMS).past is None


def test_a_touch_that_is_felt_again_after_another_counts_once() -> None:
    """Its errors are the same as at the first time."""
    other = Keyframe.of_now(read(touch(X_PO, np.random.default_rng(1))[:4]), NAMES[:4])
    frames: tuple[Keyframe, ...] = ()
    for now in (feel(), other, feel()):
        frames = follow_touch(frames, now, PARAMS)
    assert len(frames) == 3
    window = make_window(frames, PARAMS)
    assert window.count == 2
    assert window.past is not None
    np.testing.assert_array_equal(window.past.p_PC, other.p_PC)


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


def test_of_alike_touches_each_counts_by_their_effective_number() -> None:
    """So do n measurements with the same correlation of any two: as n / (1 + (n - 1) r), that of now among them."""
    box, params = make_box(), PoseTrackerParams()
    near = retract(X_PO, np.array([0.0, 0.0, 0.0, 0.0005, 0.0, 0.0]))[None]
    before = Keyframe.of_now(read(touch(X_PO, np.random.default_rng(2))), NAMES)
    fewer = Keyframe.of_now(read(touch(X_PO, np.random.default_rng(1))[:3]), NAMES[:3])
    cost = [past_cost(box, params, make_window((before,) * n + (fewer,), PARAMS), near)[0] for n in (1, 2, 3)]
    share = params.window.lasting_share
    np.testing.assert_allclose(np.array(cost) / cost[0], [n * (1.0 + share) / (1.0 + n * share) for n in (1, 2, 3)])


def test_what_the_past_tells_of_a_pose_is_how_its_cost_bends_there_but_for_places_that_are_touched_now() -> None:
    box, params = make_box(), PoseTrackerParams()
    contacts = touch(X_PO, np.random.default_rng(2))
    now = Keyframe.of_now(read(touch(X_PO, np.random.default_rng(1))[:3]), NAMES[:3])
    others, every, same = (
        make_window((Keyframe.of_now(read(contacts[index]), tuple(NAMES[i] for i in index)), now), params.window)
        for index in ([3, 4, 5], [0, 1, 2, 3, 4, 5], [0, 1])
    )
    information = past_information(box, params, others, X_PO[None])[0]
    for slide in np.eye(6)[3:]:  # The faces are even: along them the cost is a parabola.
        ends = np.stack([retract(X_PO, sign * 3e-4 * slide) for sign in (-1.0, 0.0, 1.0)])
        below, middle, above = past_cost(box, params, others, ends)
        np.testing.assert_allclose(slide @ information @ slide, (below - 2.0 * middle + above) / 3e-4**2, rtol=0.02)
    np.testing.assert_allclose(past_information(box, params, every, X_PO[None])[0], information, rtol=1e-9, atol=1e-6)
    for window in (same, make_window((now,), params.window)):
        np.testing.assert_array_equal(past_information(box, params, window, X_PO[None]), np.zeros((1, 6, 6)))
    assert past_information(box, params, others, np.zeros((0, 3, 4))).shape == (0, 6, 6)
