import dataclasses

import numpy as np
import pytest
from scipy.stats import chisquare, kstest

from tactopose_drake.core.poses import make_poses, matrix_from_quaternion, rotation_angles
from tactopose_drake.core.searches.baselines.initial_population import (
    near_particles,
    scattered_particles,
    straight_quaternions,
    uniform_quaternions,
)
from tactopose_drake.core.searches.baselines.monte_carlo import MonteCarlo, MonteCarloDesign, noise_schedule
from tactopose_drake.core.searches.baselines.roulette_kernels import (
    breed,
    find_parent,
    mark_different,
    place,
    weigh,
)
from tactopose_drake.core.searches.levenberg_marquardt import LevenbergMarquardt
from tactopose_drake.core.searches.search import PriorSpace
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import FloatArray
from tactopose_drake.errors import InvalidInputError
from tests.core.searches.problems import make_touch

DESIGN = MonteCarloDesign(particles=3000, population=300, power=100.0, noise=0.4, cooling=2.0, confidence=99.0)
STAYING = LevenbergMarquardt(max_iterations=1, initial_damping=1e30)


def wheel(cost: FloatArray, scale: float = 1.0, power: float = 1.0) -> tuple[FloatArray, FloatArray]:
    weight, sums = np.empty(len(cost)), np.empty(len(cost))
    weigh(cost, scale, power, weight, sums, 0, len(cost))
    return weight, sums


def test_the_weights_are_those_of_the_thesis() -> None:
    weight, sums = wheel(np.array([0.0, 1.0, 3.0, np.inf]), power=3.0)
    np.testing.assert_allclose(weight, [2.0**3, 1.5**3, 1.25**3, 1.0])
    np.testing.assert_allclose(sums, np.cumsum(weight))
    np.testing.assert_allclose(wheel(np.array([0.0, 7.0]), scale=7.0, power=2.0)[0], [4.0, 2.25])


def test_weights_may_come_in_parts() -> None:
    cost = np.random.default_rng(0).exponential(size=20)
    weight, sums = np.empty(20), np.empty(20)
    for first in range(0, 20, 4):
        weigh(cost, 1.0, 5.0, weight, sums, first, first + 4)
    np.testing.assert_allclose(sums, wheel(cost, power=5.0)[1])


def test_particles_are_drawn_as_often_as_they_weigh() -> None:
    cost = np.array([5.0, 0.1, 2.0, 0.0, 1.0, 9.0, 0.5])
    weight, sums = wheel(cost, power=4.0)
    marks = sums[-1] * np.random.default_rng(0).random(20_000)
    drawn = np.bincount([find_parent(sums, len(cost), mark) for mark in marks], minlength=len(cost))
    assert chisquare(drawn, len(marks) * weight / weight.sum()).pvalue > 0.01


def test_counting_starts_at_the_end() -> None:
    sums = np.cumsum([1.0, 2.0, 4.0])
    assert [find_parent(sums, 3, mark) for mark in (0.0, 3.9, 4.1, 5.9, 6.1, 7.0)] == [2, 2, 1, 1, 0, 0]
    assert find_parent(sums, 2, 1.9) == 1


def test_bisection_finds_the_particle_that_counting_finds() -> None:
    generator = np.random.default_rng(1)
    weight, sums = wheel(generator.exponential(size=500), power=20.0)
    for count in (1, 2, 37, 500):
        from_end = np.cumsum(weight[:count][::-1])
        for mark in sums[count - 1] * generator.random(300):
            assert find_parent(sums, count, mark) == count - 1 - int(np.argmax(from_end > mark))


def test_children_are_their_parents_and_noise() -> None:
    generator = np.random.default_rng(2)
    particles = scattered_particles(generator, 8, 0.1)
    _, sums = wheel(np.array([9.0, 9.0, 0.0, 9.0, 9.0]), power=200.0)  # The third outweighs all.
    noise = np.zeros((3, 7))
    noise[1, 5] = 0.02
    noise[2, :4] = [0.1, 0.0, 0.0, -0.2]
    X = np.empty((3, 3, 4))
    center = make_poses(matrix_from_quaternion(generator.normal(size=4)), generator.normal(size=3))
    breed(particles, sums, 5, np.full(3, 0.5), noise, center, X)
    turned = particles[2, :4] + noise[2, :4]
    np.testing.assert_allclose(particles[5], particles[2])
    np.testing.assert_allclose(particles[6], particles[2] + noise[1])
    np.testing.assert_allclose(particles[7], [*(turned / np.linalg.norm(turned)), *particles[2, 4:]])
    np.testing.assert_allclose(X[:, :, :3], center[:, :3] @ matrix_from_quaternion(particles[5:, :4]))
    np.testing.assert_allclose(X[:, :, 3], center[:, 3] + particles[5:, 4:])


def test_the_noise_falls_to_nothing() -> None:
    design = dataclasses.replace(DESIGN, particles=1000, noise=0.8, cooling=3.0)
    np.testing.assert_allclose(noise_schedule(np.array([0, 500, 1000]), design), [0.8, 0.1, 0.0])


def test_the_marsaglia_quaternions_are_uniform() -> None:
    q = uniform_quaternions(np.random.default_rng(3), 4000)
    np.testing.assert_allclose(np.linalg.norm(q, axis=1), 1.0)
    # Each element of a uniform point of the sphere in four dimensions has the density 2 / pi sqrt(1 - x^2).
    for element in q.T:
        assert kstest(element, lambda x: 0.5 + (x * np.sqrt(1 - x**2) + np.arcsin(x)) / np.pi).pvalue > 0.01
    np.testing.assert_allclose(q.T @ q / len(q), np.eye(4) / 4, atol=0.02)


def test_three_in_ten_first_particles_stand_straight() -> None:
    particles = scattered_particles(np.random.default_rng(4), 1000, 0.2)
    R = matrix_from_quaternion(particles[:, :4])
    straight = np.all(np.isclose(R, np.round(R)), axis=(1, 2))
    np.testing.assert_array_equal(straight, np.arange(1000) < 300)
    angles = np.degrees(rotation_angles(matrix_from_quaternion(straight_quaternions()), np.eye(3)))
    assert sorted({round(float(angle)) for angle in angles}) == [0, 90, 180]
    assert len(np.unique(particles[:300, :4], axis=0)) == len(straight_quaternions())
    assert np.abs(particles[:, 4:]).max() <= 0.2
    assert kstest(particles[:, 4:].ravel(), "uniform", (-0.2, 0.4)).pvalue > 0.01


def test_the_first_particles_of_a_correction_are_as_spread_as_the_prior() -> None:
    particles = near_particles(np.random.default_rng(5), 4000, 0.05, 0.03)
    np.testing.assert_allclose(particles[:, 4:].std(axis=0), 0.03, rtol=0.05)
    angle = rotation_angles(matrix_from_quaternion(particles[:, :4]), np.eye(3))
    assert np.sqrt(np.mean(angle**2) / 3) == pytest.approx(0.1, rel=0.05)


def test_particles_differ_by_rotation_or_translation() -> None:
    q = np.array([[1.0, 0, 0, 0], [-1.0, 0, 0, 0], [np.cos(0.1), np.sin(0.1), 0, 0], [1.0, 0, 0, 0]])
    p = np.array([[0.0, 0, 0], [0.004, 0, 0], [0, 0, 0], [0, 0.006, 0]])
    different = np.empty(4, dtype=np.bool_)
    mark_different(np.hstack([q, p]), 0.05, 0.005, different)
    np.testing.assert_array_equal(different, [True, False, True, True])


@pytest.mark.parametrize("batch", [1, 50])
def test_the_confidence_ends_the_search(blob: ObjectModel, batch: int) -> None:
    objective, prior, _ = make_touch(blob, 1)
    for confidence, count in ((0.0, 1000), (99.9, 3000)):
        search = MonteCarlo(scale=9.0, batch=batch, correction=dataclasses.replace(DESIGN, confidence=confidence))
        particles, cost = search.evolve(objective, PriorSpace(prior), np.random.default_rng(0))
        assert len(particles) == len(cost) == count
    assert search.confidence(0.0) == 100.0
    assert search.confidence(9.0) == 50.0


@pytest.mark.parametrize("batch", [1, 7, 5000])
def test_the_costs_are_those_of_the_particles(blob: ObjectModel, batch: int) -> None:
    objective, prior, _ = make_touch(blob, 2)
    search = MonteCarlo(scale=9.0, batch=batch, correction=DESIGN)
    particles, cost = search.evolve(objective, PriorSpace(prior), np.random.default_rng(0))
    X = np.empty((len(particles), 3, 4))
    place(particles, prior.mean, X)
    np.testing.assert_allclose(cost, objective.cost(X), rtol=1e-9)
    # The search closes in.
    assert np.median(cost[-300:]) < 0.2 * np.median(cost[:300])


def test_poses_that_collide_are_discarded(blob: ObjectModel) -> None:
    objective, prior, _ = make_touch(blob, 3)
    everything = MonteCarlo(scale=9.0, correction=DESIGN, polish=STAYING, same_rotation=1e-3)
    best = everything.minimize(objective, PriorSpace(prior), np.random.default_rng(0))
    assert len(best.cost) > 1
    others = dataclasses.replace(everything, is_possible=lambda X: np.arange(len(X)) > 0)
    found = others.minimize(objective, PriorSpace(prior), np.random.default_rng(0))
    np.testing.assert_array_equal(found.X_PO, best.X_PO[1:])
    none = dataclasses.replace(everything, is_possible=lambda X: np.zeros(len(X), dtype=np.bool_))
    found = none.minimize(objective, PriorSpace(prior), np.random.default_rng(0))
    np.testing.assert_array_equal(found.X_PO, best.X_PO[:1])


def test_the_best_is_kept_wherever_it_came_up(blob: ObjectModel) -> None:
    objective, prior, _ = make_touch(blob, 3)
    # Its noise hardly falls: the best comes up long before the last.
    restless = dataclasses.replace(DESIGN, cooling=0.01)
    search = MonteCarlo(scale=9.0, correction=restless, polish=STAYING)
    _, cost = search.evolve(objective, PriorSpace(prior), np.random.default_rng(0))
    assert cost.argmin() < len(cost) - 30
    found = search.minimize(objective, PriorSpace(prior), np.random.default_rng(0))
    assert found.cost[0] == pytest.approx(cost.min())
    assert len(found.cost) == 31


def test_only_the_best_is_polished(blob: ObjectModel) -> None:
    objective, prior, _ = make_touch(blob, 3)
    search = MonteCarlo(scale=9.0, correction=DESIGN, same_rotation=1e-3)
    found = search.minimize(objective, PriorSpace(prior), np.random.default_rng(0))
    rough = dataclasses.replace(search, polish=STAYING)
    unpolished = rough.minimize(objective, PriorSpace(prior), np.random.default_rng(0))
    assert found.cost[0] < unpolished.cost[0]
    np.testing.assert_array_equal(found.X_PO[1:], unpolished.X_PO[1:])
    assert len(found.cost) > 1
    np.testing.assert_array_equal(found.converged, [True] + [False] * (len(found.cost) - 1))


def test_bad_parameters_are_named() -> None:
    with pytest.raises(InvalidInputError, match=r"batch must be .*, not 0"):
        MonteCarlo(scale=1.0, batch=0)
    with pytest.raises(InvalidInputError, match=r"scale must be .*, not 0"):
        MonteCarlo(scale=0.0)
    with pytest.raises(InvalidInputError, match=r"population must be an integer from 1 to 3000, not 4000"):
        dataclasses.replace(DESIGN, population=4000)
