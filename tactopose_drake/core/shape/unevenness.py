"""How much a surface changes over a distance: what a point that is off along the surface says wrongly of it.

A contact is compared with the surface next to where it was measured. Where that is d beside the place that was touched,
a flat surface is the same there; a curved one lies higher or lower and is turned. Over an edge it is another: that is
the mixture's matter (`ContactMixture`, a normal that is any), and is left out here.
"""

from typing import NamedTuple

import numpy as np

from tactopose_drake.core.shape.surface_samples import SurfaceSamples
from tactopose_drake.core.validation import FloatArray

_STEP, _BINS = 0.001, 20  # m, and how many distances
_FROM = 500  # samples that are looked from
_LEAST_COSINE = 0.5  # of two normals that are of one smooth piece
_FEWEST = 30  # pairs in a bin


class Unevenness(NamedTuple):
    """Of a surface, over distances along it.

    Attributes:
        distance: shape (m,), m, from 0 on.
        height: mean square of how far one point lies from the other's tangent plane, shape (m,), m^2.
        turn: mean square of the angle between their normals about each tangent, shape (m,), rad^2.
    """

    distance: FloatArray
    height: FloatArray
    turn: FloatArray

    def variances(self, sigma: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Of height, m^2, and turn, rad^2, for points that are off by sigma (k,), m, along each of two tangents."""
        d = np.sqrt(2.0) * sigma
        return np.interp(d, self.distance, self.height), np.interp(d, self.distance, self.turn)


def find_unevenness(samples: SurfaceSamples) -> Unevenness:
    """Measures pairs of surface samples."""
    chosen = np.linspace(0, len(samples.points) - 1, min(_FROM, len(samples.points))).astype(int)
    apart = samples.points[None] - samples.points[chosen, None]
    height = np.einsum("ijk,ik->ij", apart, samples.normals[chosen])
    squared = np.einsum("ijk,ijk->ij", apart, apart)
    cosine = samples.normals[chosen] @ samples.normals.T
    along = np.sqrt(np.maximum(squared - height**2, 0.0))
    # As near across the surface as along it: not the other side of a thin wall, nor another part.
    near = (along < _BINS * _STEP) & (along > 0.0) & (np.abs(height) < along) & (cosine > _LEAST_COSINE)
    place = (along[near] / _STEP).astype(int)
    count = np.bincount(place, minlength=_BINS)
    known = count >= _FEWEST
    if not known.any():
        return Unevenness(np.zeros(1), np.zeros(1), np.zeros(1))
    turn = np.arccos(np.minimum(cosine[near], 1.0))
    means = [np.bincount(place, w, minlength=_BINS)[known] / count[known] for w in (height[near] ** 2, 0.5 * turn**2)]
    middle = _STEP * (np.arange(_BINS)[known] + 0.5)
    return Unevenness(*(np.concatenate([[0.0], values]) for values in (middle, *means)))
