"""Laws that every least-squares objective keeps."""

import numpy as np

from tactopose_drake.core.objectives.objective import LeastSquaresObjective
from tactopose_drake.core.poses import retract

_STEP = 1e-9


def check_derivatives(objective: LeastSquaresObjective, X_PO: np.ndarray) -> None:
    """The Jacobian is the central difference, and everything else follows from residuals and Jacobian."""
    residuals, jacobian = objective.residuals_and_jacobian(X_PO)
    for k in range(6):
        step = _STEP * np.eye(6)[k]
        difference = objective.residuals(retract(X_PO, step)) - objective.residuals(retract(X_PO, -step))
        np.testing.assert_allclose(jacobian[:, :, k], difference / (2.0 * _STEP), rtol=1e-3, atol=2e-2)

    np.testing.assert_array_equal(objective.residuals(X_PO), residuals)
    half_squares = 0.5 * np.sum(residuals**2, axis=1)
    equations = objective.normal_equations(X_PO)
    np.testing.assert_allclose(objective.cost(X_PO), half_squares, rtol=1e-9)
    np.testing.assert_allclose(equations.cost, half_squares, rtol=1e-9)
    gradient = np.einsum("bmi,bm->bi", jacobian, residuals)
    np.testing.assert_allclose(equations.gradient, gradient, rtol=1e-9, atol=1e-9 * np.abs(gradient).max())
    hessian = np.einsum("bmi,bmj->bij", jacobian, jacobian)
    np.testing.assert_allclose(equations.hessian, hessian, rtol=1e-9, atol=1e-9 * np.abs(hessian).max())
