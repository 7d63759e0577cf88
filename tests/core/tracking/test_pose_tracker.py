import math
from typing import Any

import numpy as np
import pytest
import trimesh

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.evidence.evidence import Evidence
from tactopose_drake.core.evidence.gaussian_prior import GaussianPrior
from tactopose_drake.core.motion.object_motion import MotionNoise, move_with_fingertips
from tactopose_drake.core.plain_values import copied
from tactopose_drake.core.poses import increments_between, retract
from tactopose_drake.core.posterior.moved_origin import arc_covariance, increments_of_origin, move_origin
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.slip.slip_params import SlipParams
from tactopose_drake.core.tracking import belief_prediction
from tactopose_drake.core.tracking.frame import Frame, PoseMeasurement
from tactopose_drake.core.tracking.pose_belief import PoseBelief
from tactopose_drake.core.tracking.pose_tracker import PoseTracker
from tactopose_drake.core.tracking.tracker_params import MixtureParams, PoseTrackerParams
from tactopose_drake.errors import InvalidInputError
from tests.core.tracking.boxes import SIGMA_NORMAL, SIGMA_POSITION, make_box, n_OC, p_OC, touch
from tests.core.tracking.follower import GUESS, NAMES, X_PO, Follower

FLICKER = round(100 * PoseTrackerParams().flicker_time)  # frames, for which a touch that is gone has not ended


@pytest.fixture(scope="module")
def tracker() -> PoseTracker:
    return PoseTracker(make_box())


def error(belief: PoseBelief, X: np.ndarray) -> tuple[float, float]:
    """m and rad."""
    u = increments_between(belief.X_PO[0], X)
    return float(np.linalg.norm(u[3:])), float(np.linalg.norm(u[:3]))


def test_it_starts_lost_and_finds_the_pose(tracker: PoseTracker) -> None:
    follower = Follower(tracker)
    assert follower.belief.status == "lost"
    assert not follower.belief.has_pose
    belief = follower.feel(X_PO, 12)
    assert belief.status == "ok"
    translation, rotation = error(belief, X_PO)
    assert translation < 0.003
    assert rotation < math.radians(4.0)
    assert np.sum(belief.probability) == pytest.approx(1.0)


def test_a_touch_that_stays_exactly_as_it_is_is_searched_on(tracker: PoseTracker) -> None:
    """As in a simulation without noise that has come to rest, while a search has only begun."""
    contacts, belief, searches = touch(X_PO, np.random.default_rng(0)), tracker.start(), []
    for step in range(1, 61):
        count = 2 if step <= 8 else 5
        belief = tracker.step(belief, Frame(0.01 * step, Evidence(contacts[:count]), NAMES[:count]))
        searches.append(belief.search)
    # At first the same reading may be that of a sensor that is slower than the frames.
    assert len({(search.searches, search.is_settled, id(search.sampling)) for search in searches[8 : 8 + FLICKER]}) == 1
    assert belief.explained_time == belief.time
    # Such a box may as well lie turned by half a turn.
    flips = [np.diag(row) for row in ([1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1])]
    images = [np.column_stack([X_PO[:, :3] @ flip, X_PO[:, 3]]) for flip in flips]
    translation, rotation = min((error(belief, image) for image in images), key=lambda found: found[1])
    assert translation < 0.006
    assert rotation < math.radians(8.0)


@pytest.mark.parametrize("is_correlated", [False, True])
@pytest.mark.parametrize("far", [1.8, 3.0])
def test_where_the_frames_origin_is_decides_nothing(far: float, is_correlated: bool) -> None:
    """Whether the covariance of vision is that of the middle, or that of the origin with its correlations."""
    mesh, p_CO = make_box(), far * np.array([0.6, 0.0, -0.8])
    moved = trimesh.Trimesh(mesh.vertices - p_CO, mesh.faces, process=False)
    trackers = (PoseTracker(mesh), PoseTracker(ObjectModel.from_mesh(moved, cache=False, symmetry="none")))
    found = []
    for tracker, origin in zip(trackers, (np.zeros(3), p_CO), strict=True):
        belief, generator = tracker.start(), np.random.default_rng(0)
        for i in range(1, 13):
            prior = GaussianPrior(move_origin(GUESS.mean, origin), GUESS.sigma_translation, GUESS.sigma_rotation)
            seen = retract(X_PO, generator.normal(size=6) * [0.1, 0.1, 0.1, 0.01, 0.01, 0.01])
            J = increments_of_origin(seen[None, :, :3], -origin)[0] if is_correlated else np.eye(6)
            covariance = J @ np.diag([0.01] * 3 + [1e-4] * 3) @ J.T
            vision = PoseMeasurement(0.01 * i, move_origin(seen, origin), covariance)
            evidence = Evidence(touch(X_PO, generator), prior=prior)
            belief = tracker.step(belief, Frame(0.01 * i, evidence, NAMES, vision=vision))
        found.append(belief)
    near, far_off = found
    assert (near.status, far_off.status) == ("ok", "ok")
    assert far_off.vision.remark == near.vision.remark == ""
    np.testing.assert_allclose(move_origin(far_off.X_PO[0], -p_CO), near.X_PO[0], atol=0.002)
    # What is said of the far origin is as sure of the middle, and unsure of the origin by its turns.
    R, covariance = far_off.X_PO[:1, :, :3], far_off.covariance[:1]
    J, arc = increments_of_origin(R, p_CO)[0], arc_covariance(R, covariance, p_CO)[0]
    spread = np.sqrt(np.diag(J @ (covariance[0] - arc) @ J.T))
    np.testing.assert_allclose(spread, np.sqrt(np.diag(near.covariance[0])), rtol=0.2)
    turn = np.sqrt(np.trace(near.covariance[0, :3, :3]))
    assert np.sqrt(np.trace(far_off.covariance[0, 3:, 3:])) > 0.3 * far * turn


@pytest.mark.parametrize("finger", range(6))
def test_a_finger_that_touches_something_else_is_found_out(tracker: PoseTracker, finger: int) -> None:
    """Where the one that faces it may be false in its place, which vision alone tells, it is not sure."""
    follower, bias = Follower(tracker, finger), np.zeros((6, 6))
    bias[finger, :3] = 0.025 * (X_PO[:, :3] @ n_OC[finger])
    belief = follower.feel(X_PO, 40, bias=bias)
    doubt = belief.errors.doubt
    assert doubt[NAMES[finger]] > 10.0 * np.median(list(doubt.values()))
    assert belief.errors.calibration.max() < 4.0
    assert belief.status != "ok" or error(belief, X_PO)[0] < 0.005


def test_a_finger_that_touches_something_else_is_found_out_in_whatever_order_contacts_come(
    tracker: PoseTracker,
) -> None:
    """What a search says that began with others in other places is of those that it began with."""
    follower, bias, order = Follower(tracker), np.zeros((6, 6)), np.random.default_rng(1)
    bias[2, :3] = 0.025 * (X_PO[:, :3] @ n_OC[2])
    for _ in range(40):
        others = order.permutation([0, 1, 3, 4, 5]).tolist()[: order.integers(4, 6)]
        belief = follower.feel(X_PO, bias=bias, fingers=[2, *others][:: order.choice([-1, 1])])
    doubt = belief.errors.doubt
    assert max(doubt, key=lambda name: doubt[name]) == NAMES[2]
    assert doubt[NAMES[2]] > 10.0 * np.median(list(doubt.values()))


@pytest.mark.parametrize(("position", "normal_deg"), [(0.0009, 1.5), (0.0003, 1.5), (0.0001, 0.5)])
def test_contacts_may_be_surer_than_the_calibration_is_taken_for(
    tracker: PoseTracker, position: float, normal_deg: float
) -> None:
    """As good as the hand may be found to be, of what contacts are told to be off by something is left."""
    belief, generator = tracker.start(), np.random.default_rng(0)
    for i in range(1, 31):
        felt = touch(X_PO, generator, sigmas=(position, math.radians(normal_deg)))
        belief = tracker.step(belief, Frame(0.01 * i, Evidence(felt, prior=GUESS), NAMES))
        assert np.isfinite(belief.covariance).all()
    assert belief.errors.calibration.min() < 1.0
    assert belief.status == "ok"
    assert error(belief, X_PO)[0] < 0.003


def test_the_same_touch_after_a_release_is_a_new_one(tracker: PoseTracker) -> None:
    felt, belief = touch(X_PO, np.random.default_rng(0)), tracker.start()
    for i in range(1, 41):
        contacts, names = (felt, NAMES) if i in (1, 2, 3, 40) else (Contacts.empty(), ())
        belief = tracker.step(belief, Frame(0.1 * i, Evidence(contacts, prior=GUESS), names))
    assert belief.unsettled_time == belief.time


def test_how_far_the_calibration_seems_to_be_off_is_asked_anew_when_another_finger_touches(
    tracker: PoseTracker,
) -> None:
    """What the modes of before left over, which may have been wrong, no longer counts."""
    follower = Follower(tracker)
    before = follower.feel(X_PO, 60, fingers=range(5))
    assert before.errors.estimates > 1
    after = follower.feel(X_PO, 1)
    assert after.errors.estimates < 2
    np.testing.assert_array_equal(after.errors.calibration, before.errors.calibration)
    while follower.belief.errors.estimates < 1:
        follower.feel(X_PO, 1)
    assert not np.array_equal(follower.belief.errors.calibration, before.errors.calibration)


@pytest.mark.parametrize(("period", "of_touch"), [(0.25, 0.25), (0.5, 0.5), (0.02, 0.3), (1.0, 3.0)])
def test_a_touch_that_goes_on_is_not_new_however_rare_frames_or_readings_are(
    tracker: PoseTracker, period: float, of_touch: float
) -> None:
    belief, generator, said, read_at = tracker.start(), np.random.default_rng(0), [], -np.inf
    for i in range(1, round(9 * of_touch / period)):
        time = i * period
        if time >= read_at + of_touch - 1e-9:
            contacts, read_at = touch(X_PO, generator), time
        belief = tracker.step(belief, Frame(time, Evidence(contacts, prior=GUESS), NAMES))
        said.append(belief)
    late = said[len(said) // 2 :]
    assert {belief.status for belief in late} == {"ok"}, [belief.message for belief in late]
    assert error(belief, X_PO)[0] < 0.003
    without = tracker.step(belief, Frame(time + period, Evidence(Contacts.empty()), ()))
    again = Frame(time + 2 * period + 0.3, Evidence(touch(X_PO, generator), prior=GUESS), NAMES)
    assert tracker.step(without, again).status != "ok", "a touch that was gone is new"


def test_the_same_reading_again_tells_nothing(tracker: PoseTracker) -> None:
    contacts = touch(X_PO, np.random.default_rng(0))
    belief = tracker.start(0.0)
    spread = []
    for i in range(20):
        belief = tracker.step(belief, Frame(0.01 * (i + 1), Evidence(contacts, prior=GUESS), NAMES))
        spread.append(np.trace(belief.covariance[0]))
    assert np.all(np.diff(spread) >= 0.0)
    assert belief.status == "ok"


def test_a_jump_is_called_slipping_and_is_healed_within_200_ms(tracker: PoseTracker) -> None:
    for seed in range(3):
        follower = Follower(tracker, seed)
        follower.feel(X_PO, 30)
        direction = np.random.default_rng(seed).normal(size=3)
        X_after = retract(X_PO, np.concatenate([np.zeros(3), 0.02 * direction / np.linalg.norm(direction)]))
        statuses = {follower.feel(X_after).status for _ in range(5)}
        assert statuses & {"slipping", "lost"}
        belief = follower.feel(X_after, 15)
        assert error(belief, X_after)[0] < 0.003
        assert follower.feel(X_after, 15).status == "ok"


def test_without_touch_the_covariance_grows_until_it_is_lost(tracker: PoseTracker) -> None:
    follower = Follower(tracker)
    held = np.trace(follower.feel(X_PO, 20).covariance[0])
    belief = follower.feel(None, 5)
    assert belief.status == "no_contact"
    assert np.trace(belief.covariance[0]) > held
    before = np.trace(belief.covariance[0])
    belief = follower.feel(None, 110)
    assert belief.message.startswith("lost: nothing was touched or seen for 1.")
    assert np.trace(belief.covariance[0]) > 3.0 * before
    belief = follower.feel(X_PO, 5)
    assert belief.status in ("ok", "ambiguous")
    assert error(belief, X_PO)[0] < 0.005


def test_a_prior_is_of_one_grasp(tracker: PoseTracker) -> None:
    follower = Follower(tracker)
    assert follower.feel(X_PO, 20).standing is not None
    # A finger that lets go for a moment has not given the object away.
    assert follower.feel(None, 10).standing is not None
    assert follower.feel(None, 20).standing is None
    assert follower.feel(X_PO, 5).standing is None


@pytest.mark.parametrize("gap", [20.0, 1e9])
def test_after_a_long_gap_the_pose_is_found_anew(tracker: PoseTracker, gap: float) -> None:
    """Fingertip velocities say nothing of so long a time, however slow they are."""
    follower = Follower(tracker)
    belief = follower.feel(X_PO, 20)
    velocity = {name: np.full(6, 0.01) for name in NAMES}
    contacts = touch(X_PO, follower.generator)
    frame = Frame(belief.time + gap, Evidence(contacts, prior=GUESS), NAMES, tip_velocity=velocity)
    belief = tracker.step(belief, frame)
    assert np.isfinite(belief.covariance).all()
    follower.belief = belief
    translation, rotation = error(follower.feel(X_PO, 10), X_PO)
    assert translation < 0.003
    assert rotation < math.radians(4.0)


def test_a_dropout_of_one_frame_is_bridged(tracker: PoseTracker) -> None:
    follower = Follower(tracker)
    follower.feel(X_PO, 20)
    assert follower.feel(None).status == "no_contact"
    belief = follower.feel(X_PO)
    assert belief.status == "ok"
    assert error(belief, X_PO)[0] < 0.004


def test_a_touch_that_no_pose_explains_is_lost(tracker: PoseTracker) -> None:
    follower = Follower(tracker)
    follower.feel(X_PO, 10)
    generator = np.random.default_rng(1)
    for _ in range(30):
        p = np.array([[0.0, 0, 0], [0.5, 0, 0], [0, 0.5, 0]]) + 1e-4 * generator.normal(size=(3, 3))
        contacts = Contacts(p, np.eye(3))
        belief = tracker.step(follower.belief, Frame(follower.belief.time + 0.01, Evidence(contacts), ("a", "b", "c")))
        follower.belief = belief
    assert belief.message == "lost: no pose explains the touch"


def test_a_touch_that_nothing_explains_and_that_is_gone_was_none(tracker: PoseTracker) -> None:
    led, quiet = Follower(tracker), Follower(tracker)
    for follower in (led, quiet):
        follower.feel(None, 3)
    # As fingers do that start to move: all of them push, and nothing of the object's size is between them.
    apart = Contacts(10.0 * touch(X_PO, led.generator).p_PC, touch(X_PO, led.generator).n_PC)
    led.belief = tracker.step(led.belief, Frame(led.belief.time + 0.01, Evidence(apart, prior=GUESS), NAMES))
    assert led.belief.status == "lost"
    assert led.belief.untouched is not None
    quiet.feel(None)
    # For a moment its end may be a reading that was lost.
    for follower in (led, quiet):
        follower.feel(None, FLICKER - 1)
    assert led.belief.untouched is not None
    for follower in (led, quiet):
        follower.feel(None, 2)
    for _ in range(3):
        led.feel(None)
        quiet.feel(None)
        np.testing.assert_array_equal(led.belief.X_PO, quiet.belief.X_PO)
        np.testing.assert_array_equal(led.belief.covariance, quiet.belief.covariance)
        assert led.belief.message == quiet.belief.message
    assert led.belief.untouched is None


def test_a_touch_that_is_explained_stays_when_it_is_gone(tracker: PoseTracker) -> None:
    follower = Follower(tracker)
    follower.feel(None, 3)
    assert follower.feel(X_PO, 20).untouched is None
    assert error(follower.feel(None, 2), X_PO)[0] < 0.003


def test_a_first_touch_of_an_instant_was_none(tracker: PoseTracker) -> None:
    # One finger's inertia is a contact that some pose fits; the belief with which it began comes back.
    led, quiet = Follower(tracker), Follower(tracker)
    for follower in (led, quiet):
        follower.feel(None, 3)
    wrong = retract(X_PO, np.array([0.0, 0, 0, 0.03, 0.03, 0.0]))
    led.feel(wrong, 2, fingers=(0,))
    quiet.feel(None, 2)
    for follower in (led, quiet):
        follower.feel(None, FLICKER + 2)
    np.testing.assert_array_equal(led.belief.X_PO, quiet.belief.X_PO)
    np.testing.assert_array_equal(led.belief.covariance, quiet.belief.covariance)


def test_readings_that_are_lost_end_no_touch(tracker: PoseTracker) -> None:
    """Of a new touch every third reading is lost, of all fingers: what the others tell is not thrown away."""
    follower = Follower(tracker)
    follower.feel(None, 3)
    for _ in range(6):
        follower.feel(X_PO, 2)
        spread = np.trace(follower.belief.covariance[0])
        lost = follower.feel(None)
        assert lost.status == "no_contact"
        # Nothing moves an object that was held a moment ago, as it would one that nothing holds.
        assert np.trace(lost.covariance[0]) - spread < 0.1 * 3.0 * 0.01 * MotionNoise().free_rotation ** 2
    assert error(follower.belief, X_PO)[0] < 0.004


@pytest.mark.parametrize("period", [0.01, 0.03, 0.05])
def test_a_new_touch_that_flickers_leaves_nothing_when_it_is_gone(tracker: PoseTracker, period: float) -> None:
    """Whether its second part is the same touch or, after a pause, one of its own: that begins without the first."""
    led, quiet = Follower(tracker, period=period), Follower(tracker, period=period)
    wrong = retract(X_PO, np.array([0.0, 0, 0, 0.03, 0.03, 0.0]))
    for follower, touched in ((led, wrong), (quiet, None)):
        follower.feel(None, 3)
        for _ in range(2):
            follower.feel(touched, 1, fingers=(0,))
            follower.feel(None, 2 if period < 0.02 else 1)
        follower.feel(None, FLICKER + 1)
    np.testing.assert_array_equal(led.belief.X_PO, quiet.belief.X_PO)


def test_what_has_just_come_to_touch_holds_nothing_yet(tracker: PoseTracker, monkeypatch: pytest.MonkeyPatch) -> None:
    """An object may lie on a table until other fingers come. Once held it rests, whichever pose is the likeliest."""
    said, tips = list[bool](), dict.fromkeys(NAMES, np.zeros(6))

    def spy(*args: Any, settled: bool, **options: Any) -> Any:
        said.append(settled)
        return move_with_fingertips(*args, settled=settled, **options)

    monkeypatch.setattr(belief_prediction, "move_with_fingertips", spy)
    belief, generator = tracker.start(0.0), np.random.default_rng(0)
    for i, count in enumerate([1] * 15 + [6] * 25):
        contacts = touch(X_PO, generator)[:count]
        frame = Frame(0.01 * (i + 1), Evidence(contacts, prior=GUESS), NAMES[:count], tips)
        belief = tracker.step(belief, frame)
    assert not any(said[:8])
    assert all(said[10:15])
    assert not any(said[15:23])
    assert all(said[35:])
    another = copied(belief, unsettled_time=belief.time)
    tracker.step(another, Frame(belief.time + 0.01, Evidence(touch(X_PO, generator), prior=GUESS), NAMES, tips))
    assert said[-1]


def test_vision_that_is_late_counts_as_of_its_time(tracker: PoseTracker) -> None:
    """The object moves with the fingertips; vision, 0.1 s late, would be 2 cm off without the motion since."""
    twist = np.array([0.0, 0, 0, 0.2, 0, 0])
    X, generator, seen = X_PO, np.random.default_rng(0), []
    belief = tracker.start(0.0)
    for i in range(40):
        X = X.copy()
        X[:, 3] += 0.01 * twist[3:]
        time = 0.01 * (i + 1)
        seen.append(PoseMeasurement(time, X, np.diag(np.repeat([1e-4, 1e-7], 3))))
        # Two contacts that leave most of the pose to vision.
        full = touch(X, generator)
        contacts = Contacts(full.p_PC[:2], full.n_PC[:2])
        tips = dict.fromkeys(NAMES[:2], twist)
        vision = seen[i - 10] if i >= 10 else None
        belief = tracker.step(belief, Frame(time, Evidence(contacts, prior=GaussianPrior(X)), NAMES[:2], tips, vision))
    assert belief.vision.remark == ""
    assert error(belief, X)[0] < 0.004


def test_a_correction_by_vision_is_no_slip(tracker: PoseTracker) -> None:
    """Sensors that are better than told leave little noise, beside which a turn of the best pose is much."""
    generator, belief, said = np.random.default_rng(0), tracker.start(0.0), set[str]()
    X_seen = retract(X_PO, np.array([math.radians(7.0), 0.0, 0.0, 0.0, 0.0, 0.006]))
    seen = PoseMeasurement(0.4, X_seen, np.diag(np.repeat([math.radians(1.0) ** 2, 0.001**2], 3)))
    for i in range(60):
        p_PC = p_OC[:3] @ X_PO[:, :3].T + X_PO[:, 3] + 1e-5 * generator.normal(size=(3, 3))
        contacts = Contacts(p_PC, n_OC[:3] @ X_PO[:, :3].T, sigma_position=SIGMA_POSITION, sigma_normal=SIGMA_NORMAL)
        frame = Frame(0.01 * (i + 1), Evidence(contacts, prior=GUESS), NAMES[:3], vision=seen if i >= 40 else None)
        belief = tracker.step(belief, frame)
        said.add(belief.status)
    assert belief.vision.accepted_time > 0.39
    assert said == {"ok", "ambiguous"}


def test_vision_alone_is_a_pose_without_contact(tracker: PoseTracker) -> None:
    follower = Follower(tracker)
    belief = follower.feel(None, 1, PoseMeasurement.from_prior(GaussianPrior(X_PO), 0.005))
    assert belief.status == "no_contact"
    assert error(belief, X_PO)[0] < 1e-6


def test_a_picture_from_before_the_first_frame_counts_the_same_whatever_the_clock_shows(tracker: PoseTracker) -> None:
    covariance, seen = np.diag(np.repeat([1e-4, 1e-6], 3)), []
    for time in (0.0, 0.25, 100.0, 2.0**30):
        picture = PoseMeasurement(time - 0.5, X_PO, covariance)
        belief = tracker.step(tracker.start(), Frame(time, Evidence(Contacts.empty()), vision=picture))
        assert belief.status == "no_contact"
        seen.append(belief.covariance[0])
    np.testing.assert_allclose(seen, [seen[0]] * len(seen), rtol=1e-9, atol=1e-15)
    assert np.all(np.diag(seen[0]) > 10.0 * np.diag(covariance))  # In half a second it may have moved.


@pytest.mark.parametrize("fault", ["metres off", "frozen", "old", "of the future"])
def test_faulty_vision_is_named_and_does_no_harm(tracker: PoseTracker, fault: str) -> None:
    follower = Follower(tracker)
    follower.feel(X_PO, 20)
    X_wrong = X_PO.copy()
    X_wrong[:, 3] += 2.0
    time, generator = follower.belief.time, np.random.default_rng(0)
    for i in range(10):
        X = retract(X_wrong, 1e-3 * generator.normal(size=6))
        now = time + 0.01 * (i + 1)
        stamp = {"metres off": now - 0.005, "frozen": now - 0.005, "old": now - 3.0, "of the future": now + 1.0}[fault]
        covariance = np.diag(np.repeat([1e-3, 1e-4], 3))
        follower.feel(X_PO, 1, PoseMeasurement(stamp, X_wrong if fault == "frozen" else X, covariance))
    belief = follower.belief
    assert error(belief, X_PO)[0] < 0.004
    assert belief.status == "ok"
    words = {"metres off": "not believed", "frozen": "frozen", "old": "ago", "of the future": "of the future"}
    assert words[fault] in belief.message


def test_modes_that_a_symmetry_makes_alike_are_one() -> None:
    model = ObjectModel.from_mesh(make_box_mesh(), cache=False)
    assert len(model.symmetry_poses) == 4
    tracker, generator = PoseTracker(model), np.random.default_rng(0)
    belief = tracker.start(0.0)
    for i in range(12):
        belief = tracker.step(belief, Frame(0.01 * (i + 1), Evidence(touch(X_PO, generator)), NAMES))
    assert belief.status == "ok"
    assert belief.probability[0] > 0.9


def make_box_mesh():  # type: ignore[no-untyped-def]

    return trimesh.creation.box((0.06, 0.10, 0.14))


def test_the_same_frames_give_the_same_belief(tracker: PoseTracker) -> None:
    one, other = (Follower(tracker, 5).feel(X_PO, 15) for _ in range(2))
    np.testing.assert_array_equal(one.X_PO, other.X_PO)
    np.testing.assert_array_equal(one.covariance, other.covariance)


def test_a_frame_from_before_is_refused(tracker: PoseTracker) -> None:
    with pytest.raises(InvalidInputError, match="time"):
        tracker.step(tracker.start(1.0), Frame(0.5, Evidence(Contacts.empty())))


def test_a_measurement_is_in_metres_and_one_line_to_read() -> None:
    measured = PoseMeasurement(1.25, X_PO, np.eye(6))
    assert repr(measured) == "<PoseMeasurement at 1.250 s: p_PO [20.0, 0.0, 100.0] mm>"
    far = X_PO * [[1.0, 1.0, 1.0, 1e3]]
    with pytest.raises(
        InvalidInputError, match=r"X_PO\.translation must have .*, not \[20\.0, 0\.0, 100\.0\] m\. .* millimetres"
    ):
        PoseMeasurement(1.25, far, np.eye(6))


def test_the_covariance_of_a_place_that_is_well_known_is_symmetric_as_one_of_a_turn_that_is_not() -> None:
    covariance = np.diag(np.repeat([0.3, 0.001], 3) ** 2)
    covariance[3, 4] = 5e-8  # Little beside the turn's variance, and not beside the place's.
    with pytest.raises(InvalidInputError, match=r"covariance must be symmetric, not asymmetric by 5e-08\.$"):
        PoseMeasurement(1.25, X_PO, covariance)
    covariance[4, 3] = np.nextafter(covariance[3, 4], 1.0)  # but for rounding
    assert PoseMeasurement(1.25, X_PO, covariance).covariance[3, 4] == 5e-8


def test_parameters_out_of_range_are_refused() -> None:
    with pytest.raises(InvalidInputError, match="slip_time"):
        PoseTracker(make_box(), PoseTrackerParams(slip_time=0.0))
    for name in ("calibration_position", "frame_position", "surface_position"):
        PoseTrackerParams(**{name: 0.1}).validate()  # type: ignore[arg-type]
        with pytest.raises(InvalidInputError, match=rf"^PoseTrackerParams\.{name} must be .* to 0\.1 m, not 1e\+300"):
            PoseTracker(make_box(), PoseTrackerParams(**{name: 1e300}))  # type: ignore[arg-type]
    with pytest.raises(InvalidInputError, match=r"SlipParams\.noise_gain must be .*, not 5"):
        PoseTrackerParams(slip=SlipParams(noise_gain=5.0)).validate()
    with pytest.raises(InvalidInputError, match=r"SlipParams\.rough_share must be .*, not 1\.5"):
        PoseTracker(make_box(), PoseTrackerParams(slip=SlipParams(rough_share=1.5)))
    with pytest.raises(InvalidInputError, match="max_modes"):
        PoseTracker(make_box(), PoseTrackerParams(mixture=MixtureParams(max_modes=0)))


@pytest.mark.parametrize("name", ["rolling", "free_rotation", "friction"])
def test_noise_that_is_none_is_refused(name: str) -> None:
    with pytest.raises(InvalidInputError, match=name):
        PoseTrackerParams(noise=MotionNoise(**{name: -1.0})).validate()
