import numpy as np
import pytest
from pydrake.math import RigidTransform

from tactopose_drake.core.statuses import Status
from tactopose_drake.estimation.pose_hypothesis import PoseHypothesis
from tactopose_drake.estimation.ranking import (
    evidence_of_shapes,
    likelihood_weights,
    rank_objects,
    status_of_ranking,
)
from tactopose_drake.estimation.results import PoseEstimate


def an_estimate(status: Status = "ok", log_evidence: float = 0.0) -> PoseEstimate:
    pose = PoseHypothesis(RigidTransform(), 1.0, 1.0, np.eye(6), np.empty((0, 6)), True)
    return PoseEstimate((pose,), status, 0.01, log_evidence=log_evidence)


@pytest.mark.parametrize(
    ("weights", "groups", "touches", "unknown", "status"),
    [
        ([9.2, 0.4, 0.4], [0, 1, 2], 3, 0.0, "ok"),
        ([9.2, 0.4, 0.4], [0, 1, 2], 2, 0.0, "ambiguous"),  # two contacts say of no object that it is it
        ([8.8, 0.8, 0.4], [0, 1, 2], 5, 0.0, "ambiguous"),
        ([9.2, 0.4, 0.4], [0, 1, 2], 5, 0.05, "ambiguous"),  # 0.92 of 0.95
        ([9.4, 9.4, 1.2], [0, 0, 2], 5, 0.0, "ok"),  # whichever of two that have one shape
        ([9.2, 0.4, 0.4], [0, 1, 2], 5, 0.9, "no_solution"),
    ],
)
def test_an_object_is_named_by_three_touches_that_leave_it_nine_tenths(
    weights: list[float], groups: list[int], touches: int, unknown: float, status: Status
) -> None:
    estimates = [an_estimate()] * 3
    ranked = rank_objects(range(3), ["cup", "can", "box"], estimates, groups, weights, 1.0 - unknown)
    assert status_of_ranking(ranked, touches, unknown) == status


def test_no_object_is_named_that_does_not_explain_the_touch() -> None:
    ranked = rank_objects([0], ["cup"], [an_estimate("no_solution")], [0], [1.0], 1.0)
    assert status_of_ranking(ranked, 5, 0.0) == "no_solution"


def test_objects_of_one_shape_share_its_rank_and_the_mean_of_their_likelihoods() -> None:
    estimates = [an_estimate(log_evidence=value) for value in (1.0, 3.0, 2.0)]
    ranked = rank_objects([4, 5, 6], ["cup", "can", "other cup"], estimates, [0, 1, 0], [3.0, 4.0, 1.0], 0.5)
    assert [(each.name, each.index, each.rank) for each in ranked] == [
        ("can", 5, 1),
        ("cup", 4, 2),
        ("other cup", 6, 2),
    ]
    np.testing.assert_allclose([each.likelihood for each in ranked], [0.5, 0.25, 0.25])
    np.testing.assert_allclose([each.probability for each in ranked], [0.25, 0.125, 0.125])
    assert [each.log_evidence for each in ranked] == [3.0, 1.0, 2.0]


def test_objects_whose_likelihood_is_none_to_the_last_bit_are_in_order_of_their_evidence() -> None:
    """exp(-800) is 0. Of equal shapes the most evidence counts, though their likelihood is shared."""
    estimates = [an_estimate(log_evidence=value) for value in (-900.0, -1000.0, -1050.0, -100.0, -950.0)]
    groups, weights = [0, 1, 0, 3, 1], likelihood_weights(estimates, "evidence")
    assert weights == [0.0, 0.0, 0.0, 1.0, 0.0]
    assert evidence_of_shapes(estimates, groups) == [-900.0, -950.0, -100.0]
    ranked = rank_objects(range(5), list("zabcd"), estimates, groups, weights, 1.0)
    assert [(each.name, each.rank) for each in ranked] == [("c", 1), ("z", 2), ("b", 2), ("a", 4), ("d", 4)]
