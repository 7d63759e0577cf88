"""How well an object covers itself when it is turned, by its surface samples and its distance grid."""

import math
from dataclasses import dataclass

import numpy as np

from tactopose_drake.core.poses import exp_so3, log_so3
from tactopose_drake.core.shape.signed_distance import DistanceGrid
from tactopose_drake.core.shape.surface_samples import SurfaceSamples
from tactopose_drake.core.validation import FloatArray

# By how much more than unturned ones turned samples may be off the grid's surface.
_GRID_FACTOR = 1.5


@dataclass(frozen=True, kw_only=True)
class SymmetryDetectionParams:
    """What counts as unchanged, and how thoroughly axes are searched for."""

    tolerance: float = 0.005  # of the 95th percentile of the turned samples' distances, as a share of the size
    radius_share: float = 0.05  # the same, of the mean distance from the longest axis: a hexagonal rod is no cylinder
    outlier_factor: float = 3.0  # the largest distance, in tolerances: a small handle breaks the symmetry
    normal_angle: float = math.radians(5.0)  # median between the normals, rad
    # Likewise for a continuous axis: half the angle between the sides of a prism of 24.
    continuous_normal_angle: float = math.radians(7.5)
    equal_moments: float = 0.05  # difference of two moments, as a share of the largest, below which they may be equal
    highest_order: int = 30  # that is looked for; axes of higher ones are continuous or none
    irrational_turns: int = 6  # that a continuous axis is tried with, beside those of all orders
    judged_samples: int = 1000  # about so many of the surface's, at least, say whether a turn counts
    searched_samples: int = 150  # likewise in the search for axes
    directions: int = 250  # over a half sphere, in which axes are searched for where three moments are alike
    promising: int = 48  # of all directions, by their distances, from which axes are refined


class SymmetryJudge:
    """Says how well an object covers itself when turned about an axis through its centroid."""

    def __init__(
        self,
        samples: SurfaceSamples,
        grid: DistanceGrid,
        centroid: FloatArray,
        longest_axis: FloatArray,
        size: float,
        params: SymmetryDetectionParams,
    ) -> None:
        fine, coarse = (max(1, len(samples) // n) for n in (params.judged_samples, params.searched_samples))
        self._params = params
        self._grid, self._centroid = grid, centroid
        self._points = samples.points[::fine] - centroid
        # The grid's normals on both sides: rounding of the edges by the interpolation then cancels.
        own_distance, self._normals = grid.distance_and_normal(samples.points[::fine])
        self._few = samples.points[::coarse] - centroid
        radius = float(np.linalg.norm(np.cross(self._points, longest_axis), axis=1).mean())
        tolerance = params.tolerance * size
        # Of a thin rod the grid itself is farther off the surface than that.
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
        """Whether the turns about the axis by all these angles leave the object unchanged, within the tolerance."""
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
            # Either side's normal will do: in a plate thinner than the grid's spacing the field has only one of them.
            cosine = np.minimum(np.abs(np.sum(normal * (self._normals @ R.T), axis=1)), 1.0)
            if (
                np.percentile(distance, 95) > self._limit
                or distance.max() > self._outlier_limit
                or np.median(np.arccos(cosine)) > normal_angle
            ):
                return False
        return True

    def most_promising(self, axes: FloatArray, angle: float) -> FloatArray:
        """The axes of (n, 3) about which the turn leaves the smallest mean distance, as many as `params` say."""
        count = self._params.promising
        if len(axes) <= count:
            return axes
        R = exp_so3(angle * axes)
        turned = np.einsum("bij,nj->bni", R, self._few) + self._centroid
        misfit = np.abs(self._grid.distance(turned)).mean(axis=1)
        return axes[np.argsort(misfit, kind="stable")[:count]]

    def refine(self, axes: FloatArray, angle: float, iterations: int) -> FloatArray:
        """Turns axes (n, 3) by Gauss-Newton to where the mean square distance of the turned samples is least.

        With the axis turned by a small w, R becomes exp(w) R exp(-w), so a turned sample q = R p moves by
        w x q - R (w x p), and its distance by w . (q x n - p x R^T n).
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
