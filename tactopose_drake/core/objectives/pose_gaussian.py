"""A Gaussian of the pose as a part of the likelihood."""

import numpy as np

from tactopose_drake.core.compilation import read_only
from tactopose_drake.core.kernels import prior_kernels
from tactopose_drake.core.objectives.objective import LeastSquaresObjective, NormalEquations, form_normal_equations
from tactopose_drake.core.validation import FloatArray


class PoseGaussian(LeastSquaresObjective):
    """Increments from a pose, whitened by their covariance: six residuals L^T u, with the information L L^T."""

    def __init__(self, X_PO: FloatArray, covariance: FloatArray) -> None:
        """Takes the pose (3, 4) and the covariance (6, 6) of the increments from it, rad and m."""
        self._center = prior_kernels.Prior(read_only(X_PO), read_only(np.ones(6)))
        self._root = np.linalg.cholesky(np.linalg.inv(covariance)).T

    def cost(self, X_PO: FloatArray) -> FloatArray:
        """Costs (B,) of poses (B, 3, 4)."""
        cost: FloatArray = 0.5 * np.sum(self.residuals(X_PO) ** 2, axis=1)
        return cost

    def residuals(self, X_PO: FloatArray) -> FloatArray:
        """Residuals (B, 6) of poses (B, 3, 4)."""
        return self.residuals_and_jacobian(X_PO)[0]

    def residuals_and_jacobian(self, X_PO: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Residuals (B, 6) and their derivatives by the increment (B, 6, 6)."""
        increments, jacobian = np.empty((len(X_PO), 6)), np.empty((len(X_PO), 6, 6))
        prior_kernels.prior_residuals(self._center, np.ascontiguousarray(X_PO), increments, jacobian)
        return increments @ self._root.T, self._root @ jacobian

    def normal_equations(self, X_PO: FloatArray) -> NormalEquations:
        """Cost, gradient and Gauss-Newton Hessian at poses (B, 3, 4)."""
        return form_normal_equations(*self.residuals_and_jacobian(X_PO))
