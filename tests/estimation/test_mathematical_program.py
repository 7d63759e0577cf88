import numpy as np
import pytest

from tactopose_drake.core.searches.search import PriorSpace
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.errors import InvalidInputError, UnknownNameError
from tactopose_drake.estimation.mathematical_program import PoseProgram, cost_and_gradient
from tests.core.searches.problems import make_touch


@pytest.mark.parametrize("angle", [0.0, 1e-8, 0.2, 1.0])
def test_the_gradient_is_exact_for_large_increments_too(blob: ObjectModel, angle: float) -> None:
    objective, prior, _ = make_touch(blob, 1)
    increment = np.array([0.6 * angle, -0.8 * angle, 0.0, 0.003, -0.002, 0.001])
    _, gradient = cost_and_gradient(objective, prior.mean, increment)
    step = 1e-8 * np.eye(6)
    difference = [
        (
            cost_and_gradient(objective, prior.mean, increment + h)[0]
            - cost_and_gradient(objective, prior.mean, increment - h)[0]
        )
        / 2e-8
        for h in step
    ]
    np.testing.assert_allclose(gradient, difference, rtol=1e-3, atol=1e-3 * np.abs(gradient).max())


def test_bad_parameters_are_named() -> None:
    with pytest.raises(UnknownNameError, match=r"solver must be one of nlopt_slsqp, nlopt_ccsaq.*, not 'gurobi'"):
        PoseProgram(solver="gurobi")
    with pytest.raises(InvalidInputError, match=r"length must be .*, not 0"):
        PoseProgram(length=0.0)


@pytest.mark.parametrize("solver", ["nlopt_slsqp", "nlopt_ccsaq", "snopt", "ipopt"])
def test_a_stopped_solver_returns_the_best_that_it_saw(blob: ObjectModel, solver: str) -> None:
    objective, prior, _ = make_touch(blob, 1, offset_translation=0.02)
    asked = 0

    def should_stop() -> bool:
        nonlocal asked
        asked += 1
        return asked > 15

    found = PoseProgram(solver=solver).minimize(objective, PriorSpace(prior), np.random.default_rng(0), should_stop)
    assert found.iterations[0] == 16
    assert not found.converged[0]
    assert objective.cost(found.X_PO)[0] == found.cost[0] < objective.cost(prior.mean[None])[0]
