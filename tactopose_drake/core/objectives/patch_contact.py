"""Patches against the signed distance grid, cell by cell: a smooth likelihood that is fast to evaluate."""

import math
from collections.abc import Sequence

import numpy as np

from tactopose_drake.core.compilation import read_only
from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.geometry_checks import pose_batch
from tactopose_drake.core.kernels import patch_kernels
from tactopose_drake.core.kernels.pad_kernels import Pads
from tactopose_drake.core.objectives.objective import LeastSquaresObjective, NormalEquations, SumObjective
from tactopose_drake.core.objectives.surface_contact import SurfaceContact
from tactopose_drake.core.sensing.patches import Patch
from tactopose_drake.core.shape.signed_distance import DistanceGrid
from tactopose_drake.core.validation import FloatArray, positive_number

SIGMA_DEPTH, SHARE = 0.0005, 0.2
"""Usual standard deviations of each cell's depth, m, and of a depth as a share of it."""

# Standard deviation of a position that carries no information, m.
_ANYWHERE = 1e3
# Standard deviations added to every pad's misplacement, whose covariance may be singular: rad, m.
_LEAST_TURN, _LEAST_SHIFT = 1e-4, 1e-5


class PatchCells(LeastSquaresObjective):
    """Residuals of all cells of the pads against the object's signed distance phi.

    A cell that measures the pressure p has the surface where it is pressed in: phi(q) = 0 at its point, alpha p below
    the undeformed pad. A cell that measures none is pressed in by at most the threshold's depth: phi(q) >= 0 there; a
    saturated one by at least the depth that it shows: phi(q) <= 0. A dead cell contributes nothing.

    The noise: each depth has an independent Gaussian error of sigma_depth and a share of itself. A cell measures the
    mean over its area, which is the depth at its centre if the surface is flat and covers the cell. If only a part of
    the cell is touched, the centre may be off. On a flat surface that is tilted by the angle t, a cell of half the
    width h that shows the depth p is touched only on its lower part if p < h tan t; its mean is then
    (d + h tan t)^2 / (4 h tan t), with d the depth at the centre, so that phi(q) = (sqrt(h sin t) - sqrt(p cos t))^2.
    If the surface ends on the cell at an edge, phi(q) is anything between 0 and this length. So phi(q) is taken to be
    uniform up to this length, with t the angle between the pad's normal and the gradient of phi, and its mean square, a
    third of the length's square, is added to the variance. Derivatives take it for constant. For a cell that is longer
    than wide, h is how far an ellipse of its length and width extends in the direction of the tilt.

    All cells of a pad share the error of its placement by hand and mounting: a shift of sigma_position along, and a
    rotation of sigma_rotation about, each axis, or the patch's own `misplacement`. To this is added the mean shift
    along the pad's normal that an error of alpha by the share makes. With u (6,) this misplacement in standard
    deviations, a pad's cost is the minimum over u of

        1/2 |u|^2 + 1/2 sum_i (phi(q_i(u)) / sigma_i)^2

    over the cells that are pressed, and those that violate their inequality. If all are pressed by one flat surface,
    this is exactly the negative log likelihood with u marginalised, up to a constant; for an inequality it bounds the
    negative log of the probability that noise explains it (Chernoff). Without u the many cells of a pad would count
    their common error as many times, and an edge that is off by a millimetre would count once for each cell. If a pad
    costs more than 30, which no noise explains, only one step is made toward u: the cost is then an upper bound.
    """

    def __init__(
        self,
        grid: DistanceGrid,
        patches: Sequence[Patch],
        *,
        sigma_depth: float,
        share: float,
        sigma_position: float,
        sigma_rotation: float,
    ) -> None:
        pads = [_pad_cells(patch, sigma_depth, share) for patch in patches]
        points, normals, traits = (
            np.concatenate([np.empty((0, width)), *(pad[i] for pad in pads)]) for i, width in enumerate([3, 3, 4])
        )
        starts = np.cumsum([0, *(len(pad[1]) for pad in pads)], dtype=np.uintp)
        middles = np.array([patch.p_PT.mean(axis=0) for patch in patches]).reshape(-1, 3)
        if any(patch.misplacement is not None for patch in patches):  # Expressed in units of the sigmas, too.
            sigma_rotation, sigma_position = max(sigma_rotation, _LEAST_TURN), max(sigma_position, _LEAST_SHIFT)
        units = np.repeat([sigma_rotation, sigma_position], 3)
        excess = np.array([_excess(patch, units, share) for patch in patches]).reshape(-1, 6, 6)
        stretches = np.array([patch.stretch for patch in patches]).reshape(-1, 3)
        self._arguments = (
            grid.nodes,
            Pads(*map(read_only, (points, normals, traits, starts, middles, excess, stretches))),
            (sigma_rotation, sigma_position),
        )
        self._pads, self._rows = len(pads), len(points) + 6 * len(pads)

    def cost(self, X_PO: FloatArray) -> FloatArray:
        """Costs (B,) of poses (B, 3, 4)."""
        cost: FloatArray = self.pad_costs(X_PO).sum(axis=1)
        return cost

    def pad_costs(self, X_PO: FloatArray) -> FloatArray:
        """Costs (B, k) of each of k pads at poses (B, 3, 4)."""
        costs = np.empty((len(X_PO), self._pads))
        patch_kernels.patch_costs(*self._arguments, pose_batch(X_PO), costs)
        return costs

    def residuals(self, X_PO: FloatArray) -> FloatArray:
        """Residuals (B, n + 6 k) of poses (B, 3, 4): those of n live cells, then the misplacements u in P of k pads."""
        return self.residuals_and_jacobian(X_PO)[0]

    def residuals_and_jacobian(self, X_PO: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Residuals (B, n + 6 k) and their derivatives by the increment (B, n + 6 k, 6).

        The derivative of u by the pose is the Gauss-Newton approximation, exact where the residuals vanish; it does not
        enter the cost's gradient, because u minimises the cost.
        """
        residuals, jacobian = np.empty((len(X_PO), self._rows)), np.empty((len(X_PO), self._rows, 6))
        patch_kernels.patch_residuals(*self._arguments, pose_batch(X_PO), residuals, jacobian)
        return residuals, jacobian

    def normal_equations(self, X_PO: FloatArray) -> NormalEquations:
        """Cost, gradient, and the Gauss-Newton Hessian along the smooth normals, at poses (B, 3, 4)."""
        count = len(X_PO)
        equations = NormalEquations(np.empty(count), np.empty((count, 6)), np.empty((count, 6, 6)))
        patch_kernels.patch_normal_equations(*self._arguments, pose_batch(X_PO), *equations)
        return equations


class PatchContact(SumObjective):
    """Tactile pads against the object: all cells against its distance, and the normal of each pad that feels it.

    The distances alone do not distinguish the two sides of a thin wall. So the surface's normal at a patch's centroid
    is expected where the pad's normal points into the finger, up to the angles at which a pad may be tilted on a
    surface; pads whose cells face all directions have no such term.
    """

    def __init__(
        self,
        grid: DistanceGrid,
        patches: Sequence[Patch],
        *,
        sigma_depth: float = SIGMA_DEPTH,
        share: float = SHARE,
        sigma_position: float = 0.0009,
        sigma_rotation: float = math.radians(5.0),
        sigma_lean: float = math.radians(30.0),
    ) -> None:
        """Takes the patches in P.

        Args:
            grid: of the object.
            patches: what the pads feel.
            sigma_depth: standard deviation of the depth of the surface in a pad, of each cell, m.
            share: standard deviation of a depth as a share of it: of alpha, and of the layer's linearity.
            sigma_position: standard deviation of each coordinate of a pad's position, including the effect of alpha, m;
                for patches whose `misplacement` is not known.
            sigma_rotation: standard deviation of a small rotation of a pad about each axis, rad; for the same.
            sigma_lean: standard deviation of the turn of a touched surface from the pad about each axis, rad.

        Raises:
            InvalidInputError: a number out of range.
        """
        cells = PatchCells(
            grid,
            patches,
            sigma_depth=positive_number("sigma_depth", sigma_depth),
            share=positive_number("share", share, allow_zero=True),
            sigma_position=positive_number("sigma_position", sigma_position, allow_zero=True),
            sigma_rotation=positive_number("sigma_rotation", sigma_rotation, allow_zero=True),
        )
        facing = [patch for patch in patches if np.isfinite(patch.inward).all()]
        faces = Contacts(
            np.array([patch.centroid for patch in facing]).reshape(-1, 3),
            np.array([patch.inward for patch in facing]).reshape(-1, 3),
            sigma_normal=positive_number("sigma_lean", sigma_lean),
        ).with_arrays(sigma_position=np.full(len(facing), _ANYWHERE))
        self._cells, self._faces = cells, SurfaceContact(grid, faces)
        self._facing = np.array([np.isfinite(patch.inward).all() for patch in patches], dtype=np.bool_)
        super().__init__([self._cells, self._faces])

    def pad_costs(self, X_PO: FloatArray) -> FloatArray:
        """Costs (B, k) of each of k pads at poses (B, 3, 4), whose sum is the cost."""
        costs = self._cells.pad_costs(X_PO)
        faces = self._faces.residuals(X_PO).reshape(len(X_PO), np.count_nonzero(self._facing), 5)
        costs[:, self._facing] += 0.5 * np.sum(faces**2, axis=2)
        return costs


def _pad_cells(patch: Patch, sigma_depth: float, share: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The points (n, 3), normals (n, 3) and traits (n, 4) of a pad's live cells, see `patch_kernels`."""
    live = ~patch.dead
    depth = patch.alpha * np.maximum(patch.pressure[live], patch.threshold)
    points = patch.p_PT[live] - depth[:, None] * patch.n_PT[live]
    sides = np.where(patch.saturated[live], 1.0, np.where(patch.active[live], 0.0, -1.0))
    weights, widths = 1.0 / np.hypot(sigma_depth, share * depth), np.full(len(depth), patch.half_pitch)
    return points, patch.n_PT[live], np.stack([sides, weights, depth, widths], axis=1)


def _excess(patch: Patch, units: FloatArray, share: float) -> FloatArray:
    """Information on a pad's (rotation, shift), in these units (6,), minus the identity, shape (6, 6)."""
    if patch.misplacement is None:
        return np.zeros((6, 6))
    turn_first = np.roll(patch.misplacement, 3, axis=(0, 1))
    least = np.repeat([_LEAST_TURN, _LEAST_SHIFT], 3)
    scaled = (turn_first + np.diag(least**2) + _by_alpha(patch, share)) / np.outer(units, units)
    information = np.linalg.inv(scaled)
    excess: FloatArray = 0.5 * (information + information.T) - np.eye(6)
    return excess


def _by_alpha(patch: Patch, share: float) -> FloatArray:
    """The covariance of a pad's (rotation, shift) due to an error of alpha by this share, shape (6, 6), rad and m."""
    if np.isnan(patch.inward).any():
        return np.zeros((6, 6))
    depth = share * patch.alpha * float(patch.pressure[patch.active].mean())
    shift = np.concatenate([np.zeros(3), depth * patch.inward])
    return np.outer(shift, shift)
