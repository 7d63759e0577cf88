"""Residuals of contacts on an object's surface, with derivatives by the object's pose and by the contacts themselves.

The residuals of a contact are its distance from the surface and the difference of its normal from the surface's, each
over its standard deviation. Unlike `objectives.surface_contact`, which is optimised for one touch and thousands of
starts, these have derivatives by parameters that move the contact in the hand. The rotation of the surface's normal is
taken over the width of a cell, so that the facets of a mesh do not matter.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.poses import skew
from tactopose_drake.core.shape.signed_distance import DistanceGrid
from tactopose_drake.core.validation import FloatArray


class GraspContacts(NamedTuple):
    """Contacts of all grasps, in the palm frame, for one value of the shared unknowns.

    Attributes:
        grasp: index of the grasp of each, shape (n,).
        p_PC: points, shape (n, 3), m.
        n_PC: outward unit normals of the object, shape (n, 3).
        J: derivatives of the point and of a small rotation of the normal by the shared unknowns, shape (n, 6, d).
        valid: whether there is a contact at all, shape (n,).
    """

    grasp: NDArray[np.int64]
    p_PC: FloatArray
    n_PC: FloatArray
    J: FloatArray
    valid: NDArray[np.bool_]

    def chosen(self, rows: NDArray[np.integer]) -> "GraspContacts":
        """Selects contacts by their indices, possibly repeated."""
        return GraspContacts(self.grasp[rows], self.p_PC[rows], self.n_PC[rows], self.J[rows], self.valid[rows])


class ContactSigmas(NamedTuple):
    """Standard deviations of contacts.

    Attributes:
        position: along the normal, shape (n,), m.
        normal: of a small rotation about each axis, shape (n,), rad.
    """

    position: FloatArray
    normal: FloatArray

    def chosen(self, rows: NDArray[np.integer]) -> "ContactSigmas":
        """Selects contacts by their indices, possibly repeated."""
        return ContactSigmas(self.position[rows], self.normal[rows])


class SurfaceRows(NamedTuple):
    """Whitened residuals.

    Attributes:
        residual: shape (n, 4).
        by_pose: derivatives by the increment of the grasp's pose, shape (n, 4, 6).
        by_shared: derivatives by the shared unknowns, shape (n, 4, d).
        log_scale: log of the product of the whitening standard deviations, one of the distance and two of angles, shape
            (n,); zero if there is no contact.
    """

    residual: FloatArray
    by_pose: FloatArray
    by_shared: FloatArray
    log_scale: FloatArray


def surface_rows(
    grids: Sequence[DistanceGrid], X_PO: FloatArray, touches: GraspContacts, noise: ContactSigmas
) -> SurfaceRows:
    """The residuals of all contacts; zero if there is no contact.

    Args:
        grids: of the object of each grasp.
        X_PO: its pose in each grasp, shape (g, 3, 4).
        touches: the contacts.
        noise: their standard deviations.
    """
    X = X_PO[touches.grasp]
    R, q = X[:, :, :3], np.einsum("nji,nj->ni", X[:, :, :3], touches.p_PC - X[:, :, 3])
    m = np.einsum("nji,nj->ni", R, touches.n_PC)
    phi, normal, turn = _fields(grids, touches.grasp, q)
    # Where the normal varies within the point's error, its variance grows accordingly.
    weight_p = touches.valid / noise.position
    spread = 0.5 * np.einsum("nij,nij->n", turn, turn) * noise.position**2
    weight_n = touches.valid / np.sqrt(noise.normal**2 + spread)
    residual = np.concatenate([(weight_p * phi)[:, None], weight_n[:, None] * (normal - m)], axis=1)
    by_q = np.concatenate([weight_p[:, None, None] * normal[:, None], weight_n[:, None, None] * turn], axis=1)
    by_m = np.zeros_like(by_q)
    by_m[:, 1:] = -weight_n[:, None, None] * np.eye(3)
    # q and m rotate by -w x q and -w x m when the object rotates by w; q moves against the object, and with the
    # contact.
    by_pose = np.concatenate([by_q @ skew(q) + by_m @ skew(m), -by_q @ np.swapaxes(R, 1, 2)], axis=2)
    by_contact = np.concatenate([by_q @ np.swapaxes(R, 1, 2), -by_m @ skew(m) @ np.swapaxes(R, 1, 2)], axis=2)
    log_scale = np.where(touches.valid, np.log(noise.position) + np.log(noise.normal**2 + spread), 0.0)
    return SurfaceRows(residual, by_pose, by_contact @ touches.J, log_scale)


def _fields(
    grids: Sequence[DistanceGrid], grasp: NDArray[np.int64], q: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Distances (n,), m, normals (n, 3), and the normals' derivatives (n, 3, 3), 1/m, at points of the objects."""
    phi, normal, turn = np.empty(len(q)), np.empty((len(q), 3)), np.empty((len(q), 3, 3))
    for grid in {id(grid): grid for grid in grids}.values():
        rows = np.array([i for i, g in enumerate(grasp) if grids[g] is grid], dtype=np.int64)
        step = grid.spacing * np.concatenate([np.zeros((1, 3)), np.eye(3), -np.eye(3)])
        distance, direction = grid.distance_and_normal(q[rows, None] + step)
        phi[rows], normal[rows] = distance[:, 0], direction[:, 0]
        turn[rows] = np.swapaxes(direction[:, 1:4] - direction[:, 4:], 1, 2) / (2.0 * grid.spacing)
    return phi, normal, turn
