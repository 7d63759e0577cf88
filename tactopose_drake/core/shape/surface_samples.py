"""Deterministic points spread evenly over a mesh's surface, with the normals of their faces.

The area is cut into as many equal patches as there are samples, along a curve that visits the faces in spatial order
and each face in the order of its sub-triangles [B15]. Each patch offers a few candidates, of which the one farthest
from all points chosen so far is taken: equal area per sample, without the clusters of independent random points.

Sources: [B15] K. Basu and A. Owen, Low discrepancy constructions in the triangle, SIAM J. Numer. Anal., 2015.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.shape.morton_order import morton_codes
from tactopose_drake.core.shape.sampling_kernels import triangle_curve
from tactopose_drake.core.validation import FloatArray

_BITS = 10  # of each coordinate in the Morton code that sorts faces
_CANDIDATES = 4  # in each patch, of which one becomes a sample; more make samples more even, and take longer


@dataclass(frozen=True, eq=False)
class SurfaceSamples:
    """Points on an object's surface and the outward unit normals there, in the object's frame O.

    Attributes:
        points: shape (n, 3), m, read-only.
        normals: shape (n, 3), read-only.
    """

    points: FloatArray
    normals: FloatArray

    def __len__(self) -> int:
        return len(self.points)

    def thinned(self, count: int) -> SurfaceSamples:
        """This number of the samples, evenly chosen, in new arrays."""
        chosen = np.linspace(0, len(self), count, endpoint=False).astype(np.intp)
        return SurfaceSamples(self.points[chosen], self.normals[chosen])

    @cached_property
    def spread(self) -> tuple[FloatArray, float, float]:
        """The points' mean (3,), m, the largest distance from O's origin, m, and a coordinate's mean variance, m^2."""
        variance = float(np.var(self.points, axis=0, ddof=1).mean())
        return self.points.mean(axis=0), float(np.linalg.norm(self.points, axis=1).max()), variance


def sample_surface(vertices: FloatArray, faces: NDArray[np.int32], count: int) -> SurfaceSamples:
    """Takes `count` points, one from each of `count` patches of equal area.

    Args:
        vertices: shape (v, 3), m.
        faces: vertex indices, shape (f, 3); none of zero area.
        count: number of samples.
    """
    candidates, candidate_normals, _ = points_along_surface(vertices, faces, count * _CANDIDATES)
    chosen = _spread(candidates)
    points, normals = candidates[chosen], candidate_normals[chosen]
    points.setflags(write=False)
    normals.setflags(write=False)
    return SurfaceSamples(points, normals)


def points_along_surface(
    vertices: FloatArray, faces: NDArray[np.int32], count: int
) -> tuple[FloatArray, FloatArray, float]:
    """The centres of patches of equal area along the curve.

    Returns:
        Points (count, 3), m; the unit normals of their faces (count, 3); the area of a patch, m^2.
    """
    triangles = vertices[faces]
    triangles = triangles[_spatial_order(triangles.mean(axis=1))]
    cross = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    twice_area = np.linalg.norm(cross, axis=1)
    ends = np.cumsum(twice_area)
    along = (np.arange(count) + 0.5) * (ends[-1] / count)
    face = np.minimum(np.searchsorted(ends, along, side="right"), len(faces) - 1)
    share = np.clip(1.0 - (ends[face] - along) / twice_area[face], 0.0, 1.0 - 1e-12)
    points = np.einsum("nc,ncd->nd", triangle_curve(share), triangles[face])
    return points, cross[face] / twice_area[face, None], 0.5 * float(ends[-1]) / count


def _spatial_order(points: FloatArray) -> NDArray[np.intp]:
    """Indices that sort points (n, 3) along a Morton curve."""
    low = points.min(axis=0)
    scale = (2**_BITS - 1) / max(float(np.ptp(points, axis=0).max()), 1e-12)
    cell = ((points - low) * scale).astype(np.int64)
    return np.argsort(morton_codes(cell, _BITS), kind="stable")


def _spread(candidates: FloatArray) -> NDArray[np.intp]:
    """From each group of consecutive candidates, the one farthest from those chosen before."""
    groups = len(candidates) // _CANDIDATES
    chosen = np.empty(groups, dtype=np.intp)
    square = np.sum(candidates**2, axis=1)
    nearest = np.full(len(candidates), np.inf)
    for group in range(groups):
        first = group * _CANDIDATES
        pick = first + int(np.argmax(nearest[first : first + _CANDIDATES]))
        chosen[group] = pick
        np.minimum(nearest, square - 2.0 * (candidates @ candidates[pick]) + square[pick], out=nearest)
    return chosen
