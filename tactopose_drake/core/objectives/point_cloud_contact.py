"""Contacts against the neighbourhood of a point cloud: the thesis' objectives, as published.

Source: [B16] J. Bimbo, thesis, 2016, section 3.2 and algorithm 3.1.
"""

import numpy as np
from scipy.spatial import cKDTree

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.objectives.finite_differences import DifferencedObjective
from tactopose_drake.core.validation import FloatArray
from tactopose_drake.errors import InvalidInputError


class PointCloudContact(DifferencedObjective):
    """For each contact the least of ||q - s_i||^2 + w_n |1 - <u, n_i>| over the points near its first guess.

    The points near contact m are the cloud's `neighbours` nearest ones at the first guess of the pose ([B16] eq. 3.2,
    the distance set so that each finger has a minimum number of points). w_n = 0 is [B16] eq. 3.3, else eq. 3.5.
    """

    def __init__(
        self,
        points: FloatArray,
        normals: FloatArray,
        contacts: Contacts,
        X_PO_guess: FloatArray,
        normal_weight: float = 0.0,
        neighbours: int = 50,
    ) -> None:
        """Chooses the neighbourhoods.

        Args:
            points: the object's point cloud in O, shape (n, 3), m.
            normals: its outward unit normals in O, shape (n, 3).
            contacts: the measured contacts in P; with normals where normal_weight > 0.
            X_PO_guess: the first guess of the pose, shape (3, 4).
            normal_weight: w_n, m^2 (the thesis counts in cm^2: its 20 is 20e-4 here).
            neighbours: points a contact is compared with.

        Raises:
            InvalidInputError: if w_n > 0 and the contacts have no normals.
        """
        if normal_weight > 0 and contacts.n_PC is None:
            raise InvalidInputError("contacts must have normals n_PC for a normal_weight > 0, not None.")
        self._p_PC, self._n_PC, self._normal_weight = contacts.p_PC, contacts.normals_or_zeros, normal_weight
        guess = (contacts.p_PC - X_PO_guess[:, 3]) @ X_PO_guess[:, :3]
        _, index = cKDTree(points).query(guess, k=min(neighbours, len(points)))
        index = index.reshape(len(contacts), -1)
        self._points, self._normals = points[index], normals[index]  # (k, neighbours, 3)

    def residuals(self, X_PO: FloatArray) -> FloatArray:
        """G (B, k) of poses (B, 3, 4), m^2. [B16] eqs. 3.3 and 3.5."""
        R_PO = X_PO[:, :, :3]
        q = (self._p_PC - X_PO[:, None, :, 3]) @ R_PO
        u = self._n_PC @ R_PO
        squares = np.sum((q[:, :, None] - self._points) ** 2, axis=-1)
        if self._normal_weight > 0:
            squares += self._normal_weight * np.abs(1.0 - np.einsum("bka,kna->bkn", u, self._normals))
        least: FloatArray = squares.min(axis=-1)
        return least
