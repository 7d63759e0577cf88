"""Contacts against the surface as it is, edges and thin walls included: the exact likelihood, without derivatives."""

import numpy as np

from tactopose_drake.core.compilation import read_only
from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.shape.surfel_kernels import Measurements
from tactopose_drake.core.shape.surfels import contact_densities
from tactopose_drake.core.validation import FloatArray

DENSITY_FLOOR = 1e-9
"""The density far from the surface, as a share of that on it: so the cost stays finite."""


class SurfaceDensity:
    """How likely what was measured of each contact is, if the contact may lie anywhere on the surface.

    Its cost agrees with that of `SurfaceContact` where the surface is flat. Elsewhere that one, which knows but one
    distance and one mean normal, is an approximation, with derivatives and about ten times as fast. Further than a few
    standard deviations from the surface the cost is constant.
    """

    def __init__(self, model: ObjectModel, contacts: Contacts) -> None:
        self._surfels = model.surfels(float(np.min(contacts.sigma_position)))
        n_PC = np.zeros_like(contacts.p_PC) if contacts.n_PC is None else contacts.n_PC
        self._measured = Measurements(
            read_only(contacts.p_PC),
            read_only(n_PC),
            read_only(np.asarray(contacts.sigma_position)),
            read_only((0.0 if contacts.n_PC is None else 1.0) / contacts.sigma_normal),
        )

    def cost(self, X_PO: FloatArray) -> FloatArray:
        """Costs (B,) of poses (B, 3, 4)."""
        return np.asarray(-np.log(self.densities(X_PO) + DENSITY_FLOOR).sum(axis=1))

    def densities(self, X_PO: FloatArray) -> FloatArray:
        """Of each contact at poses (B, 3, 4), over those on a flat surface with the right normal, shape (B, k)."""
        return contact_densities(self._surfels, self._measured, np.ascontiguousarray(X_PO))
