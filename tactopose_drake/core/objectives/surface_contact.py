"""Contacts against the signed distance grid: a smooth likelihood that is fast to evaluate."""

import numpy as np

from tactopose_drake.core.compilation import read_only
from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.geometry_checks import pose_batch
from tactopose_drake.core.kernels import surface_contact_kernels
from tactopose_drake.core.kernels.hand_sphere_kernels import NO_SPHERES
from tactopose_drake.core.kernels.surface_contact_kernels import WeightedContacts
from tactopose_drake.core.objectives.compiled_descent import CompiledDescent, CompiledObjective
from tactopose_drake.core.objectives.objective import LeastSquaresObjective, SumObjective
from tactopose_drake.core.objectives.penetration import Penetration
from tactopose_drake.core.objectives.pose_prior import NO_PRIOR, PriorObjective
from tactopose_drake.core.poses import axes_across
from tactopose_drake.core.shape.signed_distance import DistanceGrid
from tactopose_drake.core.validation import FloatArray


class SurfaceContact(CompiledObjective, LeastSquaresObjective):
    """Distance of each contact to the surface, and the difference of its normal from the surface's.

    Residuals of contact m, with q = R_PO^T (p_PC - p_PO) the contact in the object's frame:
    phi(q) / sigma_position, and, where a normal was measured, (n(q) - R_PO^T n_PC) / sigma_normal.

    The whitened forms of [B16] eq. 3.3 (contacts without normals) and 3.5 (with normals); [B16] J. Bimbo, thesis, 2016.
    """

    is_touch = True

    def __init__(self, grid: DistanceGrid, contacts: Contacts) -> None:
        self._has_normals = contacts.n_PC is not None
        self.grid = grid.nodes
        self.touch = WeightedContacts(
            read_only(contacts.p_PC),
            read_only(contacts.normals_or_zeros),
            read_only(1.0 / contacts.sigma_position),
            read_only((1.0 if self._has_normals else 0.0) / contacts.sigma_normal),
        )
        self._compiled, self._count = CompiledDescent(self.grid, self.touch), len(contacts)

    def cost(self, X_PO: FloatArray) -> FloatArray:
        """Costs (B,) of poses (B, 3, 4)."""
        return self._compiled.cost_as_told(X_PO)

    def residuals(self, X_PO: FloatArray) -> FloatArray:
        """Residuals (B, 5 k), or (B, k) without normals, of poses (B, 3, 4)."""
        return self.residuals_and_jacobian(X_PO)[0]

    def residuals_and_jacobian(self, X_PO: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Residuals (B, m) and their exact derivatives by the increment (B, m, 6)."""
        residuals, jacobian = self.rows_of_contacts(X_PO)
        count, rows = len(X_PO), 5 if self._has_normals else 1
        m = rows * self._count
        return residuals[:, :, :rows].reshape(count, m), jacobian[:, :, :rows].reshape(count, m, 6)

    def rows_of_contacts(self, X_PO: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Residuals (B, k, 5) of each contact and their derivatives (B, k, 5, 6); zeros for missing normals."""
        count = len(X_PO)
        residuals, jacobian = np.empty((count, self._count, 5)), np.empty((count, self._count, 5, 6))
        surface_contact_kernels.contact_residuals(self.grid, self.touch, pose_batch(X_PO), residuals, jacobian)
        return residuals, jacobian


class ContactSum(CompiledObjective, SumObjective):
    """Contacts with a prior, the hand's volume, or both, added up as `SumObjective` does it, in one compiled loop."""

    def __init__(
        self,
        touch: SurfaceContact,
        prior: PriorObjective | None = None,
        hand: Penetration | None = None,
        quick: LeastSquaresObjective | None = None,
    ) -> None:
        super().__init__([touch, *(term for term in (hand, prior) if term is not None)], quick)
        known, spheres = NO_PRIOR if prior is None else prior.kernel_view, NO_SPHERES if hand is None else hand.spheres
        self._compiled, self._hand = CompiledDescent(touch.grid, touch.touch, known, hand=spheres), hand

    def cost(self, X_PO: FloatArray) -> FloatArray:
        """Costs (B,) of poses (B, 3, 4)."""
        cost = self._compiled.cost_as_told(X_PO)
        return cost if self._hand is None else cost + self._hand.cost(X_PO)


class ContactsButOne(CompiledObjective):
    """Contacts without the one that each pose explains worst, which may be an outlier, and an optional prior.

    In a descent that contact is fixed at the start. This is least trimmed squares: P. Rousseeuw, Least median of
    squares regression, J. Am. Stat. Assoc. 79, 1984.
    """

    def __init__(self, touch: SurfaceContact, prior: PriorObjective | None = None) -> None:
        known = NO_PRIOR if prior is None else prior.kernel_view
        self._compiled = CompiledDescent(touch.grid, touch.touch, known, trimmed=True)

    def cost(self, X_PO: FloatArray) -> FloatArray:
        """Costs (B,) of poses (B, 3, 4)."""
        return self.normal_equations(X_PO).cost


def along_normals(n_O: FloatArray, residuals: FloatArray, jacobian: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The distance, and the two components of the difference of normals across the normal: (k, 3) and (k, 3, 6).

    Args:
        n_O: measured normals in the object's frame, shape (k, 3).
        residuals: distances and differences of normals, shape (k, 4).
        jacobian: their derivatives, shape (k, 4, 6).
    """
    rows = np.zeros((len(n_O), 3, 4))
    rows[:, 0, 0], rows[:, 1:, 1:] = 1.0, np.stack(axes_across(n_O), axis=1)
    return np.einsum("kab,kb->ka", rows, residuals), rows @ jacobian
