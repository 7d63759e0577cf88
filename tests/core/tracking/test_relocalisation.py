import copy
import dataclasses
import math
import pickle

import numpy as np
import pytest
import scipy.stats
import trimesh

from tactopose_drake.core.evidence.contact_reading import ErrorScales
from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.evidence.evidence import Evidence
from tactopose_drake.core.evidence.gaussian_prior import GaussianPrior
from tactopose_drake.core.evidence.hand_geometry import HandGeometry
from tactopose_drake.core.motion.rigid_motion import Motion
from tactopose_drake.core.poses import compose, increments_between, make_poses, random_rotations, retract
from tactopose_drake.core.posterior import importance_sampling
from tactopose_drake.core.posterior.gaussian_mixture import GaussianMixture
from tactopose_drake.core.posterior.modes import Modes
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.tracking import sliced_search
from tactopose_drake.core.tracking.contact_errors import (
    BiasModel,
    averaged_variances,
    calibration_excess,
    follow_doubt,
    with_errors,
)
from tactopose_drake.core.tracking.contact_update import begin_modes
from tactopose_drake.core.tracking.found_modes import FoundModes
from tactopose_drake.core.tracking.frame import Frame, PoseMeasurement
from tactopose_drake.core.tracking.keyframes import (
    Keyframe,
    Touch,
    make_window,
    past_cost,
    past_information,
)
from tactopose_drake.core.tracking.pose_tracker import PoseTracker
from tactopose_drake.core.tracking.relocalisation import _join, _mean_weights, _same_modes, relocalise
from tactopose_drake.core.tracking.sliced_search import SearchState, TouchSampling, search_on
from tactopose_drake.core.tracking.tracked_modes import TrackedModes
from tactopose_drake.core.tracking.tracker_params import PoseTrackerParams
from tests.core.tracking.boxes import SIGMA_NORMAL, SIGMA_POSITION, draw_biases, make_box, read, touch

PARAMS = PoseTrackerParams()
NAMES = tuple("abcdef")
X_PO = make_poses(random_rotations(np.random.default_rng(0), 1), np.array([[0.02, 0.0, 0.1]]))[0]
GUESSED = PoseMeasurement(0.0, X_PO, np.eye(6))
ELSEWHERE = retract(X_PO, np.array([0.0, 0, 0, 0.1, 0, 0]))


@pytest.fixture(scope="module")
def box() -> ObjectModel:
    return make_box()


def touch_of(contacts: Contacts, standing: PoseMeasurement | None = None) -> Touch:
    reading = read(contacts)
    return Touch(Evidence(contacts), reading, (Keyframe.of_now(reading, NAMES),), standing)


def search(
    box: ObjectModel, modes: TrackedModes, standing: PoseMeasurement | None = None, count: int = 4, share: float = 1.0
) -> TrackedModes:
    """The modes after some searches, all of the same touch."""
    touched, state = touch_of(touch(X_PO, np.random.default_rng(1)), standing), SearchState()
    while state.searches < count:
        state, found, _ = search_on(box, PARAMS, touched, modes, state)
        if found is not None:
            modes = relocalise(box, PARAMS, touched, modes, found.modes, share)
    return modes


def off(modes: TrackedModes) -> float:
    """Of the best mode, m."""
    return float(np.linalg.norm(increments_between(modes.X_PO[np.argmax(modes.log_weight)], X_PO)[3:]))


def modes_at(X: np.ndarray) -> TrackedModes:
    return TrackedModes.independent(X[None], 1e-6 * np.eye(6)[None], 6)


def test_however_sure_the_filter_is_what_explains_the_touch_takes_its_place(box: ObjectModel) -> None:
    wrong = dataclasses.replace(modes_at(ELSEWHERE), log_weight=np.array([100.0]))
    assert off(search(box, wrong)) < 0.004


def test_a_mode_of_the_filter_is_found_again_by_whichever_of_its_images_it_is_known() -> None:
    """What is known of an image is of its own axes, and of its own origin."""
    mesh = trimesh.creation.box((0.06, 0.06, 0.11))
    mesh.apply_translation([0.03, 0.0, 0.0])
    prism = ObjectModel.from_mesh(mesh, cache=False)
    assert len(prism.symmetry_poses) == 8
    covariance = np.diag(np.square([0.1, 0.004, 0.004, 0.001, 0.001, 0.001]))
    images, step = compose(X_PO, prism.symmetry_poses), 1e-6 * np.eye(6)
    moved = compose(retract(X_PO, step), prism.symmetry_poses[:, None])
    J = np.swapaxes(increments_between(images[:, None], moved), 1, 2) / 1e-6
    known = TrackedModes.independent(images, J @ covariance @ np.swapaxes(J, 1, 2), 6)
    tight = np.diag(np.square([0.2, 0.2, 0.2, 0.05, 0.05, 0.05]))
    for turned, is_same in (([0.2, 0.0, 0.0], True), ([0.0, 0.05, 0.0], False)):
        found = retract(X_PO, np.array([*turned, 0.0, 0.0, 0.0]))[None]
        _, within = _same_modes(prism, PARAMS, found, tight[None], known)
        np.testing.assert_array_equal(within, np.full((1, 8), is_same))


@pytest.mark.parametrize("starts", [1, 7])
def test_a_search_may_begin_with_few_poses(box: ObjectModel, starts: int) -> None:
    params = dataclasses.replace(PARAMS, relocalisation=dataclasses.replace(PARAMS.relocalisation, starts=starts))
    touched = touch_of(touch(X_PO, np.random.default_rng(1)))
    _, found, _ = search_on(box, params, touched, TrackedModes.empty(6), SearchState())
    assert found is not None
    assert len(found.modes.cost)


def test_vision_that_is_far_off_does_not_keep_the_pose_from_being_found(box: ObjectModel) -> None:
    seen = PoseMeasurement.from_prior(GaussianPrior(ELSEWHERE), 0.0)
    assert off(search(box, TrackedModes.empty(6), seen)) < 0.005


def test_a_mode_of_the_filter_that_explains_the_touch_keeps_its_pose_and_what_it_has_learnt_of_the_hand(
    box: ObjectModel,
) -> None:
    """It is no better known than the posterior says, for that has the same touch, and sees the whole valley."""
    seen = PoseMeasurement.from_prior(GaussianPrior(X_PO), 0.0)
    found = search(box, TrackedModes.empty(6), seen)
    best = found.chosen([int(np.argmax(found.log_weight))])
    narrow = dataclasses.replace(best, covariance=0.1 * best.covariance, cross_covariance=0.1 * best.cross_covariance)
    after = search(box, narrow, seen, count=1)
    i = int(np.argmax(after.log_weight))
    np.testing.assert_array_equal(after.X_PO[i], narrow.X_PO[0])
    np.testing.assert_array_equal(after.cross_covariance[i], narrow.cross_covariance[0])
    assert np.all(np.diag(after.covariance[i]) > 3.0 * np.diag(narrow.covariance[0]))


def test_a_mode_of_the_filter_is_no_better_known_than_by_the_touches_of_now_and_of_the_past(box: ObjectModel) -> None:
    now = read(touch(X_PO, np.random.default_rng(1))[:3])
    alone = (Keyframe.of_now(now, NAMES[:3]),)
    others = Keyframe.of_now(read(touch(X_PO, np.random.default_rng(2))[3:]), NAMES[3:])
    longer = (others, *alone)
    window, spread = make_window(longer, PARAMS.window), np.diag(np.repeat([1e-4, 1e-6], 3))[None]
    X = X_PO[None]
    for _ in range(10):  # To where both fit, and modes stay.
        there = Modes(GaussianMixture(X, np.ones(1), spread), np.zeros(1), (np.empty((0, 6)),), 0.0)
        X = relocalise(box, PARAMS, Touch(now.evidence, now, longer, None), TrackedModes.empty(6), there, 0.5).X_PO
    narrow = TrackedModes.independent(X, 1e-8 * np.eye(6)[None], 6)
    wide = TrackedModes.independent(X, 1e-2 * np.eye(6)[None], 6)
    posterior = Modes(
        GaussianMixture(X, np.ones(1), spread),
        np.zeros(1),
        (np.empty((0, 6)),),
        0.0,
    )
    after = [
        relocalise(box, PARAMS, Touch(now.evidence, now, touched, None), modes, posterior, 0.5).covariance[0]
        for touched, modes in ((alone, narrow), (longer, narrow), (alone, wide))
    ]
    np.testing.assert_allclose(after[0], posterior.mixture.covariance[0], rtol=1e-6, atol=1e-12)
    told = np.linalg.inv(after[1]) - np.linalg.inv(after[0])
    assert np.linalg.eigvalsh(told).max() > 1e5
    np.testing.assert_allclose(told, past_information(box, PARAMS, window, X)[0], rtol=1e-4, atol=1.0)
    np.testing.assert_allclose(after[2], wide.covariance[0], rtol=1e-9, atol=1e-15)


def test_modes_that_the_filter_has_come_first_with_what_is_said_of_them(box: ObjectModel) -> None:
    """Of three modes the second likeliest is the filter's."""
    touched = touch_of(touch(X_PO, np.random.default_rng(1)))
    X = np.stack([ELSEWHERE, X_PO, retract(X_PO, np.array([0.0, 0.0, 0.0, 0.0, 0.1, 0.0]))])
    spread, weights = np.array([1.0, 4.0, 9.0])[:, None, None] * 1e-6 * np.eye(6), np.array([0.5, 0.3, 0.2])
    posterior = Modes(GaussianMixture(X, weights, spread), np.zeros(3), (np.empty((0, 6)),) * 3, 0.0)
    after = relocalise(box, PARAMS, touched, modes_at(X_PO), posterior, 1.0)
    for i, j in enumerate((1, 0, 2)):
        np.testing.assert_allclose(after.X_PO[i], X[j], atol=1e-12)
        assert math.exp(after.log_weight[i]) == pytest.approx(weights[j])
        np.testing.assert_allclose(np.linalg.inv(after.most_information[i]), spread[j], rtol=1e-9, atol=1e-15)


def test_what_is_free_turns_with_the_motion_as_spreads_do() -> None:
    motion = Motion(np.array([0.4, -0.8, 0.3, 0.05, 0.01, -0.02]), np.zeros((6, 6)))
    generator = np.random.default_rng(0)
    free, root = generator.normal(size=(2, 6)), generator.normal(size=(6, 6))
    modes = Modes(GaussianMixture(X_PO[None], np.ones(1), (root @ root.T)[None]), np.zeros(1), (free,), 0.0)
    moved = FoundModes(modes, np.ones(1), ("a",), 1.0).moved(motion.pose).modes
    after = motion.of_poses(X_PO)
    np.testing.assert_allclose(moved.mixture.X_PO[0], after, atol=1e-12)
    rows = np.concatenate([free, root.T])
    expected = increments_between(after, motion.of_poses(retract(X_PO, 1e-6 * rows))) / 1e-6
    np.testing.assert_allclose(moved.free_directions[0], expected[:2], atol=1e-4)
    np.testing.assert_allclose(moved.mixture.covariance[0], expected[2:].T @ expected[2:], atol=1e-3)


@pytest.mark.parametrize("slide", [0.003, 0.03])
def test_a_mode_slides_along_its_valley_to_where_the_touches_of_the_past_fit(box: ObjectModel, slide: float) -> None:
    """Three fingers leave the box free to slide along z, which others have felt before."""
    now = read(touch(X_PO, np.random.default_rng(1))[:3])
    others = Keyframe.of_now(read(touch(X_PO, np.random.default_rng(2))[3:]), NAMES[3:])
    touched = Touch(now.evidence, now, (others, Keyframe.of_now(now, NAMES[:3])), GUESSED)
    X = np.stack([X_PO, retract(X_PO, np.array([0.0, 0, 0, *(slide * X_PO[:, 2])]))])
    spread = np.tile(np.diag(np.repeat([1e-4, 1e-6], 3)), (2, 1, 1))
    posterior = Modes(GaussianMixture(X, np.array([0.4, 0.6]), spread), np.zeros(2), (np.empty((0, 6)),) * 2, 0.0)
    after = relocalise(box, PARAMS, touched, TrackedModes.empty(6), posterior, 1.0)
    # Where both come to lie, they are one mode.
    assert len(after) == 1
    assert np.linalg.norm(after.X_PO[0, :, 3] - X_PO[:, 3]) < 0.002
    assert after.log_weight[0] == pytest.approx(0.0, abs=1e-12)


def test_what_the_past_does_not_fit_anywhere_along_a_valley_counts_the_less(box: ObjectModel) -> None:
    """A finger of the past touched nothing of the box at one of two poses, which are a quarter turn apart."""
    now = read(touch(X_PO, np.random.default_rng(1))[4:])  # On top and below, which leaves turns about z free.
    others = Keyframe.of_now(read(touch(X_PO, np.random.default_rng(2))[:4]), NAMES[:4])
    touched = Touch(now.evidence, now, (others, Keyframe.of_now(now, NAMES[4:])), GUESSED)
    X = np.stack([X_PO, retract(X_PO, np.array([0.0, 0.0, 0.5 * np.pi, 0.0, 0.0, 0.0]))])
    spread = np.tile(np.diag(np.repeat([1e-4, 1e-6], 3)), (2, 1, 1))
    posterior = Modes(GaussianMixture(X, np.array([0.4, 0.6]), spread), np.zeros(2), (np.empty((0, 6)),) * 2, 0.0)
    after = relocalise(box, PARAMS, touched, TrackedModes.empty(6), posterior, 1.0)
    cost = past_cost(box, PARAMS, make_window(touched.keyframes, PARAMS.window), after.X_PO)
    is_turned = np.linalg.norm(increments_between(X_PO, after.X_PO)[:, :3], axis=1) > 0.5
    assert is_turned.tolist() == [False, True]
    odds = after.log_weight[1] - after.log_weight[0]
    assert cost[1] > cost[0] + 3.0
    assert odds == pytest.approx(math.log(0.6 / 0.4) - (cost[1] - cost[0]), abs=1.0)  # And what moving there costs.


def test_modes_at_one_place_are_one_with_all_their_weight() -> None:
    X = retract(X_PO, np.array([[0.0, 0, 0, 0.001, 0, 0], [0.0, 0, 0, 0.1, 0, 0], [0.0, 0, 0, 0, 0, 0]]))
    information = np.tile(np.diag(np.repeat([100.0, 1e6], 3)), (3, 1, 1))
    kept, log_weight = _join(X, information, np.log([0.3, 0.5, 0.2]), 3.0)
    np.testing.assert_array_equal(kept, [1, 0])
    np.testing.assert_allclose(np.exp(log_weight), [0.5, 0.5])
    kept, log_weight = _join(X, information, np.log([0.4, 0.5, 0.3]), 0.5)
    np.testing.assert_array_equal(kept, [1, 0, 2])
    np.testing.assert_allclose(np.exp(log_weight), np.array([0.5, 0.4, 0.3]) / 1.2)


def test_modes_that_are_one_by_way_of_others_share_what_the_filter_held_of_all() -> None:
    before, now = np.log([0.5, 0.5]), np.log([0.2, 0.3, 0.5])
    same = np.array([[True, False], [True, True], [False, True]])
    np.testing.assert_allclose(_mean_weights(before, now, same, 0.3), now)
    # What the filter has not is as probable as it is now; what it has, by the mean of both.
    apart = np.array([[True, True], [False, False], [False, False]])
    np.testing.assert_allclose(_mean_weights(before, now, apart, 0.3), [0.3 * now[0], *now[1:]])


@pytest.mark.parametrize(("sigma", "stays"), [(1e-3, True), (5e-5, False)])
def test_a_mode_that_is_surer_than_the_touch_does_not_keep_its_pose(
    box: ObjectModel, sigma: float, stays: bool
) -> None:
    touched = touch_of(touch(X_PO, np.random.default_rng(1)))
    near = retract(X_PO, np.array([0.0, 0, 0, 0.0003, 0, 0]))
    narrow = TrackedModes.independent(near[None], np.diag(np.repeat([1e-4, sigma**2], 3))[None], 6)
    wide = GaussianMixture(X_PO[None], np.ones(1), np.diag(np.repeat([0.01, 1e-4], 3))[None])
    posterior = Modes(wide, np.zeros(1), (np.empty((0, 6)),), 0.0)
    after = relocalise(box, PARAMS, touched, narrow, posterior, 0.5)
    np.testing.assert_array_equal(after.X_PO[0], near if stays else X_PO)


def test_a_search_is_made_of_slices_while_there_is_a_mode_to_keep_up(box: ObjectModel) -> None:
    touched, state = touch_of(touch(X_PO, np.random.default_rng(1))), SearchState()
    slices, found = 0, None
    while found is None:
        assert state.searches == 0
        state, found, _ = search_on(box, PARAMS, touched, modes_at(X_PO), state)
        slices += 1
    # Poses are proposed, settled, asked of the calibration, covered, joined, sampled, joined by way of what samples
    # lead to, and sampled on.
    assert 5 <= slices <= 14
    twice, by_two = SearchState(), 0
    while not twice.searches:
        twice, found, _ = search_on(box, PARAMS, touched, modes_at(X_PO), twice, slices=2)
        by_two += 1
    assert by_two == -(-slices // 2)
    assert search_on(box, PARAMS, touched, modes_at(X_PO), SearchState(), slices=None)[1] is not None
    _, found, _ = search_on(box, PARAMS, touched, TrackedModes.empty(6), SearchState())
    assert found is not None


def test_a_search_weighs_modes_by_how_far_the_calibration_seems_to_be_off(box: ObjectModel) -> None:
    """It says so before the weights: what the touch tells is put to use by the same search."""
    told = PARAMS.calibration_position, math.radians(PARAMS.calibration_normal_deg)
    scales = []
    for scale in (0.0, 4.0):
        bias = scale * draw_biases(np.random.default_rng(0), *told)
        contacts = touch(X_PO, np.random.default_rng(1), bias, (SIGMA_POSITION, SIGMA_NORMAL))
        reading = read(contacts)
        keyframes = (dataclasses.replace(Keyframe.of_now(reading, NAMES), frames=8),)
        touched, state, errors = Touch(Evidence(contacts), reading, keyframes, None), SearchState(), None
        while errors is None:
            state, found, errors = search_on(box, PARAMS, touched, modes_at(X_PO), state)
            assert found is None
        touched = touched._replace(reading=reading._replace(errors=errors))
        state = search_on(box, PARAMS, touched, modes_at(X_PO), state).state
        assert isinstance(state.sampling, TouchSampling)
        stated = state.sampling.evidence.contacts
        np.testing.assert_allclose(
            np.square([stated.sigma_position, stated.sigma_normal]).T,
            averaged_variances(contacts, PARAMS, 8) + calibration_excess(contacts, PARAMS, errors.calibration),
        )
        # In the same frame it is put to use likewise.
        at_once = search_on(box, PARAMS, touched._replace(reading=reading), modes_at(X_PO), SearchState(), slices=4)
        assert isinstance(at_once.state.sampling, TouchSampling)
        again = at_once.state.sampling.evidence.contacts
        np.testing.assert_allclose(again.sigma_position, stated.sigma_position)
        scales.append(errors.calibration)
    assert scales[0].max() < 1.0
    assert np.all(scales[1] > 4.0 * scales[0])
    # One frame tells nothing of what lasts.
    once, state, found = touch_of(touch(X_PO, np.random.default_rng(1))), SearchState(), None
    while not state.searches:
        state, _, found = search_on(box, PARAMS, once, modes_at(X_PO), state)
        assert found is None


def test_what_a_search_has_found_starts_the_next_however_little_is_proposed(
    box: ObjectModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    touched, modes, state = touch_of(touch(X_PO, np.random.default_rng(1))), TrackedModes.empty(6), SearchState()
    while not state.searches:
        state, *_ = search_on(box, PARAMS, touched, modes, state)
    monkeypatch.setattr(sliced_search, "_propose_poses", lambda *_: np.empty((0, 3, 4)))
    astray = modes_at(ELSEWHERE)
    for start in (state._replace(minima=np.empty((0, 3, 4))), state):
        again, found = start, None
        while found is None and again.searches == state.searches:
            again, found, _ = search_on(box, PARAMS, touched, astray, again)
        finds_it = found is not None and off(relocalise(box, PARAMS, touched, astray, found.modes, 1.0)) < 0.005
        assert finds_it == (start is state)


def test_what_is_found_meanwhile_moves_with_the_object() -> None:
    motion = Motion(np.array([0.1, -0.2, 0.3, 0.01, 0.02, -0.01]), np.zeros((6, 6)))
    moved = SearchState(X_PO=X_PO[None], minima=X_PO[None]).moved(motion).moved(motion).as_of_now()
    assert moved.X_PO is not None
    for X in (moved.X_PO, moved.minima, moved.as_of_now().minima):
        np.testing.assert_allclose(X[0], compose(motion.pose, compose(motion.pose, X_PO)), atol=1e-15)


def test_modes_are_weighted_as_of_the_time_that_this_began_and_moved_with_the_object_then(box: ObjectModel) -> None:
    touched, state = touch_of(touch(X_PO, np.random.default_rng(1))), SearchState()
    while state.sampling is None:
        state, *_ = search_on(box, PARAMS, touched, modes_at(X_PO), state)
    rests: SearchState = pickle.loads(pickle.dumps(state))  # As a belief that is kept on disk.
    motion, X_PP = Motion(np.array([0.1, -0.2, 0.3, 0.01, 0.02, -0.01]), np.zeros((6, 6))), np.eye(3, 4)
    at_rest, moved = None, None
    while moved is None:
        assert at_rest is None
        rests, at_rest, _ = search_on(box, PARAMS, touched, modes_at(X_PO), rests)
        state, moved, _ = search_on(box, PARAMS, touched, modes_at(X_PO), state.moved(motion))
        X_PP = motion.of_poses(X_PP)
    assert at_rest is not None
    np.testing.assert_allclose(moved.modes.mixture.X_PO, compose(X_PP, at_rest.modes.mixture.X_PO), atol=1e-12)
    np.testing.assert_array_equal(moved.modes.mixture.weights, at_rest.modes.mixture.weights)
    turn = np.eye(6)
    turn[3:, 3:] = X_PP[:, :3]
    expected = turn @ at_rest.modes.mixture.covariance @ turn.T
    np.testing.assert_allclose(moved.modes.mixture.covariance, expected, atol=1e-12)
    assert np.abs(expected - at_rest.modes.mixture.covariance).max() > 1e-7, "the turn matters"


def test_weights_are_means_over_the_searches_that_agree(box: ObjectModel) -> None:
    known = search(box, TrackedModes.empty(6), count=1)
    doubtful = dataclasses.replace(known, log_weight=np.full(len(known), -5.0)).joined(modes_at(ELSEWHERE))
    before = doubtful.log_weight[0] - np.logaddexp.reduce(doubtful.log_weight)
    fresh, after = (search(box, doubtful, count=1, share=share) for share in (1.0, 0.2))
    assert after.log_weight[0] == pytest.approx(before + 0.2 * (fresh.log_weight[0] - before))
    assert after.log_weight[0] < fresh.log_weight[0] - 2.0


def test_a_mode_of_a_hand_that_seems_better_than_told_begins_with_a_covariance_that_can_be(box: ObjectModel) -> None:
    best = ErrorScales(calibration=np.array([0.5, 0.5]))
    for seed in range(4):
        contacts = touch(X_PO, np.random.default_rng(seed), sigmas=(0.0005, math.radians(2.5)))
        reading = with_errors(read(contacts), best, PARAMS)
        modes = begin_modes(box, PARAMS, reading, None, X_PO[None], 1e-5 * np.eye(6)[None])
        own = np.diag(np.repeat(BiasModel.from_params(PARAMS).variances + modes.roughness[0], 3, axis=1).ravel())
        C = modes.cross_covariance[0]
        assert np.linalg.eigvalsh(modes.covariance[0] - C @ np.linalg.solve(own, C.T)).min() > -1e-12


def test_a_valley_keeps_its_mass_when_a_search_finds_another_one_of_its_minima(box: ObjectModel) -> None:
    touched = touch_of(touch(X_PO, np.random.default_rng(1)))
    valley = np.stack([retract(X_PO, np.array([0.0, 0, 0, 0.002, 0, 0])), X_PO, ELSEWHERE])
    weights = np.array([0.4, 1e-7, 0.6])
    modes = TrackedModes.independent(valley, np.tile(1e-6 * np.eye(6), (3, 1, 1)), 6)
    modes = dataclasses.replace(modes, log_weight=np.log(weights))
    covariance = np.tile(1e-5 * np.eye(6), (2, 1, 1))
    found = GaussianMixture(np.stack([X_PO, ELSEWHERE]), np.array([0.6, 0.4]), covariance)
    posterior = Modes(found, np.zeros(2), 2 * (np.empty((0, 6)),), 0.0)
    after = relocalise(box, PARAMS, touched, modes, posterior, 0.2)
    assert len(after) == 2
    in_valley = np.linalg.norm(after.X_PO[:, :, 3] - X_PO[:, 3], axis=1) < 0.01
    odds = float(after.log_weight[in_valley][0] - after.log_weight[~in_valley][0])
    assert odds == pytest.approx(0.8 * np.log(0.4 / 0.6) + 0.2 * np.log(0.6 / 0.4), abs=1e-6)


def test_of_a_touch_that_is_as_told_little_is_doubted(box: ObjectModel) -> None:
    _, found, _ = search_on(
        box, PARAMS, touch_of(touch(X_PO, np.random.default_rng(1))), TrackedModes.empty(6), SearchState()
    )
    assert found is not None
    doubt = follow_doubt({}, found.inlier_probability, found.noise_scale, found.sources, 1.0)
    assert set(doubt) == set(NAMES)
    assert all(1.0 <= factor < 2.0 for factor in doubt.values())


def found_modes(*sigmas: float) -> FoundModes:
    """Equally probable modes, each known to so much, m and rad."""
    n = len(sigmas)
    X = retract(np.repeat(X_PO[None], n, axis=0), np.linspace(0.0, 0.05, n)[:, None] * np.eye(6)[3])
    mixture = GaussianMixture(X, np.full(n, 1.0 / n), np.square(sigmas)[:, None, None] * np.eye(6))
    return FoundModes(Modes(mixture, np.zeros(n), (np.zeros((0, 6)),) * n, 0.0), np.ones(4), tuple("abcd"), 1.0)


def test_a_mode_in_the_hand_counts_the_less_the_deeper_it_is(box: ObjectModel) -> None:
    settings = PARAMS.relocalisation

    def weights(*depths: float) -> np.ndarray:
        every, found = np.arange(len(depths)), found_modes(*(0.0,) * len(depths))
        return found.clear(box, None, settings, every, np.array(depths)).modes.mixture.weights

    for depth, most in ((0.0005, 0.5), (0.003, 0.2), (0.006, 1e-3)):
        found = weights(0.0005, depth)
        assert found.sum() == pytest.approx(1.0)
        assert found[1] <= most + 1e-9
    assert np.allclose(weights(0.01, 0.01), 0.5)  # Where both are as deep, neither is.


def test_a_mode_that_may_slide_out_of_the_hand_is_not_dropped(box: ObjectModel) -> None:
    hand = HandGeometry([X_PO[:, 3] + [0.05, 0.0, 0.0]], [0.03], sigma=0.001)
    narrow, wide = (
        found_modes(0.0001, sigma).clear(box, hand, PARAMS.relocalisation, np.arange(2), np.array([0.0, 0.006]))
        for sigma in (0.0001, 0.05)
    )
    assert narrow.modes.mixture.weights[1] < 1e-4
    assert wide.modes.mixture.weights[1] > 0.2


def test_the_hand_s_own_surface_is_unsure_too(box: ObjectModel) -> None:
    weights = []
    for sigma in (0.0001, 0.004):
        hand = HandGeometry([X_PO[:, 3] + [0.05, 0.0, 0.0]], [0.03], sigma=sigma)
        found = found_modes(1e-6, 1e-6)
        cleared = found.clear(box, hand, PARAMS.relocalisation, np.arange(2), np.array([0.0, 0.006]))
        weights.append(cleared.modes.mixture.weights[1])
    allowed = PARAMS.relocalisation.allowed_depth
    clear = scipy.stats.norm.cdf((allowed - np.array([0.0, 0.006])) / 0.004)
    assert weights[0] < 1e-6
    assert weights[1] == pytest.approx(clear[1] / clear.sum(), rel=0.02)


def test_of_several_likely_modes_it_is_asked_once_how_deep_they_are_and_of_a_single_one_never(box: ObjectModel) -> None:
    asked: list[int] = []

    def depth(X: np.ndarray) -> np.ndarray:
        asked.append(len(X))
        return np.zeros(len(X))

    # Told that it has no symmetries, a box may lie in four ways, of which vision knows one.
    seen = PoseMeasurement(0.0, X_PO, 1e-4 * np.eye(6))
    for standing, expected in ((None, [4]), (seen, [])):
        asked.clear()
        touched = touch_of(touch(X_PO, np.random.default_rng(1)), standing)._replace(depth_in_hand=depth)
        state, found = SearchState(searches=1), None
        while found is None:
            state, found, _ = search_on(box, PARAMS, touched, modes_at(X_PO), state)
        assert asked == expected
        assert state.X_PO is None
        assert state.sampling is None


def test_further_rounds_of_samples_make_searches_agree(box: ObjectModel) -> None:
    touched, spread = touch_of(touch(X_PO, np.random.default_rng(1))), []
    for most in (PARAMS.relocalisation.samples, PARAMS.relocalisation.most_samples):
        params = dataclasses.replace(
            PARAMS, relocalisation=dataclasses.replace(PARAMS.relocalisation, most_samples=most)
        )
        errors, slices = [], []
        for searches in range(6):
            state, found, taken = SearchState(searches=searches), None, 0
            while found is None:
                state, found, _ = search_on(box, params, touched, modes_at(X_PO), state)
                taken += 1
            errors.append(found.modes.standard_error)
            slices.append(taken)
        spread.append((np.mean(errors), np.mean(slices)))
    (few, fast), (many, slow) = spread
    assert many < 0.7 * few
    assert slow > fast


def test_no_round_draws_the_samples_of_another_again(box: ObjectModel, monkeypatch: pytest.MonkeyPatch) -> None:
    params, wanted = copy.deepcopy(PARAMS), importance_sampling._times_wanted
    params.relocalisation.standard_error, params.relocalisation.most_samples = 1e-6, 1536
    monkeypatch.setattr(  # From the same proposals, one time more each round.
        importance_sampling,
        "_times_wanted",
        lambda samples, posterior: np.minimum(wanted(samples, posterior), samples.times + 1),
    )
    touched, state, times, X = touch_of(touch(X_PO, np.random.default_rng(1))), SearchState(), np.zeros(1), X_PO[None]
    while state.searches < 1:
        state, *_ = search_on(box, params, touched, modes_at(X_PO), state)
        if isinstance(state.sampling, TouchSampling) and state.sampling.state.samples is not None:
            X, times = state.sampling.state.samples.X_PO, state.sampling.state.samples.times
    assert times.max() > 2
    assert len(np.unique(X.round(12).reshape(-1, 12), axis=0)) == len(X)


def test_the_belief_drops_flips_that_lie_in_the_hand(box: ObjectModel) -> None:
    # Told that it has no symmetries, a box may lie in four ways; the hand is where it would be in three of them.
    contacts, tracker = touch(X_PO, np.random.default_rng(1)), PoseTracker(box)

    def depth(X: np.ndarray) -> np.ndarray:
        return np.where(np.linalg.norm(X[:, :, :3] - X_PO[:, :3], axis=(1, 2)) > 1.0, 0.01, 0.0)

    found = []
    for depth_in_hand in (None, depth):
        belief = tracker.start()
        for step in range(30):
            frame = Frame(0.02 * step, Evidence(contacts), NAMES[: len(contacts)], depth_in_hand=depth_in_hand)
            belief = tracker.step(belief, frame)
        right = np.linalg.norm(belief.X_PO[:, :, :3] - X_PO[:, :3], axis=(1, 2)) < 0.5
        found.append(float(belief.probability[right].sum()))
    assert found[0] < 0.6
    assert found[1] > 0.95
