import dataclasses
import math

import numpy as np
import pytest

from tactopose_drake.core.evidence.gaussian_prior import GaussianPrior
from tactopose_drake.core.poses import increments_between, retract
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.tracking.frame import ContactReading, PoseMeasurement
from tactopose_drake.core.tracking.measurement_update import MeasurementUpdate, average_likelihood, update_modes
from tactopose_drake.core.tracking.motion_prediction import MotionHistory
from tactopose_drake.core.tracking.pose_belief import PoseBelief
from tactopose_drake.core.tracking.relocalisation import SearchRegion, add_proposals, choose_region
from tactopose_drake.core.tracking.tracked_modes import TrackedModes
from tactopose_drake.core.tracking.tracker_params import PoseTrackerParams
from tests.core.tracking.boxes import make_box, touch

ELSEWHERE = np.eye(3, 4) + np.array([[0, 0, 0, 0.1], [0, 0, 0, 0], [0, 0, 0, 0]])
MODES = TrackedModes.independent(np.eye(3, 4)[None], 1e-6 * np.eye(6)[None], 0)
PARAMS = PoseTrackerParams()
# Touched and explained until now.
BELIEF = PoseBelief(
    time=5.0, status="ok", history=MotionHistory((5.0,)), modes=MODES, touch_time=4.99, explained_time=4.99
)


def choose(belief: PoseBelief = BELIEF, modes: TrackedModes = MODES, is_urgent: bool = False) -> SearchRegion:
    return choose_region(belief, modes, None, None, PARAMS, is_urgent=is_urgent)


def test_while_all_is_well_it_mostly_searches_near_the_best_mode_and_at_times_anywhere() -> None:
    regions = [choose(dataclasses.replace(BELIEF, searches=i)) for i in range(64)]
    anywhere = [one for one in regions if one.near is None]
    assert 4 <= len(anywhere) <= 16
    for one in regions:
        if one.near is not None:
            np.testing.assert_array_equal(one.near.X_PO, MODES.X_PO[0])
            # Much wider than the mode is: that may be too sure of itself.
            assert np.linalg.eigvalsh(one.near.covariance - 100.0 * MODES.covariance[0]).min() > 0.0
            assert not one.jumped
            assert one.probability > anywhere[0].probability


@pytest.mark.parametrize("searches", [0, 3])
def test_what_is_not_explained_is_near_first_and_then_anywhere(searches: int) -> None:
    belief = dataclasses.replace(BELIEF, searches=searches)
    near = choose(belief, is_urgent=True)
    assert near.near is not None
    assert near.jumped
    assert near.probability > choose(dataclasses.replace(BELIEF, searches=1)).probability
    assert choose(dataclasses.replace(belief, explained_time=4.85), is_urgent=True).near is None


def test_after_a_while_without_touch_it_searches_over_the_spread_of_the_prediction() -> None:
    near = choose(dataclasses.replace(BELIEF, touch_time=4.5), is_urgent=True).near
    assert near is not None
    np.testing.assert_array_equal(near.covariance, MODES.covariance[0])


def test_vision_and_a_prior_say_where() -> None:
    seen = PoseMeasurement.from_prior(GaussianPrior(ELSEWHERE), 5.0)
    assert choose_region(BELIEF, MODES, seen, None, PARAMS, is_urgent=False).near is seen
    none = TrackedModes.empty()
    assert choose(modes=none).near is None
    near = choose_region(BELIEF, none, None, GaussianPrior(ELSEWHERE), PARAMS, is_urgent=True).near
    assert near is not None
    np.testing.assert_array_equal(increments_between(near.X_PO, ELSEWHERE), np.zeros(6))


@pytest.fixture(scope="module")
def box() -> ObjectModel:
    return make_box()


def update_often(box: ObjectModel, frames: int) -> MeasurementUpdate:
    """Two modes, of which the second is right, after frames of a touch."""
    X_PO, generator = np.eye(3, 4), np.random.default_rng(0)
    X_start = np.stack([retract(X_PO, np.array([0, 0, 0, 0.004, 0, 0.0])), X_PO])
    covariance = np.tile(np.diag(np.repeat([0.02**2, 0.001**2], 3)), (2, 1, 1))
    modes = TrackedModes.independent(X_start, covariance, 6)
    for _ in range(frames):
        reading = ContactReading(touch(X_PO, generator), np.arange(6), tuple("abcdef"), True)
        update = update_modes(box, PARAMS, reading, modes, 0.01)
        modes = update.modes
    return update


@pytest.mark.parametrize("frames", [5, 30])
def test_what_is_found_weighs_what_it_explains_and_has_felt_what_the_best_has(box: ObjectModel, frames: int) -> None:
    update = update_often(box, frames)
    one = update.modes.chosen([0])
    # As a search gives it: the touch explained 20 nats better than by all modes together.
    cross = np.zeros((1, 6, 36))
    found = TrackedModes.make(
        one.X_PO, one.covariance, cross, one.roughness, np.array([update.log_likelihood + 22.0]), np.array([-2.0])
    )
    joined = add_proposals(update, found, SearchRegion(None, 0.01, True))
    gain = joined.log_weight[-1] - np.logaddexp.reduce(update.modes.log_weight)
    assert gain == pytest.approx(20.0 + math.log(0.01))
    # Frames that say the same of both never tell them apart, as the found one has no better past.
    assert joined.frames[-1] == joined.frames[0]
    after = joined
    for _ in range(100):
        after = average_likelihood(after, np.zeros(len(joined)), 0.3, 50.0)
    changed = np.diff(after.log_weight[[0, -1]])[0] - np.diff(joined.log_weight[[0, -1]])[0]
    assert changed == pytest.approx(0.0, abs=0.3 * abs(update.log_before))


def test_a_belief_that_was_wrong_gives_what_is_found_its_share_however_well_it_foretold_the_touch(
    box: ObjectModel,
) -> None:
    update = update_often(box, 5)
    cross, even = np.zeros((2, 6, 36)), np.zeros((2, 6, 2))
    log_prior = update.log_likelihood - np.array([20.0, 20.0 + math.log(3.0)])
    found = TrackedModes.make(update.modes.X_PO, update.modes.covariance, cross, even, log_prior, np.zeros(2))
    joined = add_proposals(update, found, SearchRegion(None, 0.02, False))
    gain = np.exp(joined.log_weight[2:] - np.logaddexp.reduce(update.modes.log_weight))
    np.testing.assert_allclose(gain, [0.015, 0.005])
    assert add_proposals(update, found.chosen([]), SearchRegion(None, 0.02, False)) is update.modes
