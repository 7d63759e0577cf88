"""Contacts against the nearest points of a point cloud: the cost of the thesis' global search, as published.

Source: [B16] J. Bimbo, thesis, 2016, section 4.2.1.
"""

import numpy as np
from scipy.spatial import cKDTree

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.objectives.finite_differences import DifferencedObjective
from tactopose_drake.core.validation import FloatArray
from tactopose_drake.errors import InvalidInputError


class NearestPointContact(DifferencedObjective):
    """G = sum_m min_i (||q_m - s_i|| + w_n (1 - <u_m, n_i>)), in m, as half a sum of squares. [B16] eq. 4.1.

    The minimum for contact m is over the points s_i nearest to it at each pose, which a k-d tree finds. Its residual is
    the square root of twice its share of G.
    """

    def __init__(
        self,
        points: FloatArray,
        normals: FloatArray,
        contacts: Contacts,
        normal_weight: float = 0.2,
        neighbours: int = 10,
    ) -> None:
        """Builds the k-d tree.

        Args:
            points: the object's point cloud in O, shape (n, 3), m.
            normals: its outward unit normals in O, shape (n, 3).
            contacts: the measured contacts in P, with normals.
            normal_weight: w_n, m; chapter 3's 20, with lengths in cm, as the thesis gives none for chapter 4.
            neighbours: number of nearest points in the minimum. With one alone, a contact beside an edge would get the
                normal of whichever face happens to be nearer.

        Raises:
            InvalidInputError: if the contacts have no normals.
        """
        if contacts.n_PC is None:
            raise InvalidInputError("contacts must have normals n_PC for this objective, not None.")
        self._p_PC, self._n_PC = contacts.p_PC, contacts.n_PC
        self._tree, self._normals = cKDTree(points), normals
        self._normal_weight, self._ranks = normal_weight, np.arange(1, min(neighbours, len(points)) + 1)

    def residuals(self, X_PO: FloatArray) -> FloatArray:
        """Residuals (B, k) of poses (B, 3, 4), roots of m."""
        R_PO = X_PO[:, :, :3]
        distance, index = self._tree.query((self._p_PC - X_PO[:, None, :, 3]) @ R_PO, self._ranks)
        cosine = np.einsum("bka,bkna->bkn", self._n_PC @ R_PO, self._normals[index])
        least = np.min(distance + self._normal_weight * (1.0 - cosine), axis=-1)
        residuals: FloatArray = np.sqrt(2.0 * least.clip(0.0))
        return residuals
