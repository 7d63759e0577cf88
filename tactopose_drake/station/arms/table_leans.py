"""Possible leans of a held rod on a table, and the choice of the most informative one."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tactopose_drake.core.evidence.plane_contact import PlaneContact
from tactopose_drake.core.grasping.held_axis import HeldAxis
from tactopose_drake.core.objectives.plane_support import PlaneSupport
from tactopose_drake.core.poses import axes_across
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import FloatArray
from tactopose_drake.estimation.results import PoseEstimate
from tactopose_drake.station.arms.carried_hand import PlacedHand

LEAST_LEAN_DEG = 15.0
"""The smallest lean of a rod on the table that is considered, deg."""
_SIDES, _STEP = 12, np.radians(7.5)  # number of directions of leans around the rod, and step of their angles, rad
# Standard deviation of a touch that is assumed to compare leans, m.
_SIGMA = 0.0005


@dataclass(frozen=True, eq=False)
class Lean:
    """A table under a rod.

    Attributes:
        n_P: the table's normal, towards the rod, shape (3,).
        least_end: least distance of the rod's end from the grip at which the rod touches the table before the hand, m.
    """

    n_P: FloatArray
    least_end: float


def lean_ways(held: HeldAxis, hand: PlacedHand, clearance: float, most: float) -> list[Lean]:
    """Leans of a rod up to an angle, rad, each with the length that the rod needs for the hand to clear the table."""
    side, other = axes_across(held.direction)
    angles, leans = np.arange(np.radians(LEAST_LEAN_DEG), most + 1e-9, _STEP), []
    for turn in np.linspace(0.0, 2.0 * np.pi, _SIDES, endpoint=False):
        for angle in angles:
            across = np.cos(turn) * side + np.sin(turn) * other
            n_P = -np.cos(angle) * held.direction - np.sin(angle) * across
            depth = float((hand.radius - (hand.p_PH - held.p_PQ) @ n_P).max()) + clearance
            leans.append(Lean(n_P, depth / float(np.cos(angle))))
    return leans


def choose_lean(model: ObjectModel, estimate: PoseEstimate, leans: Sequence[Lean], least_end: float) -> list[Lean]:
    """The leans that are possible for a rod, the most informative first.

    Either end of the rod may be down. A lean is rated by how many standard deviations apart the rod's lowest points
    are for the two cases. If no lean is certain to be possible, as before the first touch, the one for the shortest
    rods comes first.

    Args:
        model: the rod.
        estimate: the hypotheses of its pose.
        leans: the leans to choose among.
        least_end: least possible distance of the rod's end from the grip, m.
    """
    allowed = [lean for lean in leans if lean.least_end <= least_end]
    if not allowed:
        return sorted(leans, key=lambda lean: lean.least_end)
    telling = -ends_apart(model, estimate, np.array([lean.n_P for lean in allowed]))
    return [allowed[i] for i in np.argsort(telling, kind="stable")]


def ends_apart(model: ObjectModel, estimate: PoseEstimate, n_P: FloatArray) -> FloatArray:
    """Distance between the rod's lowest points for either end down, over planes with normals (n, 3), in sigmas."""
    support = PlaneSupport(model, [PlaneContact(np.zeros(3), normal, 1.0) for normal in n_P])
    X_PO = np.array([hypothesis.X_PO.GetAsMatrix34() for hypothesis in estimate.hypotheses])
    weight = np.array([hypothesis.probability for hypothesis in estimate.hypotheses])
    height, jacobian = support.residuals_and_jacobian(X_PO)
    covariance = np.array([hypothesis.covariance for hypothesis in estimate.hypotheses])
    variance = np.einsum("bki,bij,bkj->bk", jacobian, covariance, jacobian)
    axes = X_PO[:, :, :3] @ model.symmetries[0].axis
    way = axes @ axes[0] > 0.0
    means, total = [], np.full(len(n_P), 2.0 * _SIGMA**2)
    for group in (way, ~way):
        if weight[group].sum() <= 0.0:
            return np.zeros(len(n_P))
        share = weight[group] / weight[group].sum()
        means.append(share @ height[group])
        total += share @ (variance[group] + (height[group] - means[-1]) ** 2)
    apart: FloatArray = np.abs(means[0] - means[1]) / np.sqrt(total)
    return apart
