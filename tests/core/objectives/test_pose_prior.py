import numpy as np
import pytest

from tactopose_drake.core.evidence.gaussian_prior import GaussianPrior
from tactopose_drake.core.objectives.objective import SumObjective
from tactopose_drake.core.objectives.pose_prior import PriorObjective
from tactopose_drake.core.poses import increments_between, make_poses, random_rotations, retract

SIGMA_T, SIGMA_R = 0.02, 0.3


@pytest.fixture(name="prior")
def make_prior() -> GaussianPrior:
    R = random_rotations(np.random.default_rng(0), 1)[0]
    return GaussianPrior(make_poses(R, np.array([0.1, 0.2, 0.3])), sigma_translation=SIGMA_T, sigma_rotation=SIGMA_R)


def test_one_standard_deviation_costs_a_half(prior: GaussianPrior) -> None:
    X_PO = retract(prior.mean, np.diag([SIGMA_R, SIGMA_R, SIGMA_R, SIGMA_T, SIGMA_T, SIGMA_T]))
    np.testing.assert_allclose(PriorObjective(prior).cost(X_PO), 0.5)


@pytest.mark.parametrize("angle", [0.0, 1e-8, 1e-3, 1.0, 3.0])
def test_the_jacobian_is_the_central_difference(prior: GaussianPrior, angle: float) -> None:
    objective = PriorObjective(prior)
    X_PO = retract(prior.mean, np.array([[0.6 * angle, -0.8 * angle, 0.0, 0.01, 0.02, -0.03]]))
    step = 1e-6 * np.eye(6)
    difference = (objective.residuals(retract(X_PO, step)) - objective.residuals(retract(X_PO, -step))).T / 2e-6
    np.testing.assert_allclose(objective.residuals_and_jacobian(X_PO)[1][0], difference, atol=1e-5)


def test_objectives_add(prior: GaussianPrior) -> None:
    one = PriorObjective(prior)
    other = PriorObjective(GaussianPrior(np.eye(3, 4)))
    both = SumObjective([one, other])
    X_PO = retract(prior.mean, np.random.default_rng(1).normal(size=(4, 6)) * 0.1)
    np.testing.assert_allclose(both.cost(X_PO), one.cost(X_PO) + other.cost(X_PO))
    assert both.residuals(X_PO).shape == (4, 12)
    for summed, first, second in zip(
        both.normal_equations(X_PO), one.normal_equations(X_PO), other.normal_equations(X_PO), strict=True
    ):
        np.testing.assert_allclose(summed, first + second)


def test_one_newton_step_finds_the_prior(prior: GaussianPrior) -> None:
    X_PO = retract(prior.mean, np.full((1, 6), 1e-3))
    equations = PriorObjective(prior).normal_equations(X_PO)
    step = -np.linalg.solve(equations.hessian, equations.gradient[..., None])[..., 0]
    np.testing.assert_allclose(increments_between(prior.mean, retract(X_PO, step)), 0.0, atol=1e-7)
