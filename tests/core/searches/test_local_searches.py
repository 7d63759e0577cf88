import numpy as np
import pytest

from tactopose_drake.core.compilation import read_only
from tactopose_drake.core.evidence.gaussian_prior import GaussianPrior
from tactopose_drake.core.evidence.hand_geometry import HandGeometry
from tactopose_drake.core.kernels import prior_kernels
from tactopose_drake.core.objectives.objective import LeastSquaresObjective, SumObjective
from tactopose_drake.core.objectives.penetration import Penetration
from tactopose_drake.core.objectives.pose_prior import PriorObjective
from tactopose_drake.core.objectives.surface_contact import ContactSum, SurfaceContact
from tactopose_drake.core.poses import increments_between, make_poses, random_rotations, retract, rotation_angles
from tactopose_drake.core.searches.baselines.gradient_descent import GradientDescent
from tactopose_drake.core.searches.levenberg_marquardt import LevenbergMarquardt, cholesky_steps, pseudo_inverse_steps
from tactopose_drake.core.searches.parameters import QuaternionParameters
from tactopose_drake.core.searches.search import PriorSpace, Search
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import FloatArray
from tactopose_drake.estimation.mathematical_program import PoseProgram
from tests.core.searches.problems import make_touch

SEARCHES: dict[str, Search] = {
    "lm": LevenbergMarquardt(tolerance=1e-12),
    "lm, pseudo-inverse": LevenbergMarquardt(tolerance=1e-12, solver=pseudo_inverse_steps),
    # Where a kink of the distance grid crosses a valley, the last bits decide on the number of steps: 50 to 500.
    "lm, quaternion": LevenbergMarquardt(
        max_iterations=2000, tolerance=1e-12, parameters=QuaternionParameters(), solver=pseudo_inverse_steps
    ),
    "nlopt_slsqp": PoseProgram(solver="nlopt_slsqp"),
    "nlopt_ccsaq": PoseProgram(solver="nlopt_ccsaq"),
    "snopt": PoseProgram(solver="snopt"),
    "ipopt": PoseProgram(solver="ipopt"),
}


class PoseGaussian(LeastSquaresObjective):
    """Increments from a pose, whitened by their covariance: six residuals L^T u, with the information L L^T."""

    def __init__(self, X_PO: FloatArray, covariance: FloatArray) -> None:
        """Takes the pose (3, 4) and the covariance (6, 6) of the increments from it, rad and m."""
        self._center = prior_kernels.Prior(read_only(X_PO), read_only(np.ones(6)))
        self._root = np.linalg.cholesky(np.linalg.inv(covariance)).T

    def residuals(self, X_PO: FloatArray) -> FloatArray:
        return self.residuals_and_jacobian(X_PO)[0]

    def residuals_and_jacobian(self, X_PO: FloatArray) -> tuple[FloatArray, FloatArray]:
        increments, jacobian = np.empty((len(X_PO), 6)), np.empty((len(X_PO), 6, 6))
        prior_kernels.prior_residuals(self._center, np.ascontiguousarray(X_PO), increments, jacobian)
        return increments @ self._root.T, self._root @ jacobian


DESCENTS = {
    "increments": GradientDescent(max_iterations=20_000, tolerance=1e-14),
    "quaternion": GradientDescent(max_iterations=20_000, tolerance=1e-14, parameters=QuaternionParameters()),
}


@pytest.mark.parametrize("name", DESCENTS)
@pytest.mark.parametrize("seed", [1, 2])
def test_gradient_descent_reaches_the_minimum_of_a_smooth_cost(name: str, seed: int) -> None:
    generator = np.random.default_rng(seed)
    X_mean = make_poses(random_rotations(generator, 1), generator.normal(scale=0.05, size=(1, 3)))[0]
    root = generator.normal(size=(6, 6)) * np.repeat([0.05, 0.002], 3)[:, None]
    objective = PoseGaussian(X_mean, root @ root.T + np.diag(np.repeat([0.05, 0.002], 3) ** 2))
    start = PriorSpace(GaussianPrior(retract(X_mean, np.array([0.2, -0.1, 0.1, 0.01, -0.02, 0.01]))))
    found = DESCENTS[name].minimize(objective, start, generator)
    assert found.cost[0] < 1e-3
    assert found.converged[0]


@pytest.mark.parametrize("name", DESCENTS)
def test_gradient_descent_ends_where_no_step_of_its_own_is_better(blob: ObjectModel, name: str) -> None:
    """A distance grid has kinks, at which the gradient is no way down: there it ends, above the minimum."""
    objective, prior, _ = make_touch(blob, 2)
    found = DESCENTS[name].minimize(objective, PriorSpace(prior), np.random.default_rng(0))
    assert found.cost[0] < objective.cost(prior.mean[None])[0]
    again = DESCENTS[name].refine(objective, found.X_PO)
    assert again.cost[0] == pytest.approx(found.cost[0], rel=0.01)


@pytest.mark.parametrize("name", SEARCHES)
@pytest.mark.parametrize("seed", [1, 2])
def test_all_searches_reach_the_same_minimum(blob: ObjectModel, name: str, seed: int) -> None:
    objective, prior, X_true = make_touch(blob, seed)
    reference = LevenbergMarquardt(tolerance=1e-14, max_iterations=1000).refine(objective, X_true[None])
    found = SEARCHES[name].minimize(objective, PriorSpace(prior), np.random.default_rng(0))
    assert found.cost[0] == pytest.approx(reference.cost[0], abs=0.05)
    # Well within a standard deviation.
    hessian = objective.normal_equations(reference.X_PO).hessian[0]
    increment = increments_between(found.X_PO[0], reference.X_PO[0])
    assert np.sqrt(increment @ hessian @ increment) < 0.3
    assert found.converged[0]


def test_the_minimum_is_near_the_truth(blob: ObjectModel) -> None:
    objective, prior, X_true = make_touch(blob, 3, offset_translation=0.033, offset_rotation=np.radians(16))
    X_start = PriorSpace(prior).sample(np.random.default_rng(0), 60)
    best = LevenbergMarquardt().refine(objective, X_start).X_PO[0]
    assert np.linalg.norm(best[:, 3] - X_true[:, 3]) < 0.005
    assert rotation_angles(best[:, :3], X_true[:, :3]) < np.radians(6)


def test_poses_come_ranked_and_agree_with_their_costs(blob: ObjectModel) -> None:
    objective, prior, _ = make_touch(blob, 4)
    found = LevenbergMarquardt().refine(objective, PriorSpace(prior).sample(np.random.default_rng(0), 10))
    assert len(found.cost) == 10
    assert np.all(np.diff(found.cost) >= 0)
    np.testing.assert_allclose(objective.cost(found.X_PO), found.cost, rtol=1e-6)


def test_a_batch_is_refined_as_its_poses_one_by_one(blob: ObjectModel) -> None:
    objective, prior, _ = make_touch(blob, 6)
    X_start = PriorSpace(prior).sample(np.random.default_rng(1), 5)
    search = LevenbergMarquardt(max_iterations=8)
    together = search.refine(objective, X_start)
    alone = [search.refine(objective, X[None]) for X in X_start]
    np.testing.assert_allclose(together.cost, sorted(float(one.cost[0]) for one in alone), rtol=1e-12)
    assert sorted(together.iterations) == sorted(int(one.iterations[0]) for one in alone)


@pytest.mark.parametrize(("has_prior", "has_hand"), [(True, False), (False, False), (True, True), (False, True)])
def test_the_compiled_descent_steps_as_the_rounds_do(blob: ObjectModel, has_prior: bool, has_hand: bool) -> None:
    summed, prior, X_true = make_touch(blob, 8)
    touch, known = summed.terms
    assert isinstance(touch, SurfaceContact)
    assert isinstance(known, PriorObjective)
    generator = np.random.default_rng(5)
    inside = HandGeometry(X_true[:, 3] + 0.03 * generator.normal(size=(12, 3)), np.full(12, 0.01), sigma=0.02)
    hand = Penetration(blob.grid, inside)
    assert np.count_nonzero(hand.residuals(X_true[None])) > 1
    parts = [known] if has_prior else []
    plain = SumObjective([touch, *([hand] if has_hand else []), *parts])
    compiled = ContactSum(touch, known if has_prior else None, hand if has_hand else None)
    X_start = PriorSpace(prior).sample(np.random.default_rng(2), 30)
    np.testing.assert_allclose(compiled.cost(X_start), plain.cost(X_start), rtol=1e-12)
    for got, expected in zip(compiled.normal_equations(X_start), plain.normal_equations(X_start), strict=True):
        np.testing.assert_allclose(got, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())
    here, there = (LevenbergMarquardt(max_iterations=2).refine(objective, X_start) for objective in (compiled, plain))
    np.testing.assert_allclose(here.cost, there.cost, rtol=1e-6)
    np.testing.assert_array_equal(here.iterations, there.iterations)
    # The cost has kinks, where a rounding error in the last bit can decide about a step: over many steps, all but few.
    here, there = (
        LevenbergMarquardt(max_iterations=12, tolerance=1e-2).refine(objective, X_start)
        for objective in (compiled, plain)
    )
    alike = np.isclose(here.cost, there.cost, rtol=1e-5) & (here.converged == there.converged)
    assert np.count_nonzero(alike) >= 27


@pytest.mark.parametrize("is_compiled", [True, False])
def test_after_a_refused_step_the_damping_counts_and_the_same_minima_take_fewer_steps(
    blob: ObjectModel, is_compiled: bool
) -> None:
    summed, prior, X_true = make_touch(blob, 4)
    touch = next(term for term in summed.terms if isinstance(term, SurfaceContact))
    objective = ContactSum(touch, PriorObjective(prior)) if is_compiled else summed
    assert (objective.descent is not None) == is_compiled
    X_start = retract(X_true, 0.5 * np.random.default_rng(4).normal(size=(40, 6)) * prior.sigmas)
    thesis, quicker = (LevenbergMarquardt(least_refused=least).refine(objective, X_start) for least in (0.0, 0.1))
    assert quicker.iterations.sum() < thesis.iterations.sum()
    np.testing.assert_allclose(quicker.cost[0], thesis.cost[0], atol=1e-3)


def test_a_compiled_descent_stops_when_told_to(blob: ObjectModel) -> None:
    touch = make_touch(blob, 9)[0].terms[0]
    X_start = PriorSpace(make_touch(blob, 9)[1]).sample(np.random.default_rng(3), 600)
    found = LevenbergMarquardt(max_iterations=15).refine(touch, X_start, lambda: True)
    assert len(found.cost) == 600
    assert 0 < np.count_nonzero(found.iterations) < 150
    np.testing.assert_allclose(found.cost, touch.cost(found.X_PO), rtol=1e-9)


def test_the_limit_of_iterations_is_kept_and_said(blob: ObjectModel) -> None:
    objective, prior, _ = make_touch(blob, 1, offset_translation=0.03)
    for search in (LevenbergMarquardt(max_iterations=2), GradientDescent(max_iterations=2)):
        found = search.minimize(objective, PriorSpace(prior), np.random.default_rng(0))
        assert found.iterations[0] == 2
        assert not found.converged[0]


class _Singular(LeastSquaresObjective):
    """A cost that only the first increment changes: everything else is undetermined."""

    def residuals(self, X_PO: FloatArray) -> FloatArray:
        return self.residuals_and_jacobian(X_PO)[0]

    def residuals_and_jacobian(self, X_PO: FloatArray) -> tuple[FloatArray, FloatArray]:
        return X_PO[:, :1, 3] - 0.5, np.tile(np.eye(6)[None, 3:4], (len(X_PO), 1, 1))


@pytest.mark.parametrize("solver", [cholesky_steps, pseudo_inverse_steps])
def test_undetermined_directions_stay_where_they_were(solver: object) -> None:
    objective: LeastSquaresObjective = _Singular()
    X_start = np.eye(3, 4)[None] + np.array([[[0, 0, 0, 0.1], [0, 0, 0, 0.2], [0, 0, 0, 0.3]]])
    found = LevenbergMarquardt(solver=solver, tolerance=1e-14).refine(objective, X_start)  # type: ignore[arg-type]
    np.testing.assert_allclose(found.X_PO[0], np.array([[1, 0, 0, 0.5], [0, 1, 0, 0.2], [0, 0, 1, 0.3]]), atol=1e-6)


def test_both_solvers_take_the_same_steps() -> None:
    generator = np.random.default_rng(0)
    root = generator.normal(size=(4, 6, 6))
    hessian, gradient, damping = root @ np.swapaxes(root, 1, 2), generator.normal(size=(4, 6)), np.full(4, 0.1)
    np.testing.assert_allclose(
        cholesky_steps(hessian, gradient, damping), pseudo_inverse_steps(hessian, gradient, damping), rtol=1e-8
    )
