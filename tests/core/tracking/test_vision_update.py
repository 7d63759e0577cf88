import dataclasses
import math

import numpy as np
import pytest
import trimesh

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.evidence.evidence import Evidence
from tactopose_drake.core.evidence.gaussian_prior import GaussianPrior
from tactopose_drake.core.motion.rigid_motion import Motion, MotionHistory
from tactopose_drake.core.poses import (
    compose,
    exp_so3,
    increments_between,
    inverse,
    make_poses,
    random_rotations,
    retract,
)
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.slip.slip_by_surface import SlipTest
from tactopose_drake.core.synthetic.synthetic_touch import touch_surface
from tactopose_drake.core.tracking.frame import Frame, PoseMeasurement
from tactopose_drake.core.tracking.pose_belief import VisionRecord
from tactopose_drake.core.tracking.pose_tracker import PoseTracker
from tactopose_drake.core.tracking.tracked_modes import TrackedModes
from tactopose_drake.core.tracking.tracker_params import VisionParams
from tactopose_drake.core.tracking.vision_update import Sighting, fuse, read_vision, see, update_with_pose
from tests.core.tracking.boxes import read

X_PO = make_poses(random_rotations(np.random.default_rng(0), 1), np.array([[0.02, 0.0, 0.1]]))[0]
SEEN = np.diag(np.repeat([math.radians(5.0), 0.01], 3) ** 2)
VISION = VisionParams()
LOG_OUTLIER = math.log(0.05 / (8.0 * math.pi**2))


@pytest.fixture(scope="module")
def box() -> ObjectModel:
    return ObjectModel.from_mesh(trimesh.creation.box((0.05, 0.08, 0.11)), cache=False)


def mode(sigma: float) -> TrackedModes:
    return TrackedModes.independent(X_PO[None], np.diag(np.repeat([10.0 * sigma, sigma], 3) ** 2)[None], 1)


def seen(way: float, share: float) -> Sighting:
    return Sighting(PoseMeasurement(0.0, retract(X_PO, np.array([0, 0, 0, way, 0, 0])), SEEN), share)


@pytest.mark.parametrize("share", [1.0, 1.0 / 15.0, 1e-3])
def test_what_is_an_outlier_is_one_however_often_pictures_come(box: ObjectModel, share: float) -> None:
    after, is_inlier = update_with_pose(box, mode(0.003), seen(0.1, share), LOG_OUTLIER)
    assert not is_inlier[0]
    np.testing.assert_array_equal(after.X_PO[0], X_PO)
    np.testing.assert_allclose(after.log_weight, share * LOG_OUTLIER)


def test_a_picture_is_an_outlier_where_any_pose_of_a_room_is_likelier(box: ObjectModel) -> None:
    """On either side of where the densities are equal; rotations fill 8 pi^2 rad^3."""
    settings = VisionParams()
    tracker, sigmas = PoseTracker(box), np.repeat([math.radians(5.0), 0.01], 3)
    guess = GaussianPrior(X_PO, 0.01, math.radians(5.0))
    belief = tracker.step(tracker.start(), Frame(0.0, Evidence(Contacts.empty(), prior=guess)))
    expected = belief.modes.covariance[0] + np.diag(sigmas**2)
    log_peak = -0.5 * np.linalg.slogdet(2.0 * np.pi * expected)[1]
    log_room = math.log(settings.outlier_probability / settings.outlier_volume / (8.0 * math.pi**2))
    for ratio, is_believed in ((1.5, True), (1.0 / 1.5, False)):
        way = math.sqrt(2.0 * (log_peak - log_room - math.log(ratio)) * expected[3, 3])
        X_seen = retract(X_PO, np.array([0, 0, 0, way, 0, 0]))
        assert np.allclose(expected, np.diag(np.diag(expected)))
        picture = PoseMeasurement(0.0, X_seen, np.diag(sigmas**2))
        reading = read(Contacts.empty())
        _, is_outlier = see(box, belief, Frame(0.0, Evidence(Contacts.empty()), vision=picture), reading, settings)
        assert is_outlier != is_believed


def test_vision_that_shows_the_object_turned_into_itself_is_believed(box: ObjectModel) -> None:
    turned = Sighting(PoseMeasurement(0.0, compose(X_PO, box.symmetry_poses[-1]), SEEN), 1.0)
    after, is_inlier = update_with_pose(box, mode(0.003), turned, LOG_OUTLIER)
    assert len(box.symmetry_poses) == 4
    assert is_inlier[0]
    np.testing.assert_allclose(after.X_PO[0], X_PO, atol=1e-9)


@pytest.mark.parametrize("mesh", ["prism", "cylinder"])
def test_vision_says_the_same_by_whichever_pose_that_looks_alike_and_as_surely_about_the_same_axes(mesh: str) -> None:
    """An image's own axes are others, and its origin is another place of the object: its covariance is of these."""
    made = trimesh.creation.box((0.06, 0.06, 0.11)) if mesh == "prism" else trimesh.creation.cylinder(0.03, 0.1)
    made.apply_translation([0.04, 0.02, 0.0])
    model, generator = ObjectModel.from_mesh(made, cache=False), np.random.default_rng(2)
    assert len(model.symmetry_turns) >= 8
    root = generator.normal(size=(6, 6)) * np.repeat([0.03, 0.003], 3) * np.array([1, 5, 1, 1, 1, 1])[:, None]
    X_seen, covariance = retract(X_PO, root @ generator.normal(size=6)), root @ root.T
    before, standing = mode(0.003), PoseMeasurement(0.0, X_PO, SEEN)
    told = []
    for image in model.symmetry_turns:
        turned, step = compose(X_seen, image), 1e-6 * np.eye(6)
        J = increments_between(turned, compose(retract(X_seen, step), image)).T / 1e-6
        sighting = Sighting(PoseMeasurement(0.0, turned, J @ covariance @ J.T), 0.5)
        after, _ = update_with_pose(model, before, sighting, LOG_OUTLIER)
        fused = fuse(model, standing, sighting, VISION)
        assert after.X_PO[0, 0, 3] != X_PO[0, 3]
        told.append((after.X_PO[0], after.covariance[0], after.log_weight[0], fused.X_PO, fused.covariance))
    for each in told[1:]:
        for value, first in zip(each, told[0], strict=True):
            np.testing.assert_allclose(value, first, rtol=1e-4, atol=1e-4 * np.abs(first).max())


def test_pictures_of_one_correlation_time_are_as_one_measurement(box: ObjectModel) -> None:
    once, _ = update_with_pose(box, mode(0.01), seen(0.005, 1.0), LOG_OUTLIER)
    often = mode(0.01)
    for _ in range(15):
        often, is_inlier = update_with_pose(box, often, seen(0.005, 1.0 / 15.0), LOG_OUTLIER)
        assert is_inlier[0]
    np.testing.assert_allclose(often.covariance, once.covariance, atol=1e-9)
    np.testing.assert_allclose(often.X_PO, once.X_PO, atol=1e-9)


def test_what_stands_is_known_as_well_by_many_pictures_as_by_one_of_their_time(box: ObjectModel) -> None:
    standing = PoseMeasurement(0.0, X_PO, SEEN)
    once, often = fuse(box, standing, seen(0.005, 1.0), VisionParams()), standing
    for _ in range(15):
        often = fuse(box, often, seen(0.005, 1.0 / 15.0), VisionParams())
    np.testing.assert_allclose(often.covariance, once.covariance, atol=1e-9)
    np.testing.assert_allclose(often.X_PO, once.X_PO, atol=1e-9)


def test_what_stands_is_the_same_however_vision_turns_the_object_about_its_axis() -> None:
    cylinder = ObjectModel.from_mesh(trimesh.creation.cylinder(0.03, 0.1), cache=False)
    generator, params = np.random.default_rng(3), VisionParams(lasting_share=0.1)
    still = spun = PoseMeasurement(0.0, X_PO, SEEN)
    for _ in range(10):
        X = retract(X_PO, generator.multivariate_normal(np.zeros(6), SEEN))
        angle = generator.uniform(-np.pi, np.pi)
        turn = make_poses(exp_so3(np.array([[0.0, 0.0, angle]])), np.zeros((1, 3)))[0]
        still = fuse(cylinder, still, Sighting(PoseMeasurement(0.0, X, SEEN), 1.0), params)
        spun = fuse(cylinder, spun, Sighting(PoseMeasurement(0.0, compose(X, turn), SEEN), 1.0), params)
    assert np.sqrt(np.diag(spun.covariance)[3:]).max() < 0.0035
    np.testing.assert_allclose(spun.X_PO[:, 3], still.X_PO[:, 3], atol=1e-4)
    np.testing.assert_allclose(spun.X_PO[:, 2], still.X_PO[:, 2], atol=1e-2)


def test_informations_of_poses_add_up_whatever_their_errors_have_in_common(box: ObjectModel) -> None:
    generator, u, share = np.random.default_rng(4), np.array([0.01, -0.02, 0.01, 1e-3, 2e-3, -1e-3]), 0.3
    scale = np.sqrt(np.diag(SEEN))[:, None]
    old, new = (root @ root.T for root in scale * generator.normal(size=(2, 6, 6)))
    standing = PoseMeasurement(0.0, X_PO, old)
    sighting = Sighting(PoseMeasurement(0.0, retract(X_PO, u), new), share)
    after = fuse(box, standing, sighting, VisionParams(lasting_share=1e-9, gate=1e9))
    covariance = np.linalg.inv(np.linalg.inv(old) + share * np.linalg.inv(new))
    np.testing.assert_allclose(after.covariance / (scale * scale.T), covariance / (scale * scale.T), atol=1e-6)
    step = share * covariance @ np.linalg.solve(new, u)
    np.testing.assert_allclose(increments_between(X_PO[None], after.X_PO[None])[0], step, atol=1e-8)


@pytest.mark.parametrize("share", [1.0, 0.01])
def test_of_two_poses_that_contradict_each_other_the_later_one_counts_however_soon_it_follows(
    box: ObjectModel, share: float
) -> None:
    """That pictures follow each other soon makes them count for less, and not err by more."""
    standing, params = PoseMeasurement(0.0, X_PO, SEEN), VisionParams()
    u = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0])
    gate = math.sqrt(params.gate / (u @ np.linalg.solve(2.0 * SEEN, u)))
    for factor, is_later in ((0.97, False), (1.03, True)):
        sighting = seen(factor * gate, share)
        after = fuse(box, standing, sighting, params)
        assert (after is sighting.pose) == is_later
        assert after.X_PO[0, 3] <= sighting.pose.X_PO[0, 3]


def test_what_is_the_same_of_all_pictures_does_not_average_out(box: ObjectModel) -> None:
    params, standing, generator = VisionParams(), PoseMeasurement(0.0, X_PO, SEEN), np.random.default_rng(0)
    for _ in range(200):
        X = retract(X_PO, np.array([0, 0, 0, 0.01, 0, 0]) + 1e-4 * generator.normal(size=6))
        standing = fuse(box, standing, Sighting(PoseMeasurement(0.0, X, SEEN), 1.0), params)
    np.testing.assert_allclose(standing.covariance, params.lasting_share * SEEN, rtol=1e-6, atol=1e-12)
    sure = PoseMeasurement(0.0, X_PO, 1e-4 * SEEN)
    known = fuse(box, sure, Sighting(PoseMeasurement(0.0, X_PO, SEEN), 1.0), params)
    np.testing.assert_allclose(known.covariance, sure.covariance, rtol=1e-6, atol=1e-14)


def test_a_picture_counts_as_the_share_of_the_correlation_time_since_the_last() -> None:
    record, shares = VisionRecord(), []
    generator, params = np.random.default_rng(0), VisionParams(correlation_time=0.5)
    for time in (0.0, 0.05, 0.15, 1.15):
        X = retract(X_PO, 1e-3 * generator.normal(size=6))
        sighting, record = read_vision(record, PoseMeasurement(time, X, SEEN), MotionHistory((time,)), time, params)
        assert sighting is not None
        assert np.abs(increments_between(sighting.pose.X_PO, X)).max() < 1e-9
        shares.append(sighting.share)
    np.testing.assert_allclose(shares, [1.0, 0.1, 0.2, 1.0])


def test_a_picture_that_comes_again_after_another_counts_once() -> None:
    record, params = VisionRecord(), VisionParams()
    pictures = [PoseMeasurement(0.1 * i, retract(X_PO, np.array([0, 0, 0, 0.001 * i, 0, 0])), SEEN) for i in range(2)]
    for i, is_used in ((0, True), (1, True), (0, False), (1, False)):
        history = MotionHistory((0.0, 0.2), (Motion(np.zeros(6), np.zeros((6, 6))),))
        sighting, record = read_vision(record, pictures[i], history, 0.2, params)
        assert (sighting is not None) == is_used
        assert not record.remark


def test_a_picture_tells_of_the_hand_what_a_mode_has_learnt_with_it(box: ObjectModel) -> None:
    """As the Kalman update of the pose and the biases together says."""
    generator, before = np.random.default_rng(0), mode(0.01)
    biases, gain = np.square([0.001] * 3 + [0.05] * 3), 0.5 * generator.normal(size=(6, 6))
    cross = gain * biases * np.repeat([0.5, 0.1], 3)[:, None]
    before = dataclasses.replace(before, cross_covariance=cross[None])
    after, is_inlier = update_with_pose(box, before, seen(0.004, 1.0), LOG_OUTLIER)
    assert is_inlier[0]
    joint = np.block([[before.covariance[0], cross], [cross.T, np.diag(biases)]])
    K = joint[:, :6] @ np.linalg.inv(before.covariance[0] + SEEN)
    expected = joint - K @ joint[:6]
    np.testing.assert_allclose(after.covariance[0], expected[:6, :6], atol=1e-12)
    np.testing.assert_allclose(after.cross_covariance[0], expected[:6, 6:], atol=1e-12)


@pytest.mark.parametrize(("scale", "is_news"), [(1.0, False), (4.0, False), (0.25, True)])
def test_the_same_pose_is_news_where_it_is_surer(scale: float, is_news: bool) -> None:
    params = VisionParams()
    _, record = read_vision(VisionRecord(), PoseMeasurement(0.0, X_PO, SEEN), MotionHistory((0.0,)), 0.0, params)
    again = PoseMeasurement(1.0, X_PO, scale * SEEN)
    sighting, record = read_vision(record, again, MotionHistory((1.0,)), 1.0, params)
    assert (sighting is not None) == is_news
    assert record.remark == ("" if is_news else "vision is frozen")


def test_of_what_is_wrong_with_pictures_only_doubt_outlasts_them() -> None:
    last = PoseMeasurement(0.0, X_PO, SEEN)
    for remark, left in (("vision is frozen", ""), ("vision is of the future", ""), ("vision is not believed",) * 2):
        sighting, record = read_vision(VisionRecord(last=last, remark=remark), None, MotionHistory((0.1,)), 0.1, VISION)
        assert sighting is None
        assert record.remark == left


def test_residuals_of_another_pose_tell_of_no_slip_once_vision_has_made_this_one_the_best(box: ObjectModel) -> None:
    poses = np.stack([X_PO, retract(X_PO, np.array([0.0, 0.0, 0.0, 0.05, 0.0, 0.0]))])
    for true in (0, 1):
        belief = dataclasses.replace(
            PoseTracker(box).start(1.0),
            modes=TrackedModes.independent(poses, np.stack([SEEN] * 2), 1),
            slip_test=SlipTest(np.zeros((3, 1, 4)), np.zeros((3, 6, 6)), (0.5, 0.5), X_PO),
        )
        contacts = touch_surface(box, X_PO, 1, np.random.default_rng(3))
        frame = Frame(1.0, Evidence(contacts), vision=PoseMeasurement(1.0, poses[true], SEEN))
        after, _ = see(box, belief, frame, read(contacts), VISION)
        np.testing.assert_allclose(after.modes.X_PO[0], poses[true], atol=1e-9)
        assert len(after.slip_test.residuals) == (3 if true == 0 else 0)


def test_a_guess_that_is_a_picture_too_counts_once_in_a_belief_that_is_begun_anew(box: ObjectModel) -> None:
    tracker, nothing = PoseTracker(box), Contacts.empty()
    seen_before = tracker.step(tracker.start(), Frame(0.1, Evidence(nothing), vision=PoseMeasurement(0.1, X_PO, SEEN)))
    anew = dataclasses.replace(tracker.start(0.1), vision=seen_before.vision.of_next_belief())
    guess = GaussianPrior(X_PO, 0.01, 0.1)
    frame = Frame(0.7, Evidence(nothing, prior=guess), vision=PoseMeasurement.from_prior(guess, 0.7))
    after = tracker.step(anew, frame)
    assert after.standing is not None
    np.testing.assert_allclose(after.standing.covariance, np.diag(guess.sigmas**2))


def test_a_sure_pose_takes_the_place_of_one_that_says_nothing(box: ObjectModel) -> None:
    nothing, sure = (PoseMeasurement(0.0, X_PO, sigma**2 * np.eye(6)) for sigma in (1e3, 1e-5))
    after = fuse(box, nothing, Sighting(sure, 1.0), VisionParams())
    np.testing.assert_allclose(after.covariance, sure.covariance, rtol=1e-6, atol=1e-14)
    assert np.linalg.eigvalsh(after.covariance).min() > 0.0


def test_a_late_pose_tells_as_much_of_an_object_at_rest_while_the_palm_moves(box: ObjectModel) -> None:
    tracker, nothing, times = PoseTracker(box), Evidence(Contacts.empty()), 0.1 * np.arange(1, 11)
    X_WP = {time: retract(X_PO, np.array([time, -0.5 * time, 0.0, 0.3 * time, 0.0, 0.2])) for time in times}
    for late in (0, 3):
        belief = tracker.start()
        for step, time in enumerate(times):
            taken = times[max(step - late, 0)]
            vision = PoseMeasurement(taken, compose(inverse(X_WP[taken]), X_PO), SEEN) if step >= late else None
            belief = tracker.step(belief, Frame(time, nothing, vision=vision, X_WP=X_WP[time]))
        error = increments_between(belief.mixture.X_PO, compose(inverse(X_WP[time]), X_PO)[None])
        assert np.abs(error).max() < 1e-6
        assert np.all(np.diag(belief.mixture.covariance[0]) < 0.5 * np.diag(SEEN))


@pytest.mark.parametrize(
    ("seen_first", "back"), [(10, None), (1, None), (10, 18)], ids=["moved", "misseen", "mistaken"]
)
def test_an_object_that_nothing_has_felt_is_where_vision_keeps_seeing_it(
    box: ObjectModel, seen_first: int, back: int | None
) -> None:
    """It was moved after ten pictures, the first picture was wrong, or vision is mistaken for eight pictures, 0.8 s."""
    tracker, nothing, belief = PoseTracker(box), Evidence(Contacts.empty()), PoseTracker(box).start()
    generator, elsewhere = np.random.default_rng(5), retract(X_PO, np.array([0.0, 0.0, 0.0, 0.15, 0.0, 0.0]))
    off = []
    for step in range(40):
        is_first = step < seen_first or (back is not None and step >= back)
        seen = retract(X_PO if is_first else elsewhere, generator.normal(size=6) * np.sqrt(np.diag(SEEN)))
        time = 0.1 * (step + 1)
        frame = Frame(time, nothing, vision=PoseMeasurement(time, seen, SEEN), X_WP=np.eye(3, 4))
        belief = tracker.step(belief, frame)
        off.append(float(np.linalg.norm(belief.mixture.X_PO[0, :, 3] - elsewhere[:, 3])))
    assert min(off[:seen_first]) > 0.1
    if back is not None:
        assert min(off) > 0.1
        assert belief.status == "no_contact"
    else:
        assert min(off[: seen_first + 9]) > 0.1  # Not yet after 0.9 s.
        assert max(off[seen_first + 12 :]) < 0.05
        assert belief.status == "no_contact"


def test_an_object_let_go_is_where_vision_keeps_seeing_it(box: ObjectModel) -> None:
    """It is held until 1 s, then put down half a metre away, where vision sees it ten times a second from 1.5 s on."""
    tracker, nothing, belief = PoseTracker(box), Evidence(Contacts.empty()), PoseTracker(box).start()
    generator, elsewhere = np.random.default_rng(5), retract(X_PO, np.array([1.5, 0.0, 0.0, 0.4, 0.3, 0.0]))
    off = {}
    for step in range(1, 41):
        time = 0.1 * step
        touch = Evidence(touch_surface(box, X_PO, 5, np.random.default_rng(3))) if step <= 10 else nothing
        seen = retract(elsewhere, generator.normal(size=6) * np.sqrt(np.diag(SEEN)))
        vision = PoseMeasurement(time, seen, SEEN) if step >= 15 else None
        belief = tracker.step(belief, Frame(time, touch, vision=vision, X_WP=np.eye(3, 4)))
        off[step] = np.linalg.norm(belief.mixture.X_PO[0, :, 3] - elsewhere[:, 3])
    assert min(off[step] for step in range(11, 20)) > 0.3  # Not yet 0.9 s after the last touch.
    assert max(off[step] for step in range(22, 41)) < 0.05
    assert belief.message == "no_contact"


def test_a_picture_that_was_not_believed_is_remarked_for_a_second(box: ObjectModel) -> None:
    """One picture at 1 s is half a metre off, and vision says nothing afterwards."""
    tracker, belief = PoseTracker(box), PoseTracker(box).start()
    touch = Evidence(touch_surface(box, X_PO, 5, np.random.default_rng(3)))
    far, remarked = PoseMeasurement(1.0, retract(X_PO, np.array([0, 0, 0, 0.5, 0, 0])), SEEN), []
    for step in range(1, 31):
        belief = tracker.step(belief, Frame(0.1 * step, touch, vision=far if step == 10 else None))
        remarked.append("vision is not believed" in belief.remarks)
    assert not any(remarked[:9])
    assert all(remarked[9:19])
    assert not any(remarked[20:])


@pytest.mark.parametrize(
    ("taken", "remark"),
    [(-2.0, "vision is of 3.0 s ago"), (3.0, "vision is of the future"), (0.9, "vision is frozen")],
)
def test_a_new_prior_leaves_what_is_said_of_vision(box: ObjectModel, taken: float, remark: str) -> None:
    tracker, nothing = PoseTracker(box), Contacts.empty()
    guesses = [GaussianPrior(retract(X_PO, np.array([0, 0, 0, 0.1 * i, 0, 0])), 0.01, 0.1) for i in range(2)]
    before = Frame(0.1, Evidence(nothing, prior=guesses[0]), vision=PoseMeasurement(0.1, X_PO, SEEN))
    after = Frame(1.0, Evidence(nothing, prior=guesses[1]), vision=PoseMeasurement(taken, X_PO, SEEN))
    belief = tracker.step(tracker.step(tracker.start(), before), after)
    assert belief.remarks == (remark,)
    np.testing.assert_allclose(belief.mixture.X_PO[0], guesses[1].mean, atol=1e-9)


def test_a_picture_that_the_first_touch_contradicts_is_remarked_in_spite_of_a_new_prior(box: ObjectModel) -> None:
    tracker, belief = PoseTracker(box), PoseTracker(box).start()
    touch = touch_surface(box, X_PO, 5, np.random.default_rng(3))
    near, far = (
        PoseMeasurement(0.1 + shift, retract(X_PO, np.array([0, 0, 0, shift, 0, 0])), SEEN) for shift in (0, 2)
    )
    belief = tracker.step(belief, Frame(0.1, Evidence(Contacts.empty()), vision=near))
    guess = GaussianPrior(X_PO, 0.01, 0.1)
    belief = tracker.step(belief, Frame(2.1, Evidence(touch, prior=guess), vision=far))
    assert "vision is not believed" in belief.remarks


def test_a_picture_of_this_very_instant_is_not_of_the_future_by_rounding() -> None:
    now = 1.7e9
    history = MotionHistory((now - 1.0,)).followed_by(Motion(np.zeros(6), 1e-6 * np.eye(6)), now, 1.0)
    picture = PoseMeasurement(np.nextafter(now, np.inf), X_PO, SEEN)
    sighting, record = read_vision(VisionRecord(), picture, history, now, VisionParams())
    assert record.remark == ""
    assert sighting is not None
    np.testing.assert_allclose(sighting.pose.X_PO, X_PO, atol=1e-12)


def test_what_is_seen_far_away_goes_farther_with_the_palm() -> None:
    far = PoseMeasurement(0.5, make_poses(np.eye(3), np.array([9.99, 0.0, 0.0])), SEEN)
    history = MotionHistory((0.0,)).followed_by(Motion(np.array([0, 0, 0, 0.1, 0, 0]), 1e-6 * np.eye(6)), 1.0, 1.0)
    sighting, _ = read_vision(VisionRecord(), far, history, 1.0, VisionParams())
    assert sighting is not None
    assert sighting.pose.time == 1.0
    np.testing.assert_allclose(sighting.pose.X_PO[:, 3], [10.04, 0.0, 0.0])
