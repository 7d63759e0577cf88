"""What a prior says that changes before the object is felt."""

import numpy as np
import pytest
from pydrake.math import RigidTransform

from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.estimation.prior import PosePrior
from tactopose_drake.systems.pose_belief_estimator import PoseBeliefEstimator
from tests.core.tracking.boxes import make_box
from tests.systems.belief_runs import X_PO, Run, begun, seen, still, touched

ELSEWHERE = RigidTransform([0.0, -0.3, 0.1]) @ X_PO


@pytest.fixture(scope="module")
def box() -> ObjectModel:
    return make_box()


def handed_over(time: float) -> PosePrior:
    """The object was elsewhere before it was brought between the fingers."""
    return PosePrior(ELSEWHERE if time < 0.105 else X_PO, sigma_translation=0.02)


def test_the_latest_prior_counts_until_the_object_is_felt(box: ObjectModel) -> None:
    run = Run(PoseBeliefEstimator(box), prior=handed_over, **touched(still, lambda time: time > 0.205))
    assert run.until(0.1).pose.IsNearlyEqualTo(ELSEWHERE, 1e-9)
    assert run.until(0.12).pose.IsNearlyEqualTo(X_PO, 1e-9)
    assert run.until(0.5).word == "ok"
    run.instants = [instant for instant in run.instants if instant.time > 0.105]
    run.assert_never_a_silent_guess(still)


def test_a_prior_that_is_less_sure_of_the_same_pose_says_nothing_new(box: ObjectModel) -> None:
    run = Run(
        PoseBeliefEstimator(box),
        prior=lambda time: PosePrior(X_PO, sigma_translation=0.02 if time < 0.105 else 0.2),
        **touched(still, lambda time: False),
    )
    before = run.until(0.1).belief.covariance
    np.testing.assert_array_equal(run.until(0.3).belief.covariance, before)


@pytest.mark.parametrize("live", [False, True])
def test_vision_without_a_time_that_says_something_else_is_believed_after_a_while(box: ObjectModel, live: bool) -> None:
    def camera(time: float) -> PosePrior:
        X = handed_over(time).X_PO @ RigidTransform([1e-6 * time if live else 0.0, 0.0, 0.0])
        return PosePrior(X, sigma_translation=0.02)

    run = Run(PoseBeliefEstimator(box), vision=camera, **touched(still, lambda time: False))
    first = run.until(0.5)
    assert first.pose.IsNearlyEqualTo(ELSEWHERE, 1e-3)
    assert "vision is not believed" in first.status
    last = run.until(1.5)
    assert last.pose.IsNearlyEqualTo(X_PO, 1e-3)
    assert last.status == "no_contact"


def test_a_prior_that_stays_is_not_forgotten_for_vision_that_is_off(box: ObjectModel) -> None:
    run = Run(
        PoseBeliefEstimator(box),
        prior=lambda time: PosePrior(X_PO),
        vision=begun(lambda time: seen(ELSEWHERE, time)),
        **touched(still, lambda time: False),
    )
    assert np.linalg.norm(run.until(1.5).pose.translation() - X_PO.translation()) < 0.02
