"""The prior as a part of the likelihood."""

import numpy as np

from tactopose_drake.core.objectives.base import NormalEquations, form_normal_equations
from tactopose_drake.core.poses import increments_between, skew
from tactopose_drake.core.prior import PosePrior
from tactopose_drake.core.validation import FloatArray


class PriorObjective:
    """Increments from the prior's pose to the pose, divided by their standard deviations: six residuals."""

    def __init__(self, prior: PosePrior) -> None:
        self._X_PO = prior.X_PO
        self._weights = 1.0 / prior.sigmas

    def cost(self, X_PO: FloatArray) -> FloatArray:
        """Costs (B,) of poses (B, 3, 4)."""
        cost: FloatArray = 0.5 * np.sum(self.residuals(X_PO) ** 2, axis=-1)
        return cost

    def residuals(self, X_PO: FloatArray) -> FloatArray:
        """Residuals (B, 6) of poses (B, 3, 4)."""
        return increments_between(self._X_PO, X_PO) * self._weights

    def residuals_and_jacobian(self, X_PO: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Residuals (B, 6) and their derivatives by the increment (B, 6, 6)."""
        increments = increments_between(self._X_PO, X_PO)
        jacobian = np.zeros((len(X_PO), 6, 6))
        jacobian[:, :3, :3] = inverse_right_jacobian(increments[:, :3])
        jacobian[:, 3:, 3:] = np.eye(3)
        return increments * self._weights, jacobian * self._weights[:, None]

    def normal_equations(self, X_PO: FloatArray) -> NormalEquations:
        """Cost, gradient and Gauss-Newton Hessian at poses (B, 3, 4)."""
        return form_normal_equations(*self.residuals_and_jacobian(X_PO))


def inverse_right_jacobian(w: FloatArray) -> FloatArray:
    """d log(exp(w) exp(e)) / d e at e = 0, shape (B, 3, 3), for rotation vectors (B, 3).

    J. Sola et al., A micro Lie theory for state estimation, 2018, eq. 144.
    """
    angle2 = np.sum(w * w, axis=-1)
    angle = np.sqrt(angle2)
    small = angle < 1e-3
    safe = np.where(small, 1.0, angle)
    series = 1.0 / 12.0 + angle2 / 720.0
    factor = np.where(small, series, 1.0 / safe**2 - np.cos(safe / 2) / (2.0 * safe * np.sin(safe / 2)))
    W = skew(w)
    jacobian: FloatArray = np.eye(3) + 0.5 * W + factor[:, None, None] * (W @ W)
    return jacobian
