import math

import numpy as np
import pytest

from tactopose_drake.core.motion.object_motion import MotionNoise, move_with_palm
from tactopose_drake.core.motion.rigid_motion import Motion
from tactopose_drake.core.objectives.surface_contact import SurfaceContact
from tactopose_drake.core.poses import compose, inverse, make_poses, random_rotations, retract, transform_points
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.slip.slip_by_surface import (
    PoseChange,
    SlipTest,
    _between,
    _has_slipped,
    _way,
    detect_by_surface,
)
from tactopose_drake.core.slip.slip_params import SlipParams
from tests.core.tracking.boxes import SIGMA_POSITION, draw_biases, make_box, read, touch

PARAMS = SlipParams()
X_PO = make_poses(random_rotations(np.random.default_rng(0), 1), np.array([[0.02, 0.0, 0.1]]))[0]
REST = move_with_palm(MotionNoise(), 0.01, slips=False)
WAY = np.array([0.0, 0, 0, 0.6, -0.5, 0.62])


@pytest.fixture(scope="module")
def box() -> ObjectModel:
    return make_box()


def change(X_after: np.ndarray, motion: Motion = REST) -> PoseChange:
    return PoseChange(X_after, np.zeros((6, 2)), motion)


def first_slip(box: ObjectModel, seed: int, step: np.ndarray, frames: int, begin: int = 30) -> int | None:
    """At which frame after the begin an object that moves by increments is found to slip, of so many; None if never."""
    generator, test, X = np.random.default_rng(seed), SlipTest(), X_PO
    bias = draw_biases(generator, 0.002, 0.1)  # errors of the hand, larger than told
    for i in range(begin + frames):
        X = retract(X, step) if i >= begin else X
        test, slips = detect_by_surface(box, PARAMS, test, read(touch(X, generator, bias)), change(X_PO))
        if slips:
            return i - begin
    return None


@pytest.mark.parametrize(("recent", "earlier"), [(2, 3), (5, 10), (1, 4)])
def test_a_motion_counts_by_how_far_it_takes_the_frames_apart_that_are_compared(recent: int, earlier: int) -> None:
    """Poses are sums of the motions up to each: the mean of the recent ones less that of the earlier ones."""
    count = earlier + 2 * recent
    poses = np.tril(np.ones((count, count)))  # by the motions
    share = poses[-recent:].mean(axis=0) - poses[:earlier].mean(axis=0)
    motions = np.random.default_rng(0).uniform(size=(count + 3, 1, 1)) * np.eye(6)
    np.testing.assert_allclose(_between(motions, recent, earlier), np.tensordot(share, motions[3:], 1))


def test_the_way_of_an_increment_is_that_of_what_is_touched() -> None:
    generator = np.random.default_rng(1)
    points = X_PO[:, 3] + 0.05 * generator.normal(size=(5, 3))
    for u in 1e-5 * generator.normal(size=(4, 6)) * np.repeat([10.0, 1.0], 3):
        moved = transform_points(compose(retract(X_PO, u), inverse(X_PO)), points) - points
        assert _way(points, X_PO, u) == pytest.approx(math.sqrt(np.mean(np.sum(moved**2, axis=1))), rel=1e-3)


@pytest.mark.parametrize("roughness", [0.0, 0.0015])
@pytest.mark.parametrize("earlier", [3, 10])
@pytest.mark.parametrize(("recent", "threshold"), [(2, PARAMS.few_threshold), (5, PARAMS.many_threshold)])
def test_a_slip_is_told_by_what_the_means_of_both_parts_are_known_to(
    box: ObjectModel, recent: int, threshold: float, earlier: int, roughness: float
) -> None:
    """Two contacts across a slide, by frames of known noise: the difference of two means has both means' variances."""
    params = SlipParams(**{f"{'many' if recent == 2 else 'few'}_threshold": 1e9})
    contacts = touch(X_PO, np.random.default_rng(0))
    J = SurfaceContact(box.grid, contacts).rows_of_contacts(X_PO[None])[1][0, :, :4]
    still = Motion(np.zeros(6), np.zeros((6, 6)))
    along = np.concatenate([np.zeros(3), X_PO[:, 2]])  # of the increment, in P; across the last two faces
    rough = PoseChange(X_PO, np.tile([roughness**2, 0.0], (6, 1)), still)  # of which a share changes
    variance = SIGMA_POSITION**2 * (1.0 / recent + 1.0 / earlier) + params.rough_share * roughness**2
    way = math.sqrt(0.5 * threshold * variance)
    for share, slips in ((0.95, False), (1.05, True)):
        history = np.zeros((earlier + 2 * recent, 6, 4))
        history[-recent:] = J @ (share * way * along)
        test = SlipTest(history, np.zeros((len(history), 6, 6)), (1.0, 1.0), X_PO)
        assert _has_slipped(params, test, J, read(contacts), rough) == slips


def test_what_moves_less_than_the_least_distance_is_no_slip_however_sure_it_is(box: ObjectModel) -> None:
    contacts, still = touch(X_PO, np.random.default_rng(0)), Motion(np.zeros(6), np.zeros((6, 6)))
    J = SurfaceContact(box.grid, contacts).rows_of_contacts(X_PO[None])[1][0, :, :4]
    for share, slips in ((0.9, False), (1.1, True)):
        history = np.zeros((14, 6, 4))
        history[-2:] = J @ np.concatenate([np.zeros(3), share * PARAMS.least_distance * X_PO[:, 2]])
        test = SlipTest(history, np.zeros((14, 6, 6)), (0.001, 0.001), X_PO)
        assert _has_slipped(PARAMS, test, J, read(contacts), change(X_PO, still)) == slips


def test_an_object_that_is_held_does_not_slip_however_wrong_the_hand_is(box: ObjectModel) -> None:
    assert [first_slip(box, seed, np.zeros(6), 300, 0) for seed in range(3)] == [None] * 3


@pytest.mark.parametrize("speed", [0.1, 0.2])
def test_a_slide_is_noticed_within_50_ms_of_its_first_two_millimetres(box: ObjectModel, speed: float) -> None:
    late = 0.05 + 0.002 / speed
    found = [first_slip(box, seed, 0.01 * speed * WAY, 40) for seed in range(5)]
    assert all(frame is not None and 0.01 * (frame + 1) <= late for frame in found), found


def test_a_correction_of_the_pose_is_no_slip(box: ObjectModel) -> None:
    generator, test, X = np.random.default_rng(1), SlipTest(), retract(X_PO, 0.003 * WAY)
    for i in range(60):
        # The estimate creeps to where the object is.
        X_after = X_PO if i > 30 else retract(X, -0.0001 * WAY)
        test, slips = detect_by_surface(box, PARAMS, test, read(touch(X_PO, generator)), change(X_after))
        assert not slips
        X = X_after


def test_what_the_fingertips_may_have_done_themselves_is_no_slip(box: ObjectModel) -> None:
    unsure = Motion(np.zeros(6), np.diag(np.repeat([0.0, 1e-4], 3)))
    for motion, expected in ((REST, True), (unsure, False)):
        generator, test, called = np.random.default_rng(2), SlipTest(), False
        for i in range(45):
            X = retract(X_PO, max(0, i - 30) * 0.0005 * WAY)
            test, slips = detect_by_surface(box, PARAMS, test, read(touch(X, generator)), change(X_PO, motion))
            called = called or slips
        assert called == expected


def test_nor_is_it_one_when_they_have_just_stopped(box: ObjectModel) -> None:
    unsure = Motion(np.zeros(6), np.diag(np.repeat([0.0, 1e-4], 3)))
    for while_moving, expected in ((REST, True), (unsure, False)):
        generator, test, called = np.random.default_rng(4), SlipTest(), False
        for i in range(60):
            X = retract(X_PO, 0.001 * np.clip(i - 30, 0, 4) * WAY)
            motion = while_moving if 30 < i <= 34 else REST
            test, slips = detect_by_surface(box, PARAMS, test, read(touch(X, generator)), change(X_PO, motion))
            called = called or slips
        assert called == expected


def test_the_noise_is_learnt_from_single_frames(box: ObjectModel) -> None:
    generator, test, exact = np.random.default_rng(3), SlipTest(), touch(X_PO, np.random.default_rng(0))
    for _ in range(60):
        test, _ = detect_by_surface(box, PARAMS, test, read(exact), change(X_PO))
    assert max(test.noise) < 0.05
    for _ in range(60):
        test, _ = detect_by_surface(box, PARAMS, test, read(touch(X_PO, generator)), change(X_PO))
    assert min(test.noise) > 0.7
    assert max(test.noise) < 1.4
