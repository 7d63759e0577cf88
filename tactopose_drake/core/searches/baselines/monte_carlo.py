"""The thesis' global search: an evolutionary Monte Carlo method that keeps all particles it has made.

Source: [B16] J. Bimbo, thesis, 2016, section 4.2, and 6.4 for the batches.
"""

import dataclasses
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.objectives.objective import LeastSquaresObjective
from tactopose_drake.core.searches.baselines.initial_population import near_particles, scattered_particles
from tactopose_drake.core.searches.baselines.roulette_kernels import breed, mark_different, place, weigh
from tactopose_drake.core.searches.levenberg_marquardt import LevenbergMarquardt
from tactopose_drake.core.searches.search import (
    PoseSpace,
    Search,
    SearchResult,
    StopSignal,
    is_near_prior,
    join_results,
    never,
)
from tactopose_drake.core.validation import FloatArray, positive_number, whole_number

# The confidence is tested whenever this many more particles have been made. [B16] section 4.2.6.
_CHECKED_EVERY = 1000
# Share of the particles, the last ones, that are kept besides the best one.
_KEPT_SHARE = 0.01
# Particles that share one draw of random numbers and one test of the stop signal.
_ROUND = 100


@dataclasses.dataclass(frozen=True, kw_only=True)
class MonteCarloDesign:
    """The design parameters of section 4.2, which the thesis names but does not print.

    `MonteCarlo` has one for each use. Its `particles` for the correction are those of [B16] figure 4.5; the rest is the
    best of about a hundred random designs, on touches of five contacts on bundled objects, for a likelihood. Squared
    distances spread over more decades than distances do, so here the broad design has the higher power, although the
    thesis says that it has the lower one. For a cost linear in the distance, such as eq. 4.1, 100 suits both uses.

    Attributes:
        particles: n_p, the most particles that are made.
        population: how many of these are initial ones.
        power: p_p of [B16] eq. 4.9; larger values favour the best particles more.
        noise: sigma_0 of eq. 4.12, as a share of the searched space.
        cooling: p_n of eq. 4.12.
        confidence: of eq. 4.13; the search ends when its best particle exceeds it.
    """

    particles: int
    population: int
    power: float
    noise: float
    cooling: float
    confidence: float

    def __post_init__(self) -> None:
        whole_number("population", self.population, least=1, most=self.particles)


@dataclasses.dataclass(frozen=True, kw_only=True)
class MonteCarlo(Search):
    """Copies particles in proportion to their weight, adds noise that decreases to zero, and keeps them all.

    With `batch` 1 this is the thesis' search: one particle at a time is copied, perturbed and evaluated, and may be the
    parent of the next one. Larger batches are copied and evaluated at once, which saves calls from Python to the
    objective. Both draw from the same distribution; batches of up to 100 in a correction, 500 without a guess, reach
    the same costs.

    Interpretations of the thesis: each of a particle's seven numbers gets noise of its own; the particle moves the
    object, which is the inverse of moving the contacts; opposite quaternions are the same.

    Attributes:
        scale: the unit of cost, that of a good pose: the confidence is 100 / (1 + G / scale). For the cost of [B16]
            eq. 4.1 this is eq. 4.13 with k (1 + w_n) / 100, all lengths in one unit, presumably cm in the thesis; for a
            likelihood, the expected cost of noise alone.
        batch: particles that are made at once.
        correction: the design for a space of limited rotation: aggressive.
        anywhere: the design for any other space: broad.
        same_rotation, same_translation: two poses are the same if their quaternions are closer than the former, and
            their translations closer than the latter, m.
        is_possible: maps poses (B, 3, 4) to whether they are free of collision, shape (B,), as `HandClearance` does;
            the others are discarded, unless all are.
        polish: the final refinement of the best pose. The others stay as they were found.
    """

    scale: float
    batch: int = 1
    correction: MonteCarloDesign = MonteCarloDesign(
        particles=15_000, population=750, power=100.0, noise=0.4, cooling=2.0, confidence=50.0
    )
    anywhere: MonteCarloDesign = MonteCarloDesign(
        particles=300_000, population=15_000, power=600.0, noise=0.3, cooling=2.0, confidence=50.0
    )
    same_rotation: float = 0.05
    same_translation: float = 0.005
    is_possible: Callable[[FloatArray], NDArray[np.bool_]] | None = None
    polish: LevenbergMarquardt = dataclasses.field(default_factory=LevenbergMarquardt)

    def __post_init__(self) -> None:
        whole_number("batch", self.batch, least=1)
        positive_number("scale", self.scale)

    def minimize(
        self,
        objective: LeastSquaresObjective,
        space: PoseSpace,
        generator: np.random.Generator,
        should_stop: StopSignal = never,
    ) -> SearchResult:
        """Returns the best particle and the distinct ones among the last, in ascending order of cost."""
        particles, cost = self.evolve(objective, space, generator, should_stop)
        last = np.arange(len(cost) - max(1, round(_KEPT_SHARE * len(cost))), len(cost))
        index = np.union1d(last, [cost.argmin()])
        index = index[np.argsort(cost[index], kind="stable")]
        different = np.empty(len(index), dtype=np.bool_)
        mark_different(particles[index], self.same_rotation, self.same_translation, different)
        index = index[different]
        X_PO = np.empty((len(index), 3, 4))
        place(particles[index], space.center, X_PO)
        if self.is_possible is not None:
            possible = self.is_possible(X_PO)
            possible[0] |= not possible.any()
            index, X_PO = index[possible], X_PO[possible]
        best = self.polish.refine(objective, X_PO[:1], should_stop)
        rough = np.zeros(len(index) - 1, dtype=np.int64)
        rest = SearchResult(X_PO[1:], cost[index[1:]], rough, rough > 0)
        found = join_results(best, rest).ranked()
        return found._replace(iterations=found.iterations + len(cost))

    def evolve(
        self,
        objective: LeastSquaresObjective,
        space: PoseSpace,
        generator: np.random.Generator,
        should_stop: StopSignal = never,
    ) -> tuple[FloatArray, FloatArray]:
        """All particles (n, 7) in order of creation, see `roulette_kernels`, and their costs (n,)."""
        near = is_near_prior(space)
        design = self.correction if near else self.anywhere
        particles, cost = np.empty((design.particles, 7)), np.empty(design.particles)
        weight, sums = np.empty(design.particles), np.empty(design.particles)
        if near:
            sigma = 1.0 / np.sqrt(np.diag(space.information))
            size = np.repeat([0.5 * sigma[:3].mean(), sigma[3:].mean()], [4, 3])  # Quaternions have half angles.
            particles[: design.population] = near_particles(generator, design.population, size[0], size[-1])
        else:
            size = np.repeat([1.0, space.reach[1]], [4, 3])
            particles[: design.population] = scattered_particles(generator, design.population, size[-1])

        X = np.empty((self.batch, 3, 4))
        count = 0
        while count < design.particles:
            is_initial = count < design.population
            end = min(count + max(_ROUND, self.batch), design.population if is_initial else design.particles)
            if not is_initial:
                draws = generator.random(end - count)
                sigma_j = noise_schedule(np.arange(count, end), design)
                noise = generator.normal(size=(end - count, 7)) * sigma_j[:, None] * size
            start, before = count, count // _CHECKED_EVERY
            while count < end:
                stop = min(count + self.batch, end)
                X_made = X[: stop - count]
                if is_initial:
                    place(particles[count:stop], space.center, X_made)
                else:
                    here = slice(count - start, stop - start)
                    breed(particles, sums, count, draws[here], noise[here], space.center, X_made)
                cost[count:stop] = objective.cost(X_made)
                weigh(cost, self.scale, design.power, weight, sums, count, stop)
                count = stop
            if should_stop():
                break
            if count // _CHECKED_EVERY > before and self.confidence(cost[:count].min()) > design.confidence:
                break
        return particles[:count], cost[:count]

    def confidence(self, cost: float) -> float:
        """C, between 0 and 100. [B16] eq. 4.13."""
        return 100.0 / (1.0 + cost / self.scale)


def noise_schedule(j: NDArray[np.int64], design: MonteCarloDesign) -> FloatArray:
    """Noise sigma_j of particles j. [B16] eq. 4.12."""
    sigma: FloatArray = design.noise * (1.0 - j / design.particles) ** design.cooling
    return sigma
