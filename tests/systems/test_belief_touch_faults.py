"""What the belief says while touch fails: the object is gone or elsewhere, what is felt never changes."""

import math

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.tracking.frame import PoseMeasurement
from tactopose_drake.estimation.prior import PosePrior
from tactopose_drake.systems.pose_belief_estimator import PoseBeliefEstimator
from tests.core.tracking.boxes import make_box, touch
from tests.systems.belief_runs import FINGERS, X_PO, Run, begun, generator_at, seen, still, touched


@pytest.fixture(scope="module")
def box() -> ObjectModel:
    return make_box()


def test_an_object_that_is_taken_away_is_said_to_be_gone(box: ObjectModel) -> None:
    run = Run(PoseBeliefEstimator(box), vision=begun(lambda time: None), **touched(still, lambda time: time < 0.205))
    assert run.until(0.2).word == "ok"
    spread = [np.trace(run.until(time).belief.covariance[0]) for time in (0.22, 0.5, 1.1)]
    assert spread == sorted(spread)
    assert run.words(0.21, 1.1) == {"no_contact"}
    assert run.until(1.5).status.startswith("lost: nothing was touched or seen for 1.")
    assert run.words(1.3, 1.5) == {"lost"}
    assert run.read("hypotheses").status == "no_solution"


def test_hypotheses_that_do_not_explain_the_touch_are_no_solution(box: ObjectModel) -> None:
    """The object jumps in the hand: until it is found again, its former pose is not what is felt."""
    jumped = X_PO @ RigidTransform(RollPitchYaw(0.0, 0.0, 0.6), [0.02, 0.0, 0.02])
    signals = touched(lambda time: X_PO if time < 0.3 else jumped)
    run, unexplained = Run(PoseBeliefEstimator(box), vision=begun(lambda time: None), **signals), 0
    assert run.until(0.29).word == "ok"
    for time in np.arange(0.3, 0.6, 0.01):
        belief, estimate = run.until(time).belief, run.read("hypotheses")
        unexplained += not belief.explains_touch.any()
        assert (estimate.status == "no_solution") == (not belief.explains_touch.any())
        assert estimate.best.explains_touch or estimate.status != "ok"
    assert unexplained > 0


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("with_vision", [False, True])
def test_an_object_that_comes_back_elsewhere_is_found_anew(box: ObjectModel, seed: int, with_vision: bool) -> None:
    """Turned by a right angle or two: the pose from before says nothing, and is not what tells half turns apart."""
    generator = np.random.default_rng(seed)
    turn = RollPitchYaw(*generator.uniform(-math.pi, math.pi, 3))
    elsewhere = X_PO @ RigidTransform(turn, generator.uniform(-0.05, 0.05, 3))

    def truth(time: float) -> RigidTransform:
        return X_PO if time < 1.0 else elsewhere

    def vision(time: float) -> PoseMeasurement | None:
        return seen(elsewhere, time, generator_at(time)) if with_vision and time > 1.5 else None

    run = Run(PoseBeliefEstimator(box), vision=begun(vision), **touched(truth, lambda time: not 0.205 < time < 1.505))
    assert run.until(0.2).word == "ok"
    assert run.until(1.5).word == "lost"
    assert run.until(2.0).word == ("ok" if with_vision else "ambiguous")
    run.assert_never_a_silent_guess(truth)


@pytest.mark.parametrize("seed", range(4))
def test_a_prior_of_the_grasp_before_says_nothing_of_the_next(box: ObjectModel, seed: int) -> None:
    turn = RollPitchYaw(*np.random.default_rng(seed).uniform(-math.pi, math.pi, 3))
    elsewhere = X_PO @ RigidTransform(turn, [0.03, -0.02, 0.02])

    def truth(time: float) -> RigidTransform:
        return X_PO if time < 1.0 else elsewhere

    guess, later = (PosePrior(X, sigma_translation=0.005, sigma_rotation=0.1) for X in (X_PO, elsewhere))
    touches = touched(truth, lambda time: not 0.205 < time < 1.505)
    run = Run(PoseBeliefEstimator(box), prior=lambda time: guess, **touches)
    assert run.until(0.2).word == "ok"
    assert run.until(2.0).word == "ambiguous", "half turns of the box are not told apart"
    run.assert_never_a_silent_guess(truth)
    run = Run(PoseBeliefEstimator(box), prior=lambda time: guess if time < 1.0 else later, **touches)
    assert run.until(2.0).word == "ok", "a new one counts"
    run.assert_never_a_silent_guess(truth)


def test_a_touch_that_never_changes_is_remarked(box: ObjectModel) -> None:
    frozen = touch(X_PO.GetAsMatrix34(), np.random.default_rng(0))
    run = Run(
        PoseBeliefEstimator(box),
        contacts=lambda time: frozen,
        fingers_in_contact=lambda time: FINGERS,
        vision=begun(lambda time: None),
    )
    assert run.until(0.4).status == "ok"
    assert "the touch has been the same for 0.8 s" in run.until(0.85).status
    assert np.trace(run.instants[-1].belief.covariance[0]) > np.trace(run.instants[5].belief.covariance[0])


def test_a_finger_that_never_changes_is_remarked_by_its_name(box: ObjectModel) -> None:
    random = np.random.default_rng(0)
    frozen = touch(X_PO.GetAsMatrix34(), random)

    def contacts(time: float) -> Contacts:
        alive = touch(X_PO.GetAsMatrix34(), random)
        p_PC = alive.p_PC.copy()
        p_PC[1] = frozen.p_PC[1]
        return alive.with_arrays(p_PC=p_PC)

    run = Run(
        PoseBeliefEstimator(box),
        contacts=contacts,
        fingers_in_contact=lambda time: FINGERS,
        vision=begun(lambda time: None),
    )
    assert run.until(0.4).status == "ok"
    assert run.until(0.85).status == f"ok: the touch of {FINGERS[1]} has been the same for 0.8 s"
