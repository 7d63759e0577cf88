"""Contacts against the exact surface, edges and thin walls included: the exact likelihood, without derivatives."""

import math

import numpy as np

from tactopose_drake.core.compilation import read_only
from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.geometry_checks import pose_batch
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.shape.surfel_kernels import Measurements, densities
from tactopose_drake.core.validation import FloatArray

DENSITY_FLOOR = 1e-9
"""The density far from the surface, relative to that on it, which keeps the cost finite."""

# Contacts whose standard deviations are within this factor share the same discs.
_WIDEST_SHARE = 4.0


class SurfaceDensity:
    """The likelihood of each contact's measurement, if the contact may lie anywhere on the surface.

    Its cost agrees with that of `SurfaceContact` where the surface is flat. Elsewhere the latter, with one distance and
    one mean normal, is an approximation, with derivatives and about ten times as fast. Beyond a few standard deviations
    from the surface the cost is constant.
    """

    def __init__(self, model: ObjectModel, contacts: Contacts) -> None:
        sigma = np.asarray(contacts.sigma_position)
        weight_n = (0.0 if contacts.n_PC is None else 1.0) / np.asarray(contacts.sigma_normal)
        # Discs are as fine as the surest contact needs. Less certain ones have coarser discs of their own.
        finest, every = float(sigma.min()), Measurements(contacts.p_PC, contacts.normals_or_zeros, sigma, weight_n)
        steps = [math.floor(math.log(each / finest) / math.log(_WIDEST_SHARE)) for each in sigma.tolist()]
        self._parts = []
        for step in sorted(set(steps)):
            index = [m for m, each in enumerate(steps) if each == step]
            measured = every if len(index) == len(steps) else Measurements(*(numbers[index] for numbers in every))
            discs = model.surfels(float(measured.sigma_position.min())).kernel_view()
            self._parts.append((index, discs, Measurements(*map(read_only, measured))))

    def cost(self, X_PO: FloatArray) -> FloatArray:
        """Costs (B,) of poses (B, 3, 4)."""
        return np.asarray(-np.log(self.densities(X_PO) + DENSITY_FLOOR).sum(axis=1))

    def densities(self, X_PO: FloatArray) -> FloatArray:
        """Densities at poses (B, 3, 4), relative to a contact on a flat surface with the right normal, shape (B, k)."""
        X_PO = pose_batch(X_PO)
        of_parts = []
        for _, discs, measured in self._parts:
            of_parts.append(np.empty((len(X_PO), len(measured.p))))
            densities(discs, measured, X_PO, of_parts[-1])
        if len(of_parts) == 1:
            return of_parts[0]
        density = np.empty((len(X_PO), sum(part.shape[1] for part in of_parts)))
        for (index, _, _), part in zip(self._parts, of_parts, strict=True):
            density[:, index] = part
        return density
