"""Contacts against the signed distance grid: the form that is fast, smooth and a likelihood."""

import numpy as np

from tactopose_drake.core import kernels
from tactopose_drake.core.contacts import Contacts
from tactopose_drake.core.objectives.base import NormalEquations
from tactopose_drake.core.signed_distance import DistanceGrid
from tactopose_drake.core.validation import FloatArray


class SurfaceContact:
    """Distance of each contact to the surface, and the difference of its normal from the surface's.

    Residuals of contact m, with q = R_PO^T (p_PC - p_PO) the contact in the object's frame:
    phi(q) / sigma_position, and, where a normal was measured, (n(q) - R_PO^T n_PC) / sigma_normal.

    The whitened forms of [B16] eq. 3.3 (contacts without normals) and 3.5 (with normals); [B16] J. Bimbo, thesis, 2016.
    """

    def __init__(self, grid: DistanceGrid, contacts: Contacts) -> None:
        self._has_normals = contacts.n_PC is not None
        self._arguments = (
            grid.values,
            grid.origin,
            1.0 / grid.spacing,
            np.ascontiguousarray(contacts.p_PC),
            np.ascontiguousarray(np.zeros_like(contacts.p_PC) if contacts.n_PC is None else contacts.n_PC),
            np.ascontiguousarray(1.0 / contacts.sigma_position),
            np.ascontiguousarray((1.0 if self._has_normals else 0.0) / contacts.sigma_normal),
        )
        self._count = len(contacts)

    def cost(self, X_PO: FloatArray) -> FloatArray:
        """Costs (B,) of poses (B, 3, 4)."""
        cost = np.empty(len(X_PO))
        kernels.contact_costs(*self._arguments, X_PO, cost)
        return cost

    def residuals(self, X_PO: FloatArray) -> FloatArray:
        """Residuals (B, 5 k), or (B, k) without normals, of poses (B, 3, 4)."""
        return self.residuals_and_jacobian(X_PO)[0]

    def residuals_and_jacobian(self, X_PO: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Residuals (B, m) and their exact derivatives by the increment (B, m, 6)."""
        count, rows = len(X_PO), 5 if self._has_normals else 1
        residuals, jacobian = np.empty((count, self._count, 5)), np.empty((count, self._count, 5, 6))
        kernels.contact_residuals(*self._arguments, X_PO, residuals, jacobian)
        m = rows * self._count
        return residuals[:, :, :rows].reshape(count, m), jacobian[:, :, :rows].reshape(count, m, 6)

    def normal_equations(self, X_PO: FloatArray) -> NormalEquations:
        """Cost, exact gradient, and the Gauss-Newton Hessian along the smooth normals, at poses (B, 3, 4)."""
        count = len(X_PO)
        equations = NormalEquations(np.empty(count), np.empty((count, 6)), np.empty((count, 6, 6)))
        kernels.contact_normal_equations(*self._arguments, X_PO, *equations)
        return equations
