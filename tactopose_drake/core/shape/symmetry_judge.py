"""Tests of rotations as symmetries of an object, with its surface samples and its distance grid."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from tactopose_drake.core.poses import exp_so3, log_so3
from tactopose_drake.core.shape.signed_distance import DistanceGrid
from tactopose_drake.core.shape.surface_samples import SurfaceSamples
from tactopose_drake.core.validation import FloatArray

# Largest distance of rotated samples from the grid's surface, over that of the samples themselves.
_GRID_FACTOR = 1.5


@dataclass(frozen=True, kw_only=True)
class SymmetryDetectionParams:
    """Tolerances of symmetries, and how thoroughly axes are searched for."""

    tolerance: float = 0.005  # on the 95th percentile of the rotated samples' distances, as a share of the size
    radius_share: float = 0.05  # the same, of the mean distance from the longest axis: a hexagonal rod is no cylinder
    outlier_factor: float = 3.0  # on the largest distance, in tolerances: a small handle breaks the symmetry
    normal_angle: float = math.radians(5.0)  # on the median angle between normals, rad
    # The same for a continuous axis: half the angle between the sides of a prism of 24.
    continuous_normal_angle: float = math.radians(7.5)
    equal_moments: float = 0.05  # difference of two moments over the largest, below which they may be equal
    highest_order: int = 30  # that is tried; axes of higher order are continuous or none
    irrational_turns: int = 6  # rotations that test a continuous axis, besides those of all orders
    judged_samples: int = 1000  # least number of surface samples that test a rotation, approximately
    searched_samples: int = 150  # the same in the search for axes
    directions: int = 250  # over a hemisphere, in which axes are searched for if three moments are equal
    promising: int = 48  # most directions, those of least distances, from which axes are refined


class JudgedShape(NamedTuple):
    """All of an object that its symmetries depend on.

    Attributes:
        samples: points on the surface, in O.
        grid: the signed distance grid.
        centroid: the volume's centroid, through which all axes pass, shape (3,), m.
        inertia: uniform density, about the centroid, shape (3, 3).
        size: diagonal of the bounding box, m.
    """

    samples: SurfaceSamples
    grid: DistanceGrid
    centroid: FloatArray
    inertia: FloatArray
    size: float

    def principal(self) -> tuple[FloatArray, FloatArray]:
        """The principal moments of inertia, ascending, shape (3,), and their axes as rows, longest first, (3, 3)."""
        moments, directions = np.linalg.eigh(self.inertia)
        return moments, directions.T


class SymmetryJudge:
    """Tests whether an object is unchanged by rotations about axes through its centroid."""

    def __init__(self, shape: JudgedShape, params: SymmetryDetectionParams) -> None:
        samples, grid, centroid, _, size = shape
        _, (longest_axis, _, _) = shape.principal()
        fine, coarse = (max(1, len(samples) // n) for n in (params.judged_samples, params.searched_samples))
        self._params = params
        self._grid, self._centroid = grid, centroid
        self._points = samples.points[::fine] - centroid
        # Both normals are from the grid, so that its rounding of edges cancels.
        own_distance, self._normals = grid.distance_and_normal(samples.points[::fine])
        self._few = samples.points[::coarse] - centroid
        radius = float(np.linalg.norm(np.cross(self._points, longest_axis), axis=1).mean())
        tolerance = params.tolerance * size
        # For a thin rod the error of the grid itself exceeds the radius' share.
        own_limit = _GRID_FACTOR * float(np.percentile(np.abs(own_distance), 95))
        self._limit = min(tolerance, max(params.radius_share * radius, own_limit))
        self._outlier_limit = params.outlier_factor * tolerance
        inverse_orders = 1 / np.arange(2, params.highest_order + 1)
        irrational = np.modf(0.6180339887 * np.arange(1, params.irrational_turns + 1))[0]  # by the golden ratio
        self._every_turn = 2 * np.pi * np.array([*inverse_orders, *irrational])

    def turns_freely(self, axis: FloatArray) -> bool:
        """Whether the axis is one of continuous symmetry."""
        return self._holds(axis, self._every_turn, self._params.continuous_normal_angle)

    def holds(self, axis: FloatArray, angles: FloatArray) -> bool:
        """Whether rotations about the axis by all these angles leave the object unchanged, within the tolerance."""
        return self._holds(axis, angles, self._params.normal_angle)

    def holds_all(self, poses: FloatArray) -> bool:
        """Whether each of the poses (g, 3, 4), the identity first, leaves the object unchanged."""
        turns = log_so3(poses[1:, :, :3])
        angles = np.linalg.norm(turns, axis=1)
        return all(self.holds(turn / angle, np.array([angle])) for turn, angle in zip(turns, angles, strict=True))

    def _holds(self, axis: FloatArray, angles: FloatArray, normal_angle: float) -> bool:
        for angle in angles:
            R = exp_so3(angle * axis)
            distance, normal = self._grid.distance_and_normal(self._points @ R.T + self._centroid)
            distance = np.abs(distance)
            # The normal may have either sign: in a plate thinner than the grid's spacing the field has one side only.
            cosine = np.minimum(np.abs(np.sum(normal * (self._normals @ R.T), axis=1)), 1.0)
            if (
                np.percentile(distance, 95) > self._limit
                or distance.max() > self._outlier_limit
                or np.median(np.arccos(cosine)) > normal_angle
            ):
                return False
        return True

    def most_promising(self, axes: FloatArray, angle: float) -> FloatArray:
        """The axes among (n, 3) whose rotation leaves the smallest mean distances, at most `params.promising`."""
        count = self._params.promising
        if len(axes) <= count:
            return axes
        R = exp_so3(angle * axes)
        turned = np.einsum("bij,nj->bni", R, self._few) + self._centroid
        misfit = np.abs(self._grid.distance(turned)).mean(axis=1)
        return axes[np.argsort(misfit, kind="stable")[:count]]

    def refine(self, axes: FloatArray, angle: float, iterations: int) -> FloatArray:
        """Gauss-Newton refinement of axes (n, 3) that minimises the mean squared distance of the rotated samples.

        A small rotation w of the axis changes R to exp(w) R exp(-w), so a rotated sample q = R p moves by
        w x q - R (w x p), and its distance changes by w . (q x n - p x R^T n).
        """
        for _ in range(iterations):
            R = exp_so3(angle * axes)
            turned = np.einsum("bij,nj->bni", R, self._few)
            distance, normal = self._grid.distance_and_normal(turned + self._centroid)
            J = np.cross(turned, normal) - np.cross(self._few, np.einsum("bji,bnj->bni", R, normal))
            H = np.einsum("bni,bnj->bij", J, J)
            damping = 1e-6 * np.trace(H, axis1=1, axis2=2) + 1e-12
            gradient = np.einsum("bni,bn->bi", J, distance)
            w = -np.linalg.solve(H + damping[:, None, None] * np.eye(3), gradient[..., None])[..., 0]
            length = np.linalg.norm(w, axis=1, keepdims=True)
            w *= np.minimum(1.0, 0.1 / np.maximum(length, 1e-12))
            axes = np.einsum("bij,bj->bi", exp_so3(w), axes)
        return axes
