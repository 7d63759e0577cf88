"""The likelihood of tactile pads, each of which may feel something else than the object.

As with a contact (see `contact_mixture`), a pad's cost is bounded by that of being pressed on something else, anywhere
about the object. How well something else would explain the depths of its cells is unknown; it is assumed to be as well
as a plane does, or as noise alone would, whichever is better. [HRM16]

Source: [HRM16] D. Hogg, J. Bovy, D. Lang, Data analysis recipes: fitting a model to data, 2010, section 3 (mixture for
outliers).
"""

import math
from collections.abc import Sequence

import numpy as np

from tactopose_drake.core.evidence.contact_doubt import ContactKinds
from tactopose_drake.core.evidence.patch_contacts import patch_contacts
from tactopose_drake.core.objectives.objective import NormalEquations, SmoothObjective
from tactopose_drake.core.objectives.patch_contact import SHARE, SIGMA_DEPTH, PatchContact
from tactopose_drake.core.sensing.patches import Patch
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import FloatArray

_SURROUNDINGS = 0.05  # distance from the object within which a pad on something else may be, m
# The rates of false pads are those of contacts: a displaced one counts as one on something else; a wrong normal does
# not occur, as a pad measures none of its own.
_KINDS = ContactKinds()


class PatchMixture(SmoothObjective):
    """The mixture likelihood of pads that feel the object; zero if all explain what they feel exactly."""

    def __init__(self, model: ObjectModel, pads: Sequence[Patch], outlier_probability: float) -> None:
        """Takes the pads that feel something, in P; the probability must be above 0."""
        self._pads = PatchContact(model.grid, pads)
        self._each = [PatchContact(model.grid, [pad]) for pad in pads]
        felt = patch_contacts(pads)
        sigma_p, sigma_n = np.asarray(felt.sigma_position), np.asarray(felt.sigma_normal)
        volume = float(np.prod(model.grid.upper - model.grid.origin + 2.0 * _SURROUNDINGS))
        log_any_point = np.minimum(math.log(model.area * math.sqrt(2.0 * math.pi) / volume) + np.log(sigma_p), 0.0)
        log_any_normal = np.minimum(math.log(0.5) + 2.0 * np.log(sigma_n), 0.0)
        by_shape = np.array([_shape_cost(pad) for pad in pads])
        shares = _KINDS.shares(outlier_probability).without_normals()
        self._other_cost = by_shape - math.log(shares.false / shares.as_told) - log_any_point - log_any_normal

    def cost(self, X_PO: FloatArray) -> FloatArray:
        """Costs (B,) of poses (B, 3, 4)."""
        cost: FloatArray = -np.logaddexp(-self._pads.pad_costs(X_PO), -self._other_cost).sum(axis=1)
        return cost

    def normal_equations(self, X_PO: FloatArray) -> NormalEquations:
        """Cost, gradient and Gauss-Newton Hessian at poses (B, 3, 4); each pad weighted by its inlier probability."""
        cost, gradient, hessian = np.zeros(len(X_PO)), np.zeros((len(X_PO), 6)), np.zeros((len(X_PO), 6, 6))
        for pad, other in zip(self._each, self._other_cost, strict=True):
            own = pad.normal_equations(X_PO)
            counts = _expit(other - own.cost)
            cost -= np.logaddexp(-own.cost, -other)
            gradient += counts[:, None] * own.gradient
            hessian += counts[:, None, None] * own.hessian
        return NormalEquations(cost, gradient, hessian)

    def inlier_probability(self, X_PO: FloatArray) -> FloatArray:
        """The probability that each of k pads feels the object, at poses (B, 3, 4), shape (B, k)."""
        return _expit(self._other_cost - self._pads.pad_costs(X_PO))


def _shape_cost(pad: Patch) -> float:
    """The cost of a pad's depths on something else: the residual of a plane, or the expected cost of noise if less."""
    by_noise = 0.5 * max(np.count_nonzero(pad.active) - 3.0, 0.0)
    if np.isnan(pad.inward).any():  # No plane presses cells that face all directions.
        return by_noise
    depth, points = pad.alpha * pad.pressure[pad.active], pad.points[pad.active]
    weights = 1.0 / np.hypot(SIGMA_DEPTH, SHARE * depth)
    across = np.linalg.svd(pad.inward[None])[2][1:]
    places = points - points.mean(axis=0)
    plane = np.column_stack([np.ones(len(points)), places @ across.T]) * weights[:, None]
    heights = places @ pad.inward * weights
    left = heights - plane @ np.linalg.lstsq(plane, heights)[0]
    return min(0.5 * float(left @ left), by_noise)


def _expit(x: FloatArray) -> FloatArray:
    """1 / (1 + exp(-x)), without overflow."""
    result: FloatArray = np.exp(-np.logaddexp(0.0, -x))
    return result
