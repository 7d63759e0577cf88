"""How much a surface varies over a distance, which is the effect of a contact's error along the surface.

A contact is compared with the surface next to where it was measured. If that is at a distance d along the surface from
the place that was touched, a flat surface is the same there; a curved one is higher or lower and tilted. Edges are left
out here, as the mixture models them (`ContactMixture`, contacts with any normal).
"""

from typing import NamedTuple

import numpy as np

from tactopose_drake.core.shape.surface_samples import SurfaceSamples
from tactopose_drake.core.validation import FloatArray

_STEP, _BINS = 0.001, 20  # width of a bin of distances, m, and number of bins
_FROM = 500  # number of samples that are paired with all others
_LEAST_COSINE = 0.5  # least cosine of two normals on the same smooth piece
_FEWEST = 30  # least number of pairs in a bin


class Unevenness(NamedTuple):
    """Statistics of a surface, by the distance along it.

    Attributes:
        distance: shape (m,), m, from 0 on.
        height: mean square distance of one point from the other's tangent plane, shape (m,), m^2.
        turn: mean square angle between their normals about each tangent, shape (m,), rad^2.
    """

    distance: FloatArray
    height: FloatArray
    turn: FloatArray

    def variances(self, sigma: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Variances of height, m^2, and turn, rad^2, for points with errors sigma (k,), m, along both tangents."""
        d = np.sqrt(2.0) * sigma
        return np.interp(d, self.distance, self.height), np.interp(d, self.distance, self.turn)


def find_unevenness(samples: SurfaceSamples) -> Unevenness:
    """Estimates the statistics from pairs of surface samples."""
    chosen = np.linspace(0, len(samples.points) - 1, min(_FROM, len(samples.points))).astype(int)
    apart = samples.points[None] - samples.points[chosen, None]
    height = np.einsum("ijk,ik->ij", apart, samples.normals[chosen])
    squared = np.einsum("ijk,ijk->ij", apart, apart)
    cosine = samples.normals[chosen] @ samples.normals.T
    along = np.sqrt(np.maximum(squared - height**2, 0.0))
    # Excludes the other side of a thin wall, and other parts: the offset along the normal must not exceed the distance.
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
