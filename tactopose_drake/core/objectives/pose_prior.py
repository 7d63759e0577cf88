"""The prior as an objective."""

import numpy as np

from tactopose_drake.core.compilation import read_only
from tactopose_drake.core.evidence.gaussian_prior import GaussianPrior
from tactopose_drake.core.geometry_checks import pose_batch
from tactopose_drake.core.kernels import prior_kernels
from tactopose_drake.core.objectives.objective import LeastSquaresObjective
from tactopose_drake.core.validation import FloatArray

NO_PRIOR = prior_kernels.Prior(read_only(np.eye(3, 4)), read_only(np.zeros(6)))
"""What kernels read if there is no prior."""


class PriorObjective(LeastSquaresObjective):
    """Increments from the prior's pose to the pose, divided by their standard deviations: six residuals."""

    def __init__(self, prior: GaussianPrior) -> None:
        self.kernel_view = prior_kernels.Prior(read_only(prior.mean), read_only(1.0 / prior.sigmas))

    def cost(self, X_PO: FloatArray) -> FloatArray:
        """Costs (B,) of poses (B, 3, 4)."""
        cost = np.empty(len(X_PO))
        prior_kernels.prior_costs(self.kernel_view, pose_batch(X_PO), cost)
        return cost

    def residuals(self, X_PO: FloatArray) -> FloatArray:
        """Residuals (B, 6) of poses (B, 3, 4)."""
        return self.residuals_and_jacobian(X_PO)[0]

    def residuals_and_jacobian(self, X_PO: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Residuals (B, 6) and their derivatives by the increment (B, 6, 6)."""
        residuals, jacobian = np.empty((len(X_PO), 6)), np.empty((len(X_PO), 6, 6))
        prior_kernels.prior_residuals(self.kernel_view, pose_batch(X_PO), residuals, jacobian)
        return residuals, jacobian
