"""The axis of a held object, from the hypotheses of its pose."""

from dataclasses import dataclass

import numpy as np

from tactopose_drake.core.poses import skew
from tactopose_drake.core.validation import FloatArray


@dataclass(frozen=True, eq=False)
class HeldAxis:
    """The axis of a held object in the palm, and how far the object extends along it.

    The object's spin about the axis does not matter, and a rod that two hypotheses hold end for end has one axis.

    Attributes:
        p_PQ: the axis' point nearest to the grip, shape (3,), m.
        direction: unit vector along it, shape (3,).
        end: how far from `p_PQ` the object extends in that direction, m.
        sigma: standard deviation of its end across the axis, m, from the spread of the hypotheses and the covariance of
            each.
        sigma_end: standard deviation of `end`, m.
        same_way: probability that the object's own axis points along `direction`, rather than against it.
    """

    p_PQ: FloatArray
    direction: FloatArray
    end: float
    sigma: float = 0.0
    sigma_end: float = 0.0
    same_way: float = 1.0

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
    middle: FloatArray,
    half_length: float,
    towards: FloatArray,
    p_PG: FloatArray,
) -> HeldAxis:
    """The mean axis of n hypotheses.

    Args:
        X_PO: the hypotheses' poses, shape (n, 3, 4).
        covariance: of their increments, shape (n, 6, 6), rad and m.
        probability: shape (n,); need not add up to 1.
        axis: unit vector of the object's axis in O, shape (3,).
        middle: the point of the axis in O halfway between its ends, shape (3,), m.
        half_length: of the object along the axis, m.
        towards: direction in P into which the most probable axis is to point, shape (3,).
        p_PG: centre of the grip, shape (3,), m.
    """
    weight = probability / probability.sum()
    direction = X_PO[:, :, :3] @ axis
    # All follow the most probable one: for axes nearly across `towards`, each one's own sign would be arbitrary.
    likeliest = direction[np.argmax(weight)]
    against = direction @ (likeliest if likeliest @ towards >= 0.0 else -likeliest) < 0.0
    direction *= np.where(against, -1.0, 1.0)[:, None]
    p_PM = X_PO[:, :, :3] @ middle + X_PO[:, :, 3]
    along = np.einsum("ni,ni->n", p_PG - p_PM, direction)
    near, ends = p_PM + along[:, None] * direction, half_length - along
    distance = float(weight @ ends)
    end = near + distance * direction
    mean = weight @ direction
    mean /= np.linalg.norm(mean)
    p_PQ, p_PE = weight @ near, weight @ end

    spread = _spread(X_PO, covariance, end)
    # Relative to the point nearest to the grip, the end moves along the axis as the object does at the grip.
    at_grip = _spread(X_PO, covariance, np.broadcast_to(p_PG, end.shape))
    variance_end = np.einsum("ni,nij,nj->n", direction, at_grip, direction) + (ends - distance) ** 2
    across = np.eye(3) - direction[:, :, None] * direction[:, None, :]
    variance = np.linalg.eigvalsh(across @ spread @ across)[:, -1]
    variance += np.sum(np.einsum("nij,nj->ni", across, end - p_PE) ** 2, axis=1)
    return HeldAxis(
        p_PQ,
        mean,
        distance,
        sigma=float(np.sqrt(weight @ variance)),
        sigma_end=float(np.sqrt(weight @ variance_end)),
        same_way=float(weight @ ~against),
    )


def _spread(X_PO: FloatArray, covariance: FloatArray, p_PE: FloatArray) -> FloatArray:
    """Covariances (n, 3, 3) of the objects' points that are at p_PE (n, 3), m^2."""
    # A point E of the object moves by dE = -R [p_OE]x w + v under an increment (w, v).
    R_PO = X_PO[:, :, :3]
    p_OE = np.einsum("nji,nj->ni", R_PO, p_PE - X_PO[:, :, 3])
    jacobian = np.concatenate([-R_PO @ skew(p_OE), np.broadcast_to(np.eye(3), R_PO.shape)], axis=2)
    spread: FloatArray = jacobian @ covariance @ np.swapaxes(jacobian, 1, 2)
    return spread
