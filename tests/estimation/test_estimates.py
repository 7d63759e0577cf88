import dataclasses
import math

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw

import tactopose_drake as tp
from tactopose_drake.core.poses import increments_between, retract
from tactopose_drake.core.posterior.gaussian_mixture import GaussianMixture
from tactopose_drake.core.posterior.modes import Modes
from tactopose_drake.core.synthetic.synthetic_touch import touch_surface
from tactopose_drake.estimation.inference import _hypotheses
from tactopose_drake.estimation.results import status_of
from tactopose_drake.resources import model_path


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
    bust = tp.ObjectModel.from_mesh(model_path("objects", "bust.obj"))
    estimate = tp.estimate_pose(bust, touch_surface(bust, np.eye(3, 4), 2, np.random.default_rng(0)))
    assert estimate.best.probability < 0.9
    assert (estimate.status, estimate.undetermined) == ("ambiguous", True)
    assert estimate.keep([i == 0 for i in range(len(estimate))]).status == "ambiguous"


@pytest.mark.parametrize(("count", "undetermined"), [(5, True), (6, False)])
def test_distances_alone_determine_a_pose_from_six_on(count: int, undetermined: bool) -> None:
    bust = tp.ObjectModel.from_mesh(model_path("objects", "bust.obj"))
    felt = touch_surface(bust, np.eye(3, 4), count, np.random.default_rng(0))
    estimate = tp.estimate_pose(bust, tp.Contacts(felt.p_PC))
    assert estimate.undetermined == undetermined
    assert estimate.status == "ambiguous" or not undetermined
    assert not tp.estimate_pose(bust, tp.Contacts(felt.p_PC), prior=tp.PosePrior(np.eye(3, 4))).undetermined


def test_a_plane_and_a_continuous_symmetry_count_as_a_distance_each() -> None:
    bust = tp.ObjectModel.from_mesh(model_path("objects", "bust.obj"))
    p_PC = touch_surface(bust, np.eye(3, 4), 5, np.random.default_rng(0)).p_PC
    lowest = bust.vertices[bust.vertices[:, 2].argmin()]
    table = tp.PlaneContact(lowest, np.array([0.0, 0.0, 1.0]))
    assert not tp.estimate_pose(bust, tp.Contacts(p_PC), planes=[table]).undetermined
    can = tp.ObjectModel.from_mesh(model_path("objects", "cylinder.obj"))
    assert len(can.continuous_symmetries) == 1
    p_PC = touch_surface(can, np.eye(3, 4), 5, np.random.default_rng(0)).p_PC
    assert not tp.estimate_pose(can, tp.Contacts(p_PC)).undetermined
    assert tp.estimate_pose(can, tp.Contacts(p_PC[:4])).undetermined


@pytest.mark.parametrize(("told", "normal", "status"), [(0.0009, 0.1, "ok"), (0.1, 1.5, "ambiguous")])
def test_contacts_that_may_be_anywhere_determine_no_pose(told: float, normal: float, status: str) -> None:
    bust = tp.ObjectModel.from_mesh(model_path("objects", "bust.obj"))
    felt = touch_surface(bust, np.eye(3, 4), 5, np.random.default_rng(0))
    estimate = tp.estimate_pose(bust, tp.Contacts(felt.p_PC, felt.n_PC, sigma_position=told, sigma_normal=normal))
    assert (estimate.status, estimate.undetermined) == (status, status == "ambiguous")
    prior = tp.PosePrior(np.eye(3, 4))
    assert not tp.estimate_pose(bust, tp.Contacts(felt.p_PC, sigma_position=told), prior=prior).undetermined


def test_contacts_that_are_not_believed_determine_no_pose() -> None:
    bust = tp.ObjectModel.from_mesh(model_path("objects", "bust.obj"))
    felt = touch_surface(bust, np.eye(3, 4), 6, np.random.default_rng(0), sigma_position=0.0, sigma_normal=0.0)
    doubted = tp.estimate_pose(bust, tp.Contacts(felt.p_PC, felt.n_PC), outlier_probability=0.7)
    assert doubted.best.probability > 0.9
    assert doubted.best.inlier_probability.max() < 0.5
    assert (doubted.status, doubted.undetermined) == ("ambiguous", True)


def test_one_hypothesis_or_more_is_kept_of_as_many_as_there_are() -> None:
    with pytest.raises(tp.TactoposeError, match="kept must keep at least one hypothesis, not none"):
        weighed(1.0).keep((False,))
    with pytest.raises(tp.TactoposeError, match="kept must have an entry for each of 2 hypotheses, not 3"):
        weighed(0.5, 0.5).keep((True, True, True))


def test_hypotheses_that_are_left_out_count_for_the_status() -> None:
    all_of_them = weighed(0.5, 0.3, 0.2, status="ambiguous")
    assert all_of_them.first(3) is all_of_them
    first = all_of_them.first(1)
    assert (first.status, first.best.probability, first.kept_share) == ("ambiguous", 1.0, 0.5)
    assert first.keep([True]) == first
    # Without the second of the first two, 0.5 and the 0.2 that is left out are all that may be.
    left = all_of_them.first(2).keep([True, False])
    assert (left.status, left.best.probability) == ("ambiguous", 1.0)
    assert left.kept_share == pytest.approx(0.5 / 0.7)
    assert left.log_evidence == all_of_them.log_evidence


def test_what_is_left_out_twice_counts_twice() -> None:
    estimate = dataclasses.replace(weighed(0.5, 0.3, 0.2, status="ambiguous"), log_evidence=-4.0, kept_share=0.8)
    assert estimate.first(2).kept_share == pytest.approx(0.8 * 0.8)
    assert estimate.first(2).first(1).kept_share == pytest.approx(0.8 * 0.5)
    # 0.8 times 0.3 are impossible: so much less does the object explain.
    left = estimate.keep([True, False, True])
    assert left.log_evidence == pytest.approx(-4.0 + math.log(1.0 - 0.8 * 0.3))
    assert left.kept_share == pytest.approx(0.8 * 0.7 / (1.0 - 0.8 * 0.3))


def test_of_whole_families_of_poses_one_that_explains_little_is_enough() -> None:
    hypotheses = weighed(0.96, 0.04, explains=(False, True)).hypotheses
    assert status_of(hypotheses, undetermined=True) == "ambiguous"
    assert status_of(hypotheses, undetermined=False) == "no_solution"
    assert status_of(weighed(1.0, explains=(False,)).hypotheses, undetermined=True) == "no_solution"


@pytest.mark.parametrize("count", [1, 2, 5])
def test_fewer_hypotheses_are_those_of_more(count: int) -> None:
    bust = tp.ObjectModel.from_mesh(model_path("objects", "bust.obj"))
    contacts = touch_surface(bust, np.eye(3, 4), 3, np.random.default_rng(0))
    all_of_them, few = (tp.estimate_pose(bust, contacts, max_hypotheses=most) for most in (64, count))
    assert len(all_of_them) > 5
    assert (few.status, all_of_them.status) == ("ambiguous", "ambiguous")
    assert few.log_evidence == all_of_them.log_evidence
    assert [each.cost for each in few] == [each.cost for each in all_of_them[:count]]
    share = sum(each.probability for each in all_of_them[:count])
    assert few.kept_share == pytest.approx(share)
    expected = [each.probability / share for each in all_of_them[:count]]
    assert [each.probability for each in few] == pytest.approx(expected)


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


def test_who_changes_a_pose_that_was_told_changes_nothing_of_the_estimate() -> None:
    told = tp.PoseHypothesis(RigidTransform([0.1, 0.2, 0.3]), 1.0, 1.0, np.eye(6), np.zeros((0, 6)))
    told.X_PO.set_translation([9.0, 9.0, 9.0])
    np.testing.assert_array_equal(told.X_PO.translation(), [0.1, 0.2, 0.3])
    with pytest.raises(AttributeError):
        told.X_PO = RigidTransform()  # type: ignore[misc]


def test_what_an_estimate_is_asked_with_values_of_other_types_is_named() -> None:
    made = weighed(0.5, 0.5)
    for ask, message in (
        (lambda: made.keep(None), "kept must be a Collection, not None"),
        (lambda: made.keep("ab"), r"kept\[0\] must be True or False, not 'a'"),
        (lambda: made.first("x"), "count must be an integer >= 1, not 'x'"),
        (lambda: made.first(-1), "count must be an integer >= 1, not -1"),
        (lambda: made.table("x"), "most must be an integer >= 0, not 'x'"),
        (lambda: made.best.in_world(None), "X_WP must be a RigidTransform, not None"),
        (lambda: made.save_html(None), "path must be a path, not None"),
    ):
        with pytest.raises(tp.TactoposeError, match=f"^{message}"):
            ask()


def test_no_probability_is_above_one() -> None:
    # Of two weights that sum to more than 1 by rounding, one is left, and it was all.
    almost = math.nextafter(1.0, 2.0)
    kept = weighed(almost, 0.0).first(1)
    assert (kept.best.probability, kept.kept_share) == (1.0, 1.0)
    mixture = GaussianMixture(np.eye(3, 4)[None], np.array([almost]), np.eye(6)[None])
    modes = Modes(mixture, np.zeros(1), (np.zeros((0, 6)),), 0.0)
    assert _hypotheses(modes, np.ones((1, 3)), np.ones(1, dtype=bool))[0].probability == 1.0
