"""Base class of objectives whose residuals have kinks: their Jacobian is a forward difference."""

from abc import ABC, abstractmethod

import numpy as np

from tactopose_drake.core.objectives.objective import LeastSquaresObjective
from tactopose_drake.core.poses import retract
from tactopose_drake.core.validation import FloatArray

# An increment, rad and m: small on the scale on which residuals bend, and far above rounding errors.
_FORWARD_STEP = 1e-6


class DifferencedObjective(LeastSquaresObjective, ABC):
    """Half the sum of squared residuals, with forward differences as derivatives ([B16] eq. 2.28).

    [B16] J. Bimbo, thesis, 2016.
    """

    @abstractmethod
    def residuals(self, X_PO: FloatArray) -> FloatArray:
        """Residuals (B, m) of poses (B, 3, 4)."""

    def residuals_and_jacobian(self, X_PO: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Residuals (B, m) and their forward differences by the increment (B, m, 6). [B16] eq. 2.28."""
        here = self.residuals(X_PO)
        moved = retract(X_PO[:, None], np.eye(6) * _FORWARD_STEP)  # (B, 6, 3, 4)
        there = self.residuals(moved.reshape(-1, 3, 4)).reshape(len(X_PO), 6, -1)
        return here, np.swapaxes(there - here[:, None], 1, 2) / _FORWARD_STEP
