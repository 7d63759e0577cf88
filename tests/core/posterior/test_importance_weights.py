import numpy as np
import pytest

from tactopose_drake.core.posterior.importance_sampling_kernels import Draws, WeightSummary, weigh


def test_of_groups_that_are_one_the_shares_are_as_sure_as_what_they_are_together() -> None:
    densities, weights = np.random.default_rng(0).uniform(size=(40, 3)), np.empty((40, 3))
    cost = np.linspace(0.5, 3.0, 40)
    draws, variance = Draws(cost, densities, np.array([20, 20]), np.array([2, 0])), np.empty(3)

    def weigh_families(family: list[int]) -> WeightSummary:
        return weigh(draws, np.array(family), 1.0, 10.0, 1.0, weights, variance)

    lowest, error, effective_samples, mass = weigh_families([0, 1, 2])
    assert variance.sum() == pytest.approx(error**2)
    assert variance[1] == 0.0
    assert variance[[0, 2]].min() > 0.1 * error**2
    np.testing.assert_allclose(weights.sum(axis=1), np.exp(lowest - cost) / densities.sum(axis=1))
    assert lowest == 0.5
    assert mass == pytest.approx(weights.sum())
    assert error > 0.01
    assert effective_samples == pytest.approx(weights.sum() ** 2 / np.sum(weights.sum(axis=1) ** 2))
    assert weigh_families([0, 0, 0])[1:3] == pytest.approx((0.0, effective_samples), abs=1e-12)
    assert 0.0 < weigh_families([0, 0, 2]).standard_error <= error


def test_a_sample_far_above_the_best_is_no_part_of_any_mode_however_much_room_there_is() -> None:
    # Three modes, of which the first two are one; samples at heights 2, 4 and 6 over the lowest, about each mode.
    height, density, weights = np.array([5.0, 7.0, 9.0]), np.full((3, 3), 1e-9), np.empty((3, 3))
    draws = Draws(height, density, np.array([3]), np.array([0]))
    summary = weigh(draws, np.array([0, 0, 2]), 3.0, 5.0, 1.0, weights, np.empty(3))
    assert summary.mass == pytest.approx(np.sum(np.exp(3.0 - height) / density.sum(axis=1)))
    np.testing.assert_array_equal(weights > 0.0, [[True] * 3, [True] * 3, [False] * 3])
    # Nor do samples that are no part of any outweigh all others in what they are together.
    density[2] = 1e-30
    summary = weigh(draws, np.array([0, 0, 2]), 3.0, 5.0, 1.0, weights, np.empty(3))
    np.testing.assert_allclose(summary.mass, 2.0 * weights.sum())


def test_one_sample_does_not_outweigh_all_others() -> None:
    count, power = 1000, 0.4
    density, weights = np.ones((count, 1)), np.empty((count, 1))
    density[17] = 1e-6
    draws = Draws(np.zeros(count), density, np.array([count]), np.array([0]))
    plain = weigh(draws, np.zeros(1, dtype=int), 0.0, 5.0, 1.0, weights, np.empty(1))
    assert weights[17, 0] == pytest.approx(1e6)
    assert plain.effective_samples < 1.01
    mean = weights.mean()
    truncated = weigh(draws, np.zeros(1, dtype=int), 0.0, 5.0, power, weights, np.empty(1))
    assert weights[17, 0] == pytest.approx(mean * count**power)
    np.testing.assert_allclose(np.delete(weights[:, 0], 17), 1.0)
    # That it did is told all the same: another round is called for.
    assert truncated.effective_samples == plain.effective_samples
    assert plain.mass == pytest.approx(1e6 + count - 1.0)
    assert truncated.mass == pytest.approx(weights.sum())


@pytest.mark.parametrize("count", [10, 14, 22, 30])
def test_samples_that_weigh_alike_do_not_add_less_than_nothing_to_the_variance(count: int) -> None:
    generator, variance = np.random.default_rng(0), np.empty(2)
    density = np.repeat(np.eye(2), [8, count], axis=0)
    for alike in generator.uniform(0.1, 0.9, 20):
        cost = np.append(generator.uniform(0.0, 1.0, 8), np.full(count, alike))
        draws = Draws(cost, density, np.array([8, count]), np.array([0, 1]))
        weigh(draws, np.array([0, 1]), 0.0, 10.0, 1.0, np.empty_like(density), variance)
        assert variance[0] > 0.0
        assert 0.0 <= variance[1] < 1e-15
