"""Constrains each contact force to the friction cone about the object's normal."""

import math

import numpy as np

from tactopose_drake.core.compilation import read_only
from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.geometry_checks import pose_batch
from tactopose_drake.core.kernels import evidence_kernels
from tactopose_drake.core.objectives.objective import LeastSquaresObjective
from tactopose_drake.core.shape.signed_distance import DistanceGrid
from tactopose_drake.core.validation import FloatArray


class FrictionCone(LeastSquaresObjective):
    """The angle by which each force is outside of its cone: max(0, angle(f, n) - atan(friction)) / sigma.

    There is one residual per contact. n is the object's outward normal at the contact, at the pose; f is the force on
    the fingertip, which deviates from n by no more than the friction angle. sigma^2 = sigma_normal^2 + (sigma_force /
    |f|)^2 + the variance of the normal across the grid's cell: on an edge of the object, more forces are possible.

    The cost is the Chernoff bound of the probability that noise explains the angle, as in `Penetration`.
    """

    def __init__(self, grid: DistanceGrid, contacts: Contacts, friction: float) -> None:
        """Leaves out contacts whose force does not exceed the noise.

        Args:
            grid: of the object.
            contacts: with forces.
            friction: Coulomb's coefficient.
        """
        assert contacts.f_PC is not None
        size = np.linalg.norm(contacts.f_PC, axis=1)
        felt = size > contacts.sigma_force
        size, sigma_force = size[felt], np.asarray(contacts.sigma_force)[felt]
        self._arguments = (
            grid.nodes,
            evidence_kernels.Forces(
                read_only(contacts.p_PC[felt]),
                read_only(contacts.f_PC[felt] / size[:, None]),
                read_only(np.asarray(contacts.sigma_normal)[felt] ** 2 + (sigma_force / size) ** 2),
            ),
            math.atan(friction),
        )
        self._count = len(size)

    def residuals(self, X_PO: FloatArray) -> FloatArray:
        """Residuals (B, k) of poses (B, 3, 4)."""
        return self.residuals_and_jacobian(X_PO)[0]

    def residuals_and_jacobian(self, X_PO: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Residuals (B, k) and their derivatives by the increment (B, k, 6)."""
        residuals, jacobian = np.empty((len(X_PO), self._count)), np.empty((len(X_PO), self._count, 6))
        evidence_kernels.friction_residuals(*self._arguments, pose_batch(X_PO), residuals, jacobian)
        return residuals, jacobian
