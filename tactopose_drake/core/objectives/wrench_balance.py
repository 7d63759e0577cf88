"""Balance of the contact forces with the object's weight.

Source: R. M. Murray, Z. Li and S. S. Sastry, A Mathematical Introduction to Robotic Manipulation, 1994, section 5.2.
"""

import numpy as np

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.evidence.force_balance import ForceBalance
from tactopose_drake.core.geometry_checks import pose_batch
from tactopose_drake.core.kernels import evidence_kernels
from tactopose_drake.core.objectives.objective import LeastSquaresObjective
from tactopose_drake.core.poses import skew
from tactopose_drake.core.validation import FloatArray

_ROUNDING = 1e-14  # relative rounding error of a variance


class WrenchBalance(LeastSquaresObjective):
    """Residual moments and forces on an object at rest: six residuals, whitened by their noise.

    The object feels -f at each contact and its weight W at its centre of mass c. About any point g,
    (c - g) x W - sum_i (p_i - g) x f_i = 0 and W - sum_i f_i = 0. With errors of the points, of the forces, and of
    additional torques, the moment has the covariance
    sum_i (sigma_position^2 [f_i]x [f_i]x' + sigma_force^2 [p_i - g]x [p_i - g]x' + sigma_torque^2), the force
    sum_i sigma_force^2. Both are the same at all poses. With g the mean of the points, weighted by sigma_force^2, the
    two are independent.

    The pose enters through c, which lies on the line of the contacts' resultant; this determines two increments. The
    three forces say nothing about the pose, but whether the mass and the contacts are consistent.
    """

    def __init__(self, contacts: Contacts, balance: ForceBalance, mass: float, center_of_mass: FloatArray) -> None:
        """Sums up the contacts, once.

        Args:
            contacts: with forces.
            balance: gravity and noise.
            mass: of the object, kg.
            center_of_mass: in O, shape (3,), m.
        """
        f_PC = contacts.f_PC
        assert f_PC is not None
        weight_P = mass * balance.gravity_P
        sigma_position, sigma_force = np.asarray(contacts.sigma_position), np.asarray(contacts.sigma_force)
        g = np.average(contacts.p_PC, axis=0, weights=sigma_force**2)
        arms = contacts.p_PC - g
        covariance = len(contacts) * balance.sigma_torque**2 * np.eye(3)
        for N in (sigma_position[:, None, None] * skew(f_PC), sigma_force[:, None, None] * skew(arms)):
            covariance += np.einsum("kij,klj->il", N, N)
        # A floor at the rounding error keeps the covariance positive definite.
        covariance += _ROUNDING * np.trace(covariance) * np.eye(3)
        whitening = np.linalg.inv(np.linalg.cholesky(covariance))
        per_force = 1.0 / np.linalg.norm(sigma_force)

        # Affine in the centre of mass: A c + offset, with c x W = -[W]x c.
        self._A = np.concatenate([-whitening @ skew(weight_P), np.zeros((3, 3))])
        moment = np.cross(g, weight_P) + np.sum(np.cross(arms, f_PC), axis=0)
        self._offset = -np.concatenate([whitening @ moment, per_force * (np.sum(f_PC, axis=0) - weight_P)])
        self._center_of_mass = np.array(center_of_mass)

    def residuals(self, X_PO: FloatArray) -> FloatArray:
        """Residuals (B, 6) of poses (B, 3, 4): moments, then forces."""
        return self.residuals_and_jacobian(X_PO)[0]

    def residuals_and_jacobian(self, X_PO: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Residuals (B, 6) and their derivatives by the increment (B, 6, 6)."""
        residuals, jacobian = np.empty((len(X_PO), 6)), np.empty((len(X_PO), 6, 6))
        evidence_kernels.balance_residuals(
            self._A, self._offset, self._center_of_mass, pose_batch(X_PO), residuals, jacobian
        )
        return residuals, jacobian
