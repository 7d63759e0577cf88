import dataclasses
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from tactopose_drake.core.objectives.objective import NormalEquations
from tactopose_drake.core.poses import exp_so3, increments_between, make_poses, retract
from tactopose_drake.core.posterior import importance_sampling
from tactopose_drake.core.posterior.gaussian_mixture import GaussianMixture
from tactopose_drake.core.posterior.importance_sampling import Samples, weigh_modes
from tactopose_drake.core.posterior.joined_modes import Families
from tactopose_drake.core.posterior.mode_moments import with_moments
from tactopose_drake.core.posterior.mode_moments_kernels import WeightedSamples
from tactopose_drake.core.posterior.modes import Modes
from tactopose_drake.core.posterior.posterior_params import PosteriorParams, SamplingParams
from tactopose_drake.core.validation import FloatArray
from tests.core.posterior.valleys import SIGMAS, Valley, modes, moments_of, pose, posterior


def test_a_gaussian_comes_back_as_it_was() -> None:
    valley = Valley(pose(), SIGMAS)
    found = weigh_modes(modes(valley, pose()[None]), posterior(valley, samples=8000), np.random.default_rng(0))
    np.testing.assert_allclose(np.sqrt(np.diag(found.mixture.covariance[0])), SIGMAS, rtol=0.06)
    whitened = found.mixture.covariance[0] / np.outer(SIGMAS, SIGMAS)
    np.testing.assert_allclose(whitened, np.eye(6), atol=0.1)
    assert found.mixture.weights[0] == pytest.approx(1.0)


def test_the_exact_cost_counts_and_not_the_smooth_one() -> None:
    # The exact posterior is half as wide in one direction, and a standard deviation beside in another.
    other = SIGMAS * np.array([1, 0.5, 1, 1, 1, 1])
    beside = np.array([0, 0, 0, 0, SIGMAS[4], 0])
    smooth, exact = Valley(pose(), SIGMAS), Valley(retract(pose(), beside), other)
    found = weigh_modes(
        modes(smooth, pose()[None]), posterior(smooth, exact.cost, samples=8000), np.random.default_rng(0)
    )
    spread = np.sqrt(np.diag(found.mixture.covariance[0]))
    np.testing.assert_allclose(spread[[0, 1, 2, 3, 5]], other[[0, 1, 2, 3, 5]], rtol=0.08)
    # The pose goes three quarters of the way, which the smooth cost allows; what is left of it counts as spread.
    moved = increments_between(pose(), found.mixture.X_PO[0]) / SIGMAS
    np.testing.assert_allclose(moved, [0, 0, 0, 0, 0.75, 0], atol=0.05)
    assert found.cost[0] == pytest.approx(0.5 * 0.75**2, abs=0.03)
    assert spread[4] == pytest.approx(math.hypot(1.0, 0.25) * SIGMAS[4], rel=0.08)


def test_the_pose_is_the_mean_as_far_as_it_explains_the_touch() -> None:
    # Exact posteriors so many standard deviations away: the smooth cost allows less and less of the way there.
    u = SIGMAS * np.array([1, 1, 0, 1, 1, 1]) / math.sqrt(5.0)
    for share, allowed in ((0.6, 1.0), (1.0, 0.75), (1.4, 0.5), (2.8, 0.25), (4.0, 0.0)):
        smooth, exact = Valley(pose(), SIGMAS), Valley(retract(pose(), share * u), SIGMAS)
        # In rounds: of the first one's samples none is where the exact posterior lies in the last case.
        found = weigh_modes(
            modes(smooth, pose()[None]), posterior(smooth, exact.cost, samples=1000), np.random.default_rng(0)
        )
        moved = increments_between(pose(), found.mixture.X_PO[0])
        np.testing.assert_allclose(moved / SIGMAS, allowed * share * u / SIGMAS, atol=0.1)
        assert found.cost[0] == pytest.approx(smooth.cost(found.mixture.X_PO)[0], abs=1e-12)
        assert found.cost[0] <= 0.3


@pytest.mark.parametrize("count", [15, 120, 400])
def test_the_spread_is_about_the_pose_wherever_it_ends(count: int) -> None:
    # Of few samples a part of their mean may be chance: the pose stops short of it.
    valley = Valley(pose(), SIGMAS)
    start = modes(valley, pose()[None])
    normal = np.random.default_rng(1).normal(size=(count, 6)) + np.array([0.9, 0, 0, 0, 0, 0])
    X_PO, weights = retract(pose(), 0.5 * normal * SIGMAS), np.ones((count, 1))
    alone, told = Families(pose()[None], np.zeros(1, dtype=int), np.eye(3, 4)[None], 0.1), posterior(valley)
    found = with_moments(start, np.array([0]), np.ones(1), WeightedSamples(pose()[None], X_PO, weights), alone, told)
    assert found is not None
    moved, scale = found.mixture.X_PO, np.outer(SIGMAS, SIGMAS)
    share = increments_between(pose(), moved[0])[0] / increments_between(pose(), X_PO)[:, 0].mean()
    assert share == pytest.approx(0.0) if count == 15 else 0.1 < share < 1.0
    second = moments_of(moved, X_PO, weights).second[0]
    expected = second + told.params.moments.pseudo_samples / count * start.mixture.covariance[0]
    np.testing.assert_allclose(found.mixture.covariance[0] / scale, expected / scale, atol=0.01)


def test_modes_of_which_only_one_sample_counts_have_no_moments() -> None:
    valley, X_PO = Valley(pose(), SIGMAS), retract(pose(), np.diag(SIGMAS)[:2])
    alone = Families(pose()[None], np.zeros(1, dtype=int), np.eye(3, 4)[None], 0.1)
    samples = WeightedSamples(pose()[None], X_PO, np.array([[1.0], [0.0]]))
    start, masses = modes(valley, pose()[None]), np.ones(1)
    assert with_moments(start, np.array([0]), masses, samples, alone, posterior(valley)) is None


def test_the_masses_are_those_of_the_exact_posterior() -> None:
    first = Valley(pose(), SIGMAS)
    second = Valley(retract(pose(), np.array([0, 0, 1.0, 0.1, 0, 0])), 1.3 * SIGMAS)

    def both(X_PO: FloatArray) -> FloatArray:
        cost: FloatArray = -np.log(np.exp(-first.cost(X_PO)) + np.exp(-1.0 - second.cost(X_PO)) + 1e-300)
        return cost

    class Nearest(Valley):
        def residuals(self, X_PO: FloatArray) -> FloatArray:
            near = first.cost(X_PO) < second.cost(X_PO)
            return np.where(near[:, None], first.residuals(X_PO), second.residuals(X_PO))

    X_PO = np.stack([first.X_PO, second.X_PO])
    covariance = np.stack([np.diag(SIGMAS**2), np.diag(SIGMAS**2)])
    mixture = GaussianMixture(X_PO, np.array([0.9, 0.1]), covariance)
    start = Modes(mixture, np.array([0.0, 1.0]), (np.empty((0, 6)),) * 2, 0.0)
    found = weigh_modes(
        start, posterior(Nearest(pose(), SIGMAS), both, samples=8000, tiles=20), np.random.default_rng(0)
    )
    expected = math.exp(-1.0) * 1.3**6 / (1.0 + math.exp(-1.0) * 1.3**6)
    is_second = np.abs(found.mixture.X_PO[:, 0, 3] - second.X_PO[0, 3]) < 0.05
    assert is_second.sum() == 1
    assert found.mixture.weights[is_second][0] == pytest.approx(expected, rel=0.1)
    assert np.all(np.diff(found.mixture.weights) <= 0)


def test_a_mode_that_reaches_its_own_images_counts_once() -> None:
    # Thirds of a turn about z are a symmetry. One mode is free in that turn, the other is not: as wide as a third of a
    # turn is the first one's mass, which its images share, and so is the other's.
    third, sigma = 2.0 * np.pi / 3.0, 0.2
    lower = math.log(third / (math.sqrt(2.0 * math.pi) * sigma))
    away = np.array([0.0, 0.1, 0.0])

    class Thirds(Valley):
        def residuals(self, X_PO: FloatArray) -> FloatArray:
            spin = np.arctan2(X_PO[:, 1, 0], X_PO[:, 0, 0])
            spin = spin - third * np.rint(spin / third)
            is_away = X_PO[:, 1, 3] > 0.05
            middle = X_PO[:, :, 3] - np.where(is_away[:, None], away, 0.0)
            turn = np.where(is_away, spin / sigma, 0.0)
            rows: FloatArray = np.concatenate([X_PO[:, :2, 2] / 0.03, middle / 0.001, turn[:, None]], axis=1)
            return rows

        def cost(self, X_PO: FloatArray) -> FloatArray:
            cost: FloatArray = super().cost(X_PO) - np.where(X_PO[:, 1, 3] > 0.05, lower, 0.0)
            return cost

    X_PO = np.stack([np.eye(3, 4), make_poses(np.eye(3), away)])
    images = make_poses(exp_so3(np.outer([0.0, 1.0, -1.0], [0.0, 0.0, third])), np.zeros((3, 3)))
    valley = Thirds(np.eye(3, 4), SIGMAS)
    covariance = np.linalg.inv(valley.normal_equations(X_PO).hessian + np.diag([0, 0, 1 / 1.7, 0, 0, 0]))
    start = Modes(GaussianMixture(X_PO, np.full(2, 0.5), covariance), valley.cost(X_PO), (np.empty((0, 6)),) * 2, 0.0)
    asked = dataclasses.replace(posterior(valley, samples=4000, tiles=32), symmetry_poses=images)
    shares, spreads = [], []
    for seed in range(9):
        found = weigh_modes(start, asked, np.random.default_rng(seed))
        is_away = found.mixture.X_PO[:, 1, 3] > 0.05
        shares.append(found.mixture.weights[is_away].sum())
        spreads.append(found.mixture.covariance[~is_away][0, 2, 2])
    assert np.median(shares) == pytest.approx(0.5, abs=0.05)
    # The turn is known as well as the symmetry tells it: evenly within a third.
    assert np.median(spreads) == pytest.approx(third**2 / 12.0, rel=0.15)


def test_a_bent_valley_is_as_long_as_it_is() -> None:
    # A turn with a standard deviation of 20 degrees moves the object along an arc of 100 mm.
    sigmas = np.array([0.02, 0.02, math.radians(20), 0.001, 0.001, 0.001])
    valley = Valley(np.eye(3, 4), sigmas, bend=0.1)
    start = modes(valley, np.eye(3, 4)[None])
    asked = dataclasses.replace(posterior(valley), params=PosteriorParams(sampling=SamplingParams(samples=4000)))
    found = [weigh_modes(start, asked, np.random.default_rng(seed)).mixture.covariance[0] for seed in range(10)]
    turn = np.random.default_rng(1).normal(size=200_000) * sigmas[2]
    arc = np.stack([turn, 0.1 * (1 - np.cos(turn)), 0.1 * np.sin(turn)])
    expected = np.sqrt(np.mean(arc**2, axis=1) + np.array([0.0, 1e-6, 1e-6]))
    np.testing.assert_allclose(np.sqrt(np.diag(np.mean(found, axis=0)))[2:5], expected, rtol=0.1)
    # Laplace's approximation knows nothing of the way across the tangent.
    assert np.sqrt(start.mixture.covariance[0, 3, 3]) < 0.3 * expected[1]


def test_a_turn_that_changes_nothing_is_reported_as_that_and_does_not_cost_samples() -> None:
    # Nothing tells turns about the axis z through (0.02, 0, 0) apart.
    X, axis, point = pose(), np.array([[0.0, 0.0, 1.0]]), np.array([[0.02, 0.0, 0.0]])

    class Round(Valley):
        def residuals(self, X_PO: FloatArray) -> FloatArray:
            R = X[:, :3].T @ X_PO[:, :, :3]
            middle = X_PO[:, :, :3] @ point[0] + X_PO[:, :, 3] - (X[:, :3] @ point[0] + X[:, 3])
            rows: FloatArray = np.concatenate([R[:, :2, 2] / 0.03, middle / 0.001], axis=1)
            return rows

    valley = Round(X, SIGMAS)
    start = modes(valley, X[None])
    held = np.diag([0, 0, 1 / 1.7, 0, 0, 0])
    covariance = np.linalg.inv(valley.normal_equations(X[None]).hessian + held)
    start = dataclasses.replace(start, mixture=dataclasses.replace(start.mixture, covariance=covariance))
    found = weigh_modes(
        start, posterior(valley, turns=(axis, np.cross(point, axis)), samples=6000), np.random.default_rng(0)
    )
    turn = np.concatenate([axis[0], -X[:, :3] @ np.cross(axis[0], point[0])])
    information = np.linalg.inv(found.mixture.covariance[0])
    assert 1.0 / (turn @ information @ turn) == pytest.approx(1.7, rel=0.05)
    # The middle's place is as certain as it is told.
    shift = np.concatenate([-X[:, :3] @ np.array([[0, 0, 0], [0, 0, -0.02], [0, 0.02, 0]]), np.eye(3)], axis=1)
    np.testing.assert_allclose(np.sqrt(np.diag(shift @ found.mixture.covariance[0] @ shift.T)), 0.001, rtol=0.1)


# At 420 samples have weights, but the squares of those are no numbers.
@pytest.mark.parametrize("cost", [420.0, 1e9])
def test_where_no_sample_counts_the_modes_stay_as_they_were(cost: float) -> None:
    valley = Valley(pose(), SIGMAS)
    start = modes(valley, pose()[None])
    found = weigh_modes(start, posterior(valley, lambda X_PO: np.full(len(X_PO), cost)), np.random.default_rng(0))
    np.testing.assert_array_equal(found.mixture.covariance, start.mixture.covariance)
    np.testing.assert_array_equal(found.mixture.X_PO, start.mixture.X_PO)


def test_a_spread_that_doubles_do_not_hold_stays_as_it_was() -> None:
    valley = Valley(pose(), SIGMAS)
    # Whether 1e-19 beside 0.01, turned, has an inverse in doubles is a matter of how a processor rounds; zero has none.
    flat = np.diag([0.0, 0.01, 0.01, 0.01, 0.01, 0.01])
    start = modes(valley, pose()[None])
    start = dataclasses.replace(start, mixture=GaussianMixture(pose()[None], np.ones(1), flat[None]))
    found = weigh_modes(start, posterior(valley), np.random.default_rng(0))
    np.testing.assert_array_equal(found.mixture.covariance, start.mixture.covariance)
    assert found.mixture.weights == 1.0


def test_the_worth_of_samples_is_their_number_where_they_weigh_the_same() -> None:
    X_PO = retract(pose(), np.random.default_rng(0).normal(size=(50, 6)) * SIGMAS)
    moments = moments_of(pose()[None], X_PO, np.full((50, 1), 0.3))
    assert moments.effective_samples[0] == pytest.approx(50.0)
    u = increments_between(pose(), X_PO)
    np.testing.assert_allclose(moments.first[0], u.mean(axis=0), rtol=1e-9)
    np.testing.assert_allclose(moments.second[0], u.T @ u / 50, rtol=1e-9)


def two_modes() -> tuple[Modes, Valley, Callable[[FloatArray], FloatArray]]:
    """Two modes far apart, their smooth cost, and the exact one, which makes one of them rarer."""
    far = retract(pose(), np.array([0.0, 0.0, 0.0, 0.4, 0.0, 0.0]))
    near, away = Valley(pose(), SIGMAS), Valley(far, SIGMAS)

    def exact(X_PO: FloatArray) -> FloatArray:
        return np.minimum(near.cost(X_PO) + 0.05 * np.sin(900.0 * X_PO[:, 0, 3]), away.cost(X_PO) + 1.0)

    class Both(Valley):
        def cost(self, X_PO: FloatArray) -> FloatArray:
            return np.minimum(near.cost(X_PO), away.cost(X_PO))

        def normal_equations(self, X_PO: FloatArray) -> NormalEquations:
            is_near = near.cost(X_PO) < away.cost(X_PO)
            parts = [(near.normal_equations(X_PO)), (away.normal_equations(X_PO))]
            return NormalEquations(
                *(np.where(is_near.reshape(-1, *[1] * (a.ndim - 1)), a, b) for a, b in zip(*parts, strict=True))
            )

    both = Both(pose(), SIGMAS)
    X_PO = np.concatenate([pose()[None], far[None]])
    covariance = np.linalg.inv(both.normal_equations(X_PO).hessian + 1e-9 * np.eye(6))
    start = Modes(GaussianMixture(X_PO, np.array([0.5, 0.5]), covariance), exact(X_PO), (np.empty((0, 6)),) * 2, 0.0)
    return start, both, exact


def test_the_standard_error_is_that_of_the_weights_from_seed_to_seed() -> None:
    """Two modes far apart, of which the exact cost makes one rarer: its share varies as is said."""
    start, both, exact = two_modes()
    found = [weigh_modes(start, posterior(both, exact), np.random.default_rng(seed)) for seed in range(40)]
    spread = np.std([modes.mixture.weights[0] for modes in found])
    stated = np.median([modes.standard_error for modes in found])
    assert 0.0 < stated <= 0.021
    assert 0.4 * stated < spread < 2.0 * stated


def first_and_last(
    start: Modes, smooth: Valley, exact: Callable[[FloatArray], FloatArray], **sampling: float
) -> tuple[Samples, Samples]:
    """The samples after the first round and after the last one."""
    told, seen = posterior(smooth, exact), []
    params = dataclasses.replace(told.params, sampling=dataclasses.replace(told.params.sampling, **sampling))
    told = dataclasses.replace(told, params=params)
    weighed_anew = importance_sampling._weighed_anew

    def watched(*arguments: Any) -> Samples:
        seen.append(weighed_anew(*arguments))
        return seen[-1]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(importance_sampling, "_weighed_anew", watched)
        weigh_modes(start, told, np.random.default_rng(0))
    return seen[0], seen[-1]


def test_proposals_that_are_good_enough_are_drawn_from_again_as_they_are() -> None:
    first, last = first_and_last(*two_modes())
    assert first.summary.standard_error > 0.019 >= last.summary.standard_error
    assert last.times.min() >= 1
    assert last.times.max() > 1
    assert last.proposal is first.proposal
    assert len(last.X_PO) == last.times @ last.once > len(first.X_PO)
    # All samples are weighed by the density that all of them have.
    density = np.zeros_like(last.density)
    often = dataclasses.replace(last.proposal, count=last.times[last.proposal.group] * last.proposal.count)
    often.add_to(density, last.X_PO)
    np.testing.assert_allclose(last.density, density, rtol=1e-9)
    assert last.each.sum() == len(last.X_PO)


def test_the_noisier_samples_are_the_more_of_them_are_drawn() -> None:
    start, smooth, exact = two_modes()
    X_near = start.mixture.X_PO[0]

    def rough(X_PO: FloatArray) -> FloatArray:
        """About the first mode the cost has bumps everywhere."""
        is_near = np.linalg.norm(X_PO[:, :, 3] - X_near[:, 3], axis=1) < 0.1
        return exact(X_PO) + is_near * (2.0 + 3.0 * np.sin(9000.0 * X_PO[:, 0, 3]))

    for often, cost in ((False, exact), (True, rough)):
        _, last = first_and_last(start, smooth, cost)
        assert (last.times[0] > 1.5 * last.times[1]) == often
        assert last.summary.standard_error <= 0.019


@pytest.mark.parametrize(("error", "most"), [(1e-3, 1), (1e-3, 500), (1e-200, 1000)])
def test_however_sure_shares_shall_be_there_are_no_more_samples_than_allowed(error: float, most: int) -> None:
    first, last = first_and_last(*two_modes(), standard_error=error, most_samples=most)
    assert len(last.X_PO) <= max(most, len(first.X_PO))
    # As many as there may be, but for fewer than are drawn of one mode's proposals at a time.
    assert len(last.X_PO) > most - last.once.max()


def test_proposals_that_are_not_are_made_anew_first() -> None:
    # The exact posterior lies beside the smooth one, where few of the first samples are.
    beside = Valley(retract(pose(), 1.6 * SIGMAS), 0.6 * SIGMAS)
    first, last = first_and_last(modes(Valley(pose(), SIGMAS), pose()[None]), Valley(pose(), SIGMAS), beside.cost)
    shares = [each.summary.effective_samples / len(each.X_PO) for each in (first, last)]
    assert shares[0] < 0.1
    assert len(last.proposal.group) > len(first.proposal.group)
    assert shares[1] > 2.0 * shares[0]
    density = np.zeros_like(last.density)
    last.proposal.add_to(density, last.X_PO)
    np.testing.assert_allclose(last.density, last.times * density, rtol=1e-9)
