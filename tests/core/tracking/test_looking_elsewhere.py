import dataclasses

import numpy as np
import pytest

from tactopose_drake.core.evidence.gaussian_prior import GaussianPrior
from tactopose_drake.core.poses import increments_between
from tactopose_drake.core.tracking.looking_elsewhere import Look, where_to_look
from tactopose_drake.core.tracking.mode_set import ModeSet
from tactopose_drake.core.tracking.motion_history import MotionHistory
from tactopose_drake.core.tracking.pose_belief import PoseBelief
from tactopose_drake.core.tracking.pose_measurement import PoseMeasurement

ELSEWHERE = np.eye(3, 4) + np.array([[0, 0, 0, 0.1], [0, 0, 0, 0], [0, 0, 0, 0]])
MODES = ModeSet.make(
    np.eye(3, 4)[None],
    1e-6 * np.eye(6)[None],
    np.zeros((1, 6, 0)),
    np.zeros((1, 0, 2)),
    np.zeros(1),
    np.zeros(1),
)
# Touched and explained until now.
BELIEF = PoseBelief(
    time=5.0, status="ok", history=MotionHistory((5.0,)), modes=MODES, touch_time=4.99, explained_time=4.99
)


def look(belief: PoseBelief = BELIEF, modes: ModeSet = MODES, troubled: bool = False) -> Look:
    return where_to_look(belief, modes, None, None, 0.2, troubled=troubled)


def test_while_all_is_well_it_mostly_looks_near_the_best_mode_and_at_times_anywhere() -> None:
    looks = [look(dataclasses.replace(BELIEF, searches=i)) for i in range(64)]
    anywhere = [one for one in looks if one.near is None]
    assert 4 <= len(anywhere) <= 16
    for one in looks:
        if one.near is not None:
            np.testing.assert_array_equal(one.near.X_PO, MODES.X_PO[0])
            # Much wider than the mode is: that may be too sure of itself.
            assert np.linalg.eigvalsh(one.near.covariance - 100.0 * MODES.covariance[0]).min() > 0.0
            assert not one.jumped
            assert one.probability > anywhere[0].probability


@pytest.mark.parametrize("searches", [0, 3])
def test_what_is_not_explained_is_near_first_and_then_anywhere(searches: int) -> None:
    belief = dataclasses.replace(BELIEF, searches=searches)
    near = look(belief, troubled=True)
    assert near.near is not None
    assert near.jumped
    assert near.probability > look(dataclasses.replace(BELIEF, searches=1)).probability
    assert look(dataclasses.replace(belief, explained_time=4.85), troubled=True).near is None


def test_after_a_while_without_touch_it_looks_over_the_spread_of_the_prediction() -> None:
    near = look(dataclasses.replace(BELIEF, touch_time=4.5), troubled=True).near
    assert near is not None
    np.testing.assert_array_equal(near.covariance, MODES.covariance[0])


def test_vision_and_a_prior_say_where() -> None:
    seen = PoseMeasurement.from_prior(GaussianPrior(ELSEWHERE), 5.0)
    assert where_to_look(BELIEF, MODES, seen, None, 0.2, troubled=False).near is seen
    none = ModeSet.empty()
    assert look(modes=none).near is None
    near = where_to_look(BELIEF, none, None, GaussianPrior(ELSEWHERE), 0.2, troubled=True).near
    assert near is not None
    np.testing.assert_array_equal(increments_between(near.X_PO, ELSEWHERE), np.zeros(6))
