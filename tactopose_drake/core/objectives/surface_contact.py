"""Contacts against the signed distance grid: the form that is fast, smooth and a likelihood."""

from typing import Any

import numpy as np

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.kernels import surface_contact_kernels, touch_kernels
from tactopose_drake.core.objectives.objective import (
    DescendingObjective,
    Descent,
    DescentRule,
    NormalEquations,
    SumObjective,
)
from tactopose_drake.core.objectives.pose_prior import PriorObjective
from tactopose_drake.core.shape.signed_distance import DistanceGrid
from tactopose_drake.core.validation import FloatArray

# The kernels' arguments for it.
_NO_PRIOR = (np.eye(3, 4), np.zeros(6))


class SurfaceContact(DescendingObjective):
    """Distance of each contact to the surface, and the difference of its normal from the surface's.

    Residuals of contact m, with q = R_PO^T (p_PC - p_PO) the contact in the object's frame:
    phi(q) / sigma_position, and, where a normal was measured, (n(q) - R_PO^T n_PC) / sigma_normal.

    The whitened forms of [B16] eq. 3.3 (contacts without normals) and 3.5 (with normals); [B16] J. Bimbo, thesis, 2016.
    """

    def __init__(self, grid: DistanceGrid, contacts: Contacts) -> None:
        self._has_normals = contacts.n_PC is not None
        self.arguments = (
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
        surface_contact_kernels.contact_costs(*self.arguments, X_PO, cost)
        return cost

    def residuals(self, X_PO: FloatArray) -> FloatArray:
        """Residuals (B, 5 k), or (B, k) without normals, of poses (B, 3, 4)."""
        return self.residuals_and_jacobian(X_PO)[0]

    def residuals_and_jacobian(self, X_PO: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Residuals (B, m) and their exact derivatives by the increment (B, m, 6)."""
        count, rows = len(X_PO), 5 if self._has_normals else 1
        residuals, jacobian = np.empty((count, self._count, 5)), np.empty((count, self._count, 5, 6))
        surface_contact_kernels.contact_residuals(*self.arguments, X_PO, residuals, jacobian)
        m = rows * self._count
        return residuals[:, :, :rows].reshape(count, m), jacobian[:, :, :rows].reshape(count, m, 6)

    def normal_equations(self, X_PO: FloatArray) -> NormalEquations:
        """Cost, exact gradient, and the Gauss-Newton Hessian along the smooth normals, at poses (B, 3, 4)."""
        return _normal_equations((*self.arguments, *_NO_PRIOR), X_PO)

    def descend(self, rule: DescentRule, X_PO: FloatArray) -> Descent:
        """All of Levenberg-Marquardt's steps at once; see `DescendingObjective`."""
        return _descend((*self.arguments, *_NO_PRIOR), rule, X_PO)


class ContactWithPrior(SumObjective, DescendingObjective):
    """Contacts and a prior, added up as `SumObjective` does it, but in one compiled loop."""

    def __init__(self, touch: SurfaceContact, prior: PriorObjective) -> None:
        super().__init__([touch, prior])
        self._arguments = (*touch.arguments, *prior.arguments)

    def normal_equations(self, X_PO: FloatArray) -> NormalEquations:
        """Cost, exact gradient, and the Gauss-Newton Hessian, at poses (B, 3, 4)."""
        return _normal_equations(self._arguments, X_PO)

    def descend(self, rule: DescentRule, X_PO: FloatArray) -> Descent:
        """All of Levenberg-Marquardt's steps at once; see `DescendingObjective`."""
        return _descend(self._arguments, rule, X_PO)


def _normal_equations(arguments: tuple[Any, ...], X_PO: FloatArray) -> NormalEquations:
    cost, gradient, hessian, _, _ = _run(arguments, DescentRule(0, 0.0, 0.0, 0.0), X_PO.copy())
    return NormalEquations(cost, gradient, hessian)


def _descend(arguments: tuple[Any, ...], rule: DescentRule, X_PO: FloatArray) -> Descent:
    X_PO = X_PO.copy()
    cost, _, _, iterations, converged = _run(arguments, rule, X_PO)
    return Descent(X_PO, cost, iterations, converged)


def _run(arguments: tuple[Any, ...], rule: DescentRule, X_PO: FloatArray) -> tuple[Any, ...]:
    """The kernel's results; moves the poses."""
    count = len(X_PO)
    results = (
        np.empty(count),
        np.empty((count, 6)),
        np.empty((count, 6, 6)),
        np.empty(count, dtype=np.int64),
        np.empty(count, dtype=np.bool_),
    )
    everything: tuple[Any, ...] = (*arguments, *rule, X_PO, *results)
    touch_kernels.descend(*everything)
    return results
