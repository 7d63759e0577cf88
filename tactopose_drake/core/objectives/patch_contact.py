"""Patches against the signed distance grid, cell by cell: the form that is fast, smooth and a likelihood."""

import math
from collections.abc import Sequence

import numpy as np

from tactopose_drake.core.compilation import read_only
from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.kernels import patch_kernels
from tactopose_drake.core.kernels.pad_kernels import Pads
from tactopose_drake.core.objectives.objective import LeastSquaresObjective, NormalEquations, SumObjective
from tactopose_drake.core.objectives.surface_contact import SurfaceContact
from tactopose_drake.core.sensing.patches import Patch
from tactopose_drake.core.shape.signed_distance import DistanceGrid
from tactopose_drake.core.validation import FloatArray, positive_number

# The standard deviation of a position that is to say nothing, m.
_ANYWHERE = 1e3
# What every pad may be off by in addition to a covariance that says less, perhaps nothing in some directions: rad, m.
_LEAST_TURN, _LEAST_SHIFT = 1e-4, 1e-5


class PatchCells(LeastSquaresObjective):
    """What every cell of the pads says of the signed distance phi of the object.

    A cell that feels the pressure p has the surface where it is pressed in: phi(q) = 0 at its point, alpha p below the
    undeformed pad. A cell that feels none has at most the threshold's depth: phi(q) >= 0 there; a saturated one at
    least the depth that it shows: phi(q) <= 0. A dead cell says nothing.

    The noise: each depth is off by a Gaussian of sigma_depth and of a share of itself, independent of the others. A
    cell feels the mean over its area, which is the depth at its middle where the surface is flat and covers the cell.
    Where only a part of the cell is touched, the middle may be off. Of a flat surface that leans by the angle t, a cell
    of half the width h that shows the depth p feels only the lower part if p < h tan t; its mean is then
    (d + h tan t)^2 / (4 h tan t), with d the depth at the middle, so that phi(q) = (sqrt(h sin t) - sqrt(p cos t))^2.
    Where the surface ends on the cell at an edge, phi(q) is anything between 0 and that. So this length, with the angle
    between the pad's normal and the gradient of phi, is where an even distribution ends; its mean square, a third of
    the length's, adds to the variance. Derivatives take it for constant. Of a cell that is longer than wide, h is how
    far an ellipse of its length and width reaches along the lean.

    All cells of a pad are off together, because hand and mounting misplace it: shifted by sigma_position along, and
    turned by sigma_rotation about, each axis, or as the patch's own `misplacement` says. To that comes what an alpha
    that is off by the share moves all pressed cells by, on average, along the pad's normal. With u (6,) this
    misplacement in standard deviations, a pad's cost is the least over u of

        1/2 |u|^2 + 1/2 sum_i (phi(q_i(u)) / sigma_i)^2

    over the cells that count: those pressed, and those that contradict their inequality. Where all are pressed by one
    flat surface that is exactly the negative log of the likelihood with u integrated out, up to a constant; for an
    inequality it bounds the negative log of the probability that noise explains it (Chernoff). Without u the many cells
    of a pad would outvote the error that they share, and an edge that is off by a millimetre would count once a cell.
    Where a pad costs more than 30, which no noise explains, u is sought for one step only: the cost is an upper bound.
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
        if any(patch.misplacement is not None for patch in patches):  # These are in units of the sigmas, too.
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
        patch_kernels.patch_costs(*self._arguments, np.ascontiguousarray(X_PO), costs)
        return costs

    def residuals(self, X_PO: FloatArray) -> FloatArray:
        """Residuals (B, n + 6 k) of poses (B, 3, 4): of n live cells, then the misplacements u in P of k pads."""
        return self.residuals_and_jacobian(X_PO)[0]

    def residuals_and_jacobian(self, X_PO: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Residuals (B, n + 6 k) and their derivatives by the increment (B, n + 6 k, 6).

        How u follows the pose is Gauss and Newton's approximation, exact where the residuals vanish; it does not enter
        the cost's gradient, because u minimises the cost.
        """
        residuals, jacobian = np.empty((len(X_PO), self._rows)), np.empty((len(X_PO), self._rows, 6))
        patch_kernels.patch_residuals(*self._arguments, np.ascontiguousarray(X_PO), residuals, jacobian)
        return residuals, jacobian

    def normal_equations(self, X_PO: FloatArray) -> NormalEquations:
        """Cost, gradient, and the Gauss-Newton Hessian along the smooth normals, at poses (B, 3, 4)."""
        count = len(X_PO)
        equations = NormalEquations(np.empty(count), np.empty((count, 6)), np.empty((count, 6, 6)))
        patch_kernels.patch_normal_equations(*self._arguments, np.ascontiguousarray(X_PO), *equations)
        return equations


class PatchContact(SumObjective):
    """What tactile pads say of the object: every cell of its distance, and each pad that feels it, that it faces it.

    The distances alone do not tell the two sides of a thin wall apart. So the surface's normal at a patch's centroid is
    expected where the pad's normal points into the finger, within the angles at which a pad may lean on a surface; of
    cells that look every way, nowhere.
    """

    def __init__(
        self,
        grid: DistanceGrid,
        patches: Sequence[Patch],
        *,
        sigma_depth: float = 0.0005,
        share: float = 0.2,
        sigma_position: float = 0.0009,
        sigma_rotation: float = math.radians(5.0),
        sigma_lean: float = math.radians(30.0),
    ) -> None:
        """Takes the patches in P.

        Args:
            grid: of the object.
            patches: what the pads feel.
            sigma_depth: standard deviation of the depth of the surface in a pad, of each cell, m.
            share: standard deviation of a depth as a share of it: alpha, and the layer, are not quite so.
            sigma_position: standard deviation of each coordinate of a pad's place, and of what alpha makes of it, m; of
                patches whose `misplacement` is not known.
            sigma_rotation: standard deviation of a small turn of a pad about each axis, rad; likewise.
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
    """By how much the information on a pad's (turn, shift), in these units (6,), exceeds the identity, shape (6, 6)."""
    if patch.misplacement is None:
        return np.zeros((6, 6))
    turn_first = np.roll(patch.misplacement, 3, axis=(0, 1))
    least = np.repeat([_LEAST_TURN, _LEAST_SHIFT], 3)
    scaled = (turn_first + np.diag(least**2) + _by_alpha(patch, share)) / np.outer(units, units)
    information = np.linalg.inv(scaled)
    excess: FloatArray = 0.5 * (information + information.T) - np.eye(6)
    return excess


def _by_alpha(patch: Patch, share: float) -> FloatArray:
    """The covariance of (turn, shift) that an alpha off by this share amounts to, shape (6, 6), rad and m."""
    if np.isnan(patch.inward).any():
        return np.zeros((6, 6))
    depth = share * patch.alpha * float(patch.pressure[patch.active].mean())
    shift = np.concatenate([np.zeros(3), depth * patch.inward])
    return np.outer(shift, shift)
