"""Descent on contacts with the distance field, robust or not, with an optional prior and hand, in one compiled loop."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from tactopose_drake.core.compilation import read_only
from tactopose_drake.core.geometry_checks import pose_batch
from tactopose_drake.core.kernels.contact_mixture_kernels import Doubts
from tactopose_drake.core.kernels.descent_kernels import Ends, descend
from tactopose_drake.core.kernels.grid_kernels import Grid
from tactopose_drake.core.kernels.hand_sphere_kernels import NO_SPHERES, Spheres
from tactopose_drake.core.kernels.least_squares_kernels import DescentRule
from tactopose_drake.core.kernels.prior_kernels import Prior
from tactopose_drake.core.kernels.surface_contact_kernels import WeightedContacts, contact_costs
from tactopose_drake.core.objectives.objective import Descent, NormalEquations, SmoothObjective
from tactopose_drake.core.objectives.pose_prior import NO_PRIOR
from tactopose_drake.core.validation import FloatArray

_NO_INTEGERS, _NO_NUMBERS, _NO_ODDS = map(read_only, (np.empty(0, dtype=np.int64), np.empty(0), np.empty((2, 0))))
NO_DOUBTS = Doubts(
    _NO_INTEGERS,
    _NO_INTEGERS,
    _NO_NUMBERS,
    _NO_NUMBERS,
    _NO_NUMBERS,
    _NO_ODDS,
    _NO_ODDS,
    _NO_ODDS,
    _NO_ODDS,
    _NO_NUMBERS,
    False,
)
"""What kernels read for contacts that are all taken as told."""

_STANDING = DescentRule(0, 0.0, 0.0, 0.0, 0.0)


class CompiledDescent(NamedTuple):
    """The arguments of the compiled loop.

    If it is `trimmed`, contacts are taken as told, except the one that fits a pose worst at the start: it is ignored.
    """

    grid: Grid
    touch: WeightedContacts
    prior: Prior = NO_PRIOR
    doubts: Doubts = NO_DOUBTS
    hand: Spheres = NO_SPHERES
    trimmed: bool = False

    def cost_as_told(self, X_PO: FloatArray) -> FloatArray:
        """Costs (B,) of poses (B, 3, 4) with all contacts as told and the prior, without the hand's volume."""
        cost = np.empty(len(X_PO))
        contact_costs(self.grid, self.touch, self.prior, pose_batch(X_PO), cost)
        return cost

    def normal_equations(self, X_PO: FloatArray) -> NormalEquations:
        """Cost, exact gradient and Gauss-Newton Hessian at poses (B, 3, 4)."""
        ends = self._run(_STANDING, np.array(pose_batch(X_PO)))
        return NormalEquations(ends.cost, ends.gradient, ends.hessian)

    def descend(self, rule: DescentRule, X_PO: FloatArray) -> Descent:
        """Levenberg-Marquardt from each of the poses (B, 3, 4)."""
        X_PO = np.array(pose_batch(X_PO))
        ends = self._run(rule, X_PO)
        return Descent(X_PO, ends.cost, ends.iterations, ends.converged, ends.hessian)

    def _run(self, rule: DescentRule, X_PO: FloatArray) -> Ends:
        """Runs the kernel, which moves the poses in place."""
        count = len(X_PO)
        ends = Ends(
            np.empty(count),
            np.empty((count, 6)),
            np.empty((count, 6, 6)),
            np.empty(count, dtype=np.int64),
            np.empty(count, dtype=np.bool_),
        )
        descend(self.grid, self.touch, self.doubts, self.prior, self.hand, rule, self.trimmed, X_PO, ends)
        return ends


class CompiledObjective(SmoothObjective):
    """Base class of objectives whose derivatives and descents are those of the compiled loop with their arguments."""

    _compiled: CompiledDescent

    def normal_equations(self, X_PO: FloatArray) -> NormalEquations:
        """Cost, exact gradient, and the Gauss-Newton Hessian along the smooth normals, at poses (B, 3, 4)."""
        return self._compiled.normal_equations(X_PO)

    @property
    def descent(self) -> Callable[[DescentRule, FloatArray], Descent]:
        """Levenberg-Marquardt from each of the poses (B, 3, 4) in one compiled loop."""
        return self._compiled.descend
