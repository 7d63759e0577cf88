import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw

import tactopose_drake as tp
from tactopose_drake.core.poses import increments_between, retract


def weighed(*probabilities: float, status: str = "ok", explains: tuple[bool, ...] | None = None) -> tp.PoseEstimate:
    explains = explains or (True,) * len(probabilities)
    hypotheses = tuple(
        tp.PoseHypothesis(RigidTransform([x, 0, 0]), float(x), probability, np.eye(6), np.zeros((0, 6)), explained)
        for x, (probability, explained) in enumerate(zip(probabilities, explains, strict=True))
    )
    return tp.PoseEstimate(hypotheses, status, 0.01)


@pytest.mark.parametrize(
    ("probabilities", "kept", "left", "status"),
    [
        ((0.6, 0.37, 0.03), (False, True, True), (0.925, 0.075), "ok"),
        ((0.6, 0.3, 0.1), (False, True, True), (0.75, 0.25), "ambiguous"),
        ((0.6, 0.15, 0.13, 0.12), (False, True, True, True), (0.375, 0.325, 0.3), "ambiguous"),
        ((0.4, 0.35, 0.25), (True, False, False), (1.0,), "ok"),
        ((1.0, 0.0, 0.0), (False, True, True), (0.5, 0.5), "ambiguous"),
    ],
)
def test_hypotheses_that_are_kept_are_weighed_among_themselves(
    probabilities: tuple[float, ...], kept: tuple[bool, ...], left: tuple[float, ...], status: str
) -> None:
    before = weighed(*probabilities, status="ok" if probabilities[0] >= 0.9 else "ambiguous")
    after = before.keep(kept)
    assert [h.probability for h in after.hypotheses] == pytest.approx(left)
    expected = [h.X_PO for h, stays in zip(before.hypotheses, kept, strict=True) if stays]
    assert all(h.X_PO.IsExactlyEqualTo(X_PO) for h, X_PO in zip(after.hypotheses, expected, strict=True))
    assert (after.status, after.duration) == (status, before.duration)


def test_a_kept_hypothesis_that_does_not_explain_the_touch_is_no_solution() -> None:
    assert weighed(0.9, 0.1, explains=(True, False)).keep((False, True)).status == "no_solution"


def test_too_few_contacts_stay_ambiguous_whatever_is_kept() -> None:
    assert weighed(0.95, 0.05, status="ambiguous").keep((True, False)).status == "ambiguous"


def test_at_least_one_hypothesis_is_kept() -> None:
    with pytest.raises(tp.TactoposeError, match="kept: keeps no hypothesis"):
        weighed(1.0).keep((False,))


def test_a_hypothesis_is_carried_into_the_world_with_its_covariance() -> None:
    generator = np.random.default_rng(0)
    A = generator.normal(size=(6, 6))
    X_PO = RigidTransform(RollPitchYaw(0.3, -0.7, 2.0), [0.1, -0.2, 0.05])
    hypothesis = tp.PoseHypothesis(X_PO, 1.0, 1.0, A @ A.T, np.zeros((0, 6)))
    X_WP = RigidTransform(RollPitchYaw(-1.0, 0.4, 0.6), [0.5, 0.0, 1.2])
    X_WO, covariance = hypothesis.in_world(X_WP)
    assert X_WO.IsNearlyEqualTo(X_WP @ X_PO, 1e-15)
    # The columns of A, whose squares the covariance is, as increments of the pose in the palm and in the world.
    before, after = X_PO.GetAsMatrix34(), X_WO.GetAsMatrix34()
    step = 1e-6
    moved = [X_WP @ RigidTransform(retract(before, step * column)) for column in A.T]
    B = np.array([increments_between(after, X.GetAsMatrix34()) for X in moved]).T / step
    np.testing.assert_allclose(covariance, B @ B.T, rtol=1e-5, atol=1e-5)
