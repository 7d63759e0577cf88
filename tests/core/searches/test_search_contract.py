"""What every search promises, whichever objective it minimises."""

import dataclasses
import functools
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pytest

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.evidence.gaussian_prior import GaussianPrior
from tactopose_drake.core.objectives.objective import LeastSquaresObjective, NormalEquations
from tactopose_drake.core.objectives.pose_prior import PriorObjective
from tactopose_drake.core.poses import increments_between, retract
from tactopose_drake.core.searches.baselines.gradient_descent import GradientDescent
from tactopose_drake.core.searches.baselines.monte_carlo import MonteCarlo
from tactopose_drake.core.searches.baselines.scaling_series import ScalingSeries
from tactopose_drake.core.searches.baselines.simulated_annealing import SimulatedAnnealing
from tactopose_drake.core.searches.evolution_strategy import EvolutionStrategy
from tactopose_drake.core.searches.levenberg_marquardt import LevenbergMarquardt
from tactopose_drake.core.searches.pair_search import PairSearch
from tactopose_drake.core.searches.search import PriorSpace, Search, SearchResult, StopSignal, never
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import FloatArray
from tactopose_drake.estimation.mathematical_program import Direct, PoseProgram
from tests.core.meshes import smooth_shape
from tests.core.searches.problems import make_touch

NO_TOUCH = Contacts(np.zeros((1, 3)))

SEARCHES: dict[str, Callable[[ObjectModel], Search]] = {
    "pair search": lambda model: PairSearch(model=model, contacts=NO_TOUCH),
    "levenberg_marquardt": lambda model: LevenbergMarquardt(),
    "gradient_descent": lambda model: GradientDescent(),
    "nlopt_slsqp": lambda model: PoseProgram(solver="nlopt_slsqp"),
    "nlopt_ccsaq": lambda model: PoseProgram(solver="nlopt_ccsaq"),
    "snopt": lambda model: PoseProgram(solver="snopt"),
    "ipopt": lambda model: PoseProgram(solver="ipopt"),
    "monte_carlo": lambda model: MonteCarlo(scale=9.0),
    "monte_carlo in batches": lambda model: MonteCarlo(scale=9.0, batch=50),
    "direct": lambda model: Direct(max_evaluations=5000),
    "simulated_annealing": lambda model: SimulatedAnnealing(max_evaluations=5000),
    "scaling_series": lambda model: ScalingSeries(max_regions=100),
    "evolution_strategy": lambda model: EvolutionStrategy(),
}


@dataclasses.dataclass
class Counted(LeastSquaresObjective):
    """An objective that counts the poses it is asked about."""

    inner: LeastSquaresObjective
    poses: int = 0

    def cost(self, X_PO: FloatArray) -> FloatArray:
        self.poses += len(X_PO)
        return self.inner.cost(X_PO)

    def residuals(self, X_PO: FloatArray) -> FloatArray:
        self.poses += len(X_PO)
        return self.inner.residuals(X_PO)

    def residuals_and_jacobian(self, X_PO: FloatArray) -> tuple[FloatArray, FloatArray]:
        self.poses += len(X_PO)
        return self.inner.residuals_and_jacobian(X_PO)

    def normal_equations(self, X_PO: FloatArray) -> NormalEquations:
        self.poses += len(X_PO)
        return self.inner.normal_equations(X_PO)


class Outcome(NamedTuple):
    found: SearchResult
    poses: int
    objective: LeastSquaresObjective
    X_true: FloatArray


@functools.cache
def blob() -> ObjectModel:
    return ObjectModel.from_mesh(smooth_shape(), symmetry="none")


def search(name: str, should_stop: StopSignal = never) -> Outcome:
    """From a prior that is 10 mm and 0.1 rad off."""
    objective, prior, X_true = make_touch(blob(), 2)
    counted = Counted(objective)
    found = SEARCHES[name](blob()).minimize(counted, PriorSpace(prior), np.random.default_rng(0), should_stop)
    return Outcome(found, counted.poses, objective, X_true)


# Several tests look at the same outcome.
finished = functools.cache(search)


@pytest.mark.parametrize("name", SEARCHES)
class TestSearch:
    def test_poses_come_by_rising_cost(self, name: str) -> None:
        found, _, objective, _ = finished(name)
        count = len(found.cost)
        assert count >= 1
        assert found.X_PO.shape == (count, 3, 4)
        assert found.iterations.shape == found.converged.shape == (count,)
        np.testing.assert_allclose(objective.cost(found.X_PO), found.cost, rtol=1e-6)
        assert np.all(np.diff(found.cost) >= 0)
        R = found.X_PO[:, :, :3]
        np.testing.assert_allclose(R @ np.swapaxes(R, 1, 2), np.tile(np.eye(3), (count, 1, 1)), atol=1e-9)
        np.testing.assert_allclose(np.linalg.det(R), 1.0)

    def test_a_near_minimum_is_found(self, name: str) -> None:
        found, _, objective, X_true = finished(name)
        reference = LevenbergMarquardt(tolerance=1e-12).refine(objective, X_true[None])
        assert found.cost[0] <= reference.cost[0] + 0.05
        assert found.converged[0]

    def test_the_same_seed_gives_the_same_poses(self, name: str) -> None:
        first, again = finished(name).found, search(name).found
        np.testing.assert_array_equal(first.X_PO, again.X_PO)
        np.testing.assert_array_equal(first.cost, again.cost)

    def test_it_stops_when_told(self, name: str) -> None:
        found, poses, objective, _ = search(name, should_stop=lambda: True)
        assert len(found.cost) >= 1
        assert np.all(np.isfinite(found.X_PO))
        np.testing.assert_allclose(objective.cost(found.X_PO), found.cost, rtol=1e-6)
        assert poses < max(5, 0.75 * finished(name).poses)

    def test_any_objective_will_do(self, name: str) -> None:
        # One that knows of no contact: a wish for a pose near the space's centre.
        center = retract(np.eye(3, 4), np.array([2.0, -1.0, 0.5, 0.1, 0.2, -0.1]))
        wished = retract(center, np.array([0.1, -0.05, 0.1, 0.01, 0.02, -0.01]))
        objective = PriorObjective(GaussianPrior(wished, sigma_translation=0.001, sigma_rotation=0.05))
        found = SEARCHES[name](blob()).minimize(objective, PriorSpace(GaussianPrior(center)), np.random.default_rng(0))
        np.testing.assert_allclose(increments_between(found.X_PO[0], wished), 0.0, atol=1e-3)
