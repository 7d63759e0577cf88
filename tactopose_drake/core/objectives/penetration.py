"""Penalises overlap of the object with the hand."""

import copy
from typing import Self

import numpy as np

from tactopose_drake.core.compilation import read_only
from tactopose_drake.core.evidence.hand_geometry import HandGeometry
from tactopose_drake.core.geometry_checks import pose_batch
from tactopose_drake.core.kernels import penetration_kernels
from tactopose_drake.core.kernels.hand_sphere_kernels import Spheres, gather_neighbourhoods
from tactopose_drake.core.kernels.penetration_kernels import Depths
from tactopose_drake.core.objectives.objective import LeastSquaresObjective, NormalEquations
from tactopose_drake.core.shape.signed_distance import DistanceGrid
from tactopose_drake.core.validation import FloatArray


class Penetration(LeastSquaresObjective):
    """Overlap of the hand with the object, where it is deepest in each neighbourhood.

    The spheres are grouped into neighbourhoods of some centimetres. Each has one residual, max(0, d - allowed) / sigma,
    where d = max_i (radius_i - phi(q_i)) is the depth of its deepest sphere in the object, and
    q_i = R_PO^T (p_PH - p_PO). So the spheres of one place count once, however densely they are packed.

    Two rigid bodies do not overlap, but the hand's surface is known only up to a Gaussian error: the probability that
    this explains an overlap d is Phi(-d / sigma), whose negative logarithm is at least d^2 / (2 sigma^2) (the Chernoff
    bound). This bound is the cost; it is 0 if the hand merely touches, and never overstates the evidence.
    """

    def __init__(
        self, grid: DistanceGrid, hand: HandGeometry, allowed: float = 0.0, neighbourhood: float = 0.02
    ) -> None:
        """Groups the spheres into neighbourhoods.

        Args:
            grid: of the object.
            hand: the parts of the hand that the object keeps out of.
            allowed: an overlap without cost, m, for yielding skin and errors of the contacts.
            neighbourhood: spheres whose centres are closer than this, m, share their error: about the size of a
                finger's link.
        """
        largest_first = np.argsort(-hand.radius, kind="stable")
        group, distance = np.empty(len(hand), dtype=np.int64), np.empty(len(hand))
        leads = np.empty(len(hand), dtype=np.bool_)
        gather_neighbourhoods(hand.p_PH, largest_first, neighbourhood, group, distance, leads)
        # Sorted by neighbourhood, the leader first, the others by descending reach.
        reach = distance + hand.radius
        order = np.lexsort((-reach, ~leads, group))
        reach, group = reach[order], group[order]
        start = np.searchsorted(group, np.arange(group[-1] + 2))
        reach[start[:-1]] = np.maximum.reduceat(reach, start[:-1])
        p_PH, radius, count = hand.p_PH[order], hand.radius[order], len(start) - 1
        leaders = np.concatenate([p_PH[start[:-1]].T, reach[None, start[:-1]]])
        limits = np.full(count, float(allowed)), np.full(count, 1.0 / hand.sigma)
        arrays = p_PH, radius, reach, start, leaders, *limits, grid.coarse_distances
        self._grid, self.spheres = grid.nodes, Spheres(*map(read_only, arrays))

    def joined(self, other: Self) -> Self:
        """The joint objective of both, for the same object."""
        own, others, joined = self.spheres, other.spheres, copy.copy(self)
        start = np.concatenate([own.start[:-1], others.start + len(own.p)])
        leaders = np.concatenate([own.leaders, others.leaders], axis=1)
        names = "p", "radius", "reach", "allowed", "weight"
        rows = {name: np.concatenate([getattr(own, name), getattr(others, name)]) for name in names}
        arrays = {name: read_only(array) for name, array in {**rows, "start": start, "leaders": leaders}.items()}
        joined.spheres = own._replace(**arrays)
        return joined

    def residuals(self, X_PO: FloatArray) -> FloatArray:
        """Residuals (B, g) of poses (B, 3, 4), one for each of g neighbourhoods."""
        return self.spheres.weight * self._depths(X_PO).excess

    def residuals_and_jacobian(self, X_PO: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Residuals (B, g) and their derivatives by the increment (B, g, 6)."""
        depths, weight = self._depths(X_PO), self.spheres.weight
        jacobian = np.empty((*depths.excess.shape, 6))
        penetration_kernels.penetration_jacobian(weight, pose_batch(X_PO), depths, jacobian)
        return weight * depths.excess, jacobian

    def cost(self, X_PO: FloatArray) -> FloatArray:
        """Costs (B,) of poses (B, 3, 4)."""
        cost = np.empty(len(X_PO))
        penetration_kernels.penetration_costs(self._grid, self.spheres, pose_batch(X_PO), cost)
        return cost

    def normal_equations(self, X_PO: FloatArray) -> NormalEquations:
        """Cost, gradient and Gauss-Newton Hessian at poses (B, 3, 4)."""
        count = len(X_PO)
        equations = NormalEquations(np.empty(count), np.empty((count, 6)), np.empty((count, 6, 6)))
        penetration_kernels.penetration_normal_equations(self._grid, self.spheres, pose_batch(X_PO), *equations)
        return equations

    def _depths(self, X_PO: FloatArray) -> Depths:
        """Overlap of each neighbourhood beyond what is allowed (B, g), m; its point in O, and the gradient there."""
        shape = len(X_PO), len(self.spheres.weight)
        depths = Depths(np.empty(shape), np.empty((*shape, 3)), np.empty((*shape, 3)))
        penetration_kernels.penetration_depths(self._grid, self.spheres, pose_batch(X_PO), depths)
        return depths


def overlap_slope(grid: DistanceGrid, hand: HandGeometry, X_PO: FloatArray) -> FloatArray:
    """Derivative of the deepest overlap by the increment at poses (B, 3, 4), shape (B, 6), m by rad and m."""
    slope = np.empty((len(X_PO), 6))
    for row, X in zip(slope, X_PO, strict=True):
        q = (hand.p_PH - X[:, 3]) @ X[:, :3]
        deepest = int(np.argmax(hand.radius - grid.distance(q)))
        normal = grid.distance_and_normal(q[deepest : deepest + 1])[1][0]
        row[:3], row[3:] = np.cross(q[deepest], normal), X[:, :3] @ normal
    return slope
