"""Where the axis of a held object is, as far as the hypotheses of its pose say so."""

from dataclasses import dataclass

import numpy as np

from tactopose_drake.core.poses import skew
from tactopose_drake.core.validation import FloatArray


@dataclass(frozen=True, eq=False)
class HeldAxis:
    """The axis of a held object in the palm.

    Which of the object's ends is which, its slide along the axis and its spin about it are left out: a rod that two
    hypotheses hold end for end has one axis.

    Attributes:
        p_PQ: the axis' point that is nearest to the grip, shape (3,), m.
        direction: unit vector along it, shape (3,).
        sigma: standard deviation, across the axis, of its point at the distance that was asked for, m: the spread of
            the hypotheses and the covariance of each.
    """

    p_PQ: FloatArray
    direction: FloatArray
    sigma: float

    def point(self, distance: float) -> FloatArray:
        """The point at a distance from `p_PQ` along the direction, shape (3,), m."""
        end: FloatArray = self.p_PQ + distance * self.direction
        return end


def find_held_axis(
    X_PO: FloatArray,
    covariance: FloatArray,
    probability: FloatArray,
    *,
    axis: FloatArray,
    point: FloatArray,
    towards: FloatArray,
    p_PG: FloatArray,
    distance: float,
) -> HeldAxis:
    """The mean axis of n hypotheses.

    Args:
        X_PO: the hypotheses' poses, shape (n, 3, 4).
        covariance: of their increments, shape (n, 6, 6), rad and m.
        probability: shape (n,); need not add up to 1.
        axis: unit vector of the object's axis in O, shape (3,).
        point: a point of the axis in O, shape (3,), m.
        towards: direction in P into which the axis is to point, shape (3,).
        p_PG: middle of the grip, shape (3,), m.
        distance: from the point nearest to the grip to the one whose standard deviation is wanted, m.
    """
    weight = probability / probability.sum()
    direction = X_PO[:, :, :3] @ axis
    direction *= np.where(direction @ towards < 0.0, -1.0, 1.0)[:, None]
    p_PA = X_PO[:, :, :3] @ point + X_PO[:, :, 3]
    along = np.einsum("ni,ni->n", p_PG - p_PA, direction)
    near = p_PA + along[:, None] * direction
    end = near + distance * direction
    mean = weight @ direction
    mean /= np.linalg.norm(mean)
    p_PQ, p_PE = weight @ near, weight @ end

    # A point E of the object moves by dE = -R [p_OE]x w + v under an increment (w, v).
    R_PO = X_PO[:, :, :3]
    p_OE = np.einsum("nji,nj->ni", R_PO, end - X_PO[:, :, 3])
    jacobian = np.concatenate([-R_PO @ skew(p_OE), np.broadcast_to(np.eye(3), R_PO.shape)], axis=2)
    # Of three coordinates the one along the axis does not count.
    across = np.eye(3) - direction[:, :, None] * direction[:, None, :]
    spread = across @ jacobian @ covariance @ np.swapaxes(jacobian, 1, 2) @ across
    variance = np.linalg.eigvalsh(spread)[:, -1] + np.sum(np.einsum("nij,nj->ni", across, end - p_PE) ** 2, axis=1)
    return HeldAxis(p_PQ, mean, float(np.sqrt(weight @ variance)))
