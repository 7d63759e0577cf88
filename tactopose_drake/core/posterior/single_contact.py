"""Poses drawn from all those that a single contact leaves.

They form a family that extends over the whole surface and all spins about the normal. A search finds only some of its
minima if more is known, and tiles reach only as far as the search has led. But poses can be drawn from the family
itself: any place of the surface may be the one that is touched, in any spin. Weighted by what else is known, the draws
cover each of its parts in proportion to its probability.
"""

import functools
import math

import numpy as np

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.objectives.surface_density import SurfaceDensity
from tactopose_drake.core.poses import axes_across, make_poses
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import FloatArray

# The draws' standard deviations over those that are told: the noise may be larger, and then poses farther off weigh.
_WIDER = 1.5


class SingleContact:
    """The density of poses that a single contact with its normal leaves: uniform over the surface and the spin.

    The noise is larger than told, see above, but otherwise as in `SurfaceDensity`.
    """

    def __init__(self, model: ObjectModel, contact: Contacts) -> None:
        """The density of poses by the only one of the contacts, in P."""
        assert contact.n_PC is not None
        self._p_PC, self._n_PC = contact.p_PC[0], contact.n_PC[0]
        self._sigma_position = _WIDER * float(np.max(contact.sigma_position))
        self._sigma_normal = _WIDER * float(np.max(contact.sigma_normal))
        wider = Contacts(
            contact.p_PC, contact.n_PC, sigma_position=self._sigma_position, sigma_normal=self._sigma_normal
        )
        self._surface = SurfaceDensity(model, wider)
        self._blocks = model.surfels(self._sigma_position).blocks
        # The integrals of `SurfaceDensity` over the place, the distance from it, the normal's tilt, and the spin.
        area, spin = float(self._blocks[:, 6].sum(dtype=np.float64)), 2.0 * math.pi
        self._scale = area * math.sqrt(2.0 * math.pi) * self._sigma_position
        self._scale *= 2.0 * math.pi * self._sigma_normal**2 * spin

    @functools.cached_property
    def _discs(self) -> FloatArray:
        """The columns of `Surfels.blocks` for each disc, shape (m, 9)."""
        discs = self._blocks.swapaxes(1, 2).reshape(-1, 9)
        return discs[discs[:, 6] > 0.0].astype(np.float64)

    def density(self, X_PO: FloatArray) -> FloatArray:
        """The density at poses (B, 3, 4) with respect to their volume, shape (B,), 1/(rad^3 m^3)."""
        return np.asarray(self._surface.densities(X_PO)[:, 0] / self._scale)

    def sample(self, count: int, generator: np.random.Generator) -> FloatArray:
        """Draws poses, shape (count, 3, 4), in equal numbers from parts of the surface of equal area."""
        ends = self._discs[:, 6].cumsum()
        along = (np.arange(count) + generator.random()) * (ends[-1] / count)
        disc = self._discs[np.minimum(ends.searchsorted(along, side="right"), len(ends) - 1)]
        centre, normal, variance, roughness = disc[:, :3], disc[:, 3:6], disc[:, 7:8], disc[:, 8:9]
        white, across = generator.normal(size=(count, 7)), np.stack(axes_across(normal), axis=1)
        in_disc = np.sqrt(variance) * white[:, :2]
        tilt = np.sqrt(self._sigma_normal**2 + roughness) * white[:, 2:4]
        p_OC = centre + np.einsum("bi,bij->bj", in_disc, across) + self._sigma_position * white[:, 4:]
        n_OC = normal + np.einsum("bi,bij->bj", tilt, across)
        n_OC /= np.linalg.norm(n_OC, axis=1, keepdims=True)
        spin = 2.0 * math.pi * generator.random(count)
        R_PO = _frames(np.tile(self._n_PC, (count, 1)), spin) @ np.swapaxes(_frames(n_OC, np.zeros(count)), 1, 2)
        return make_poses(R_PO, self._p_PC - np.einsum("bij,bj->bi", R_PO, p_OC))


def _frames(z: FloatArray, angle: FloatArray) -> FloatArray:
    """Rotation matrices (n, 3, 3) with third columns z (n, 3), unit vectors; they differ by the angles (n,) about z."""
    x, y = axes_across(z)
    cosine, sine = np.cos(angle)[:, None], np.sin(angle)[:, None]
    return np.stack([cosine * x + sine * y, cosine * y - sine * x, z], axis=2)
