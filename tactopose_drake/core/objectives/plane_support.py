"""The height of the object's lowest point over planes that it touches."""

from collections.abc import Sequence

import numpy as np

from tactopose_drake.core.evidence.plane_contact import PlaneContact
from tactopose_drake.core.objectives.objective import LeastSquaresObjective
from tactopose_drake.core.poses import skew
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import FloatArray


class PlaneSupport(LeastSquaresObjective):
    """Height of the object's lowest point over each plane: min_i n' (R_PO v_i + p_PO - p_PQ) / sigma, one residual.

    The minimum is over the vertices v_i of the object's convex hull, which suffice. Where the lowest vertex changes,
    the residual has a kink.
    """

    def __init__(self, model: ObjectModel, planes: Sequence[PlaneContact]) -> None:
        """Takes the hull of the object's vertices."""
        self._p_OV = model.hull_vertices
        self._n_P = np.array([plane.n_P for plane in planes])
        self._offset = np.array([plane.n_P @ plane.p_PQ for plane in planes])
        self._weight = 1.0 / np.array([plane.sigma for plane in planes])

    def residuals(self, X_PO: FloatArray) -> FloatArray:
        """Residuals (B, k) of poses (B, 3, 4), one for each plane."""
        return self._lowest(X_PO)[0]

    def residuals_and_jacobian(self, X_PO: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Residuals (B, k) and their derivatives by the increment (B, k, 6)."""
        residuals, p_OV = self._lowest(X_PO)
        n_O = np.einsum("ki,bij->bkj", self._n_P, X_PO[:, :, :3])
        # v_i moves by -R [v_i]x w + v under an increment (w, v).
        turn = -np.einsum("bki,bkij->bkj", n_O, skew(p_OV))
        shift = np.broadcast_to(self._n_P, turn.shape)
        return residuals, self._weight[:, None] * np.concatenate([turn, shift], axis=2)

    def _lowest(self, X_PO: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Residuals (B, k), and the lowest vertices in O (B, k, 3)."""
        n_O = np.einsum("ki,bij->bkj", self._n_P, X_PO[:, :, :3])
        heights = n_O @ self._p_OV.T
        lowest = heights.argmin(axis=2)
        height = np.take_along_axis(heights, lowest[:, :, None], axis=2)[:, :, 0]
        height = height + X_PO[:, :, 3] @ self._n_P.T - self._offset
        return self._weight * height, self._p_OV[lowest]
