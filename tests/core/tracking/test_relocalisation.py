import dataclasses

import numpy as np
import pytest

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.evidence.evidence import Evidence
from tactopose_drake.core.evidence.gaussian_prior import GaussianPrior
from tactopose_drake.core.poses import increments_between, make_poses, random_rotations, retract
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.tracking.frame import ContactReading, PoseMeasurement
from tactopose_drake.core.tracking.keyframes import Keyframe, TouchWindow, make_window
from tactopose_drake.core.tracking.relocalisation import past_cost, relocalise
from tactopose_drake.core.tracking.tracked_modes import TrackedModes
from tactopose_drake.core.tracking.tracker_params import PoseTrackerParams
from tests.core.tracking.boxes import make_box, touch

PARAMS = PoseTrackerParams()
NAMES = tuple("abcdef")
X_PO = make_poses(random_rotations(np.random.default_rng(0), 1), np.array([[0.02, 0.0, 0.1]]))[0]
ELSEWHERE = retract(X_PO, np.array([0.0, 0, 0, 0.1, 0, 0]))


@pytest.fixture(scope="module")
def box() -> ObjectModel:
    return make_box()


def window_of(contacts: Contacts) -> TouchWindow:
    return make_window((Keyframe.of_now(contacts, NAMES),), PARAMS.window)


def search(
    box: ObjectModel, modes: TrackedModes, standing: PoseMeasurement | None = None, count: int = 4
) -> TrackedModes:
    """The modes after some slices, all of the same touch."""
    contacts = touch(X_PO, np.random.default_rng(1))
    reading = ContactReading(contacts, np.arange(6), NAMES, True)
    for i in range(count):
        modes = relocalise(box, PARAMS, Evidence(contacts), reading, window_of(contacts), modes, standing, i)
    return modes


def off(modes: TrackedModes) -> float:
    """Of the best mode, m."""
    return float(np.linalg.norm(increments_between(modes.X_PO[np.argmax(modes.log_weight)], X_PO)[3:]))


def modes_at(X: np.ndarray) -> TrackedModes:
    return TrackedModes.independent(X[None], 1e-6 * np.eye(6)[None], 6)


def test_however_sure_the_filter_is_what_explains_the_touch_takes_its_place(box: ObjectModel) -> None:
    wrong = dataclasses.replace(modes_at(ELSEWHERE), log_weight=np.array([100.0]))
    assert off(search(box, wrong)) < 0.004


def test_vision_that_is_far_off_does_not_keep_the_pose_from_being_found(box: ObjectModel) -> None:
    seen = PoseMeasurement.from_prior(GaussianPrior(ELSEWHERE), 0.0)
    assert off(search(box, TrackedModes.empty(6), seen)) < 0.005


def test_a_mode_of_the_filter_that_explains_the_touch_keeps_its_pose_and_what_it_has_learnt(box: ObjectModel) -> None:
    seen = PoseMeasurement.from_prior(GaussianPrior(X_PO), 0.0)
    found = search(box, TrackedModes.empty(6), seen)
    best = found.chosen([int(np.argmax(found.log_weight))])
    narrow = dataclasses.replace(best, covariance=0.1 * best.covariance, cross_covariance=0.1 * best.cross_covariance)
    after = search(box, narrow, seen, count=1)
    i = int(np.argmax(after.log_weight))
    np.testing.assert_array_equal(after.X_PO[i], narrow.X_PO[0])
    np.testing.assert_array_equal(after.covariance[i], narrow.covariance[0])


def test_touches_of_the_past_tell_poses_apart_but_never_outweigh_a_slip(box: ObjectModel) -> None:
    now = touch(X_PO, np.random.default_rng(1))
    before = Keyframe.of_now(touch(X_PO, np.random.default_rng(2)), NAMES)
    shifted = Contacts(now.p_PC[:3], None if now.n_PC is None else now.n_PC[:3])
    window = make_window((before, Keyframe.of_now(shifted, NAMES[:3])), PARAMS.window)
    assert window.count == 2
    right, wrong = past_cost(box, PARAMS, window, np.stack([X_PO, ELSEWHERE]))
    assert wrong > right
    assert wrong - right < 0.5 * 18 - np.log(PARAMS.window.slip_probability)
    np.testing.assert_array_equal(past_cost(box, PARAMS, window_of(now), np.stack([X_PO, ELSEWHERE])), np.zeros(2))
