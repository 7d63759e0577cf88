"""When poses count as the same for a task, and how much of a belief lies about one of them."""

import dataclasses
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.parameter_checks import check_numbers
from tactopose_drake.core.poses import compose, increments_between, increments_of_images
from tactopose_drake.core.posterior.gaussian_mixture import GaussianMixture, checked_mixture
from tactopose_drake.core.posterior.moved_origin import about_middle, has_far_origin, mixture_of_origin, move_origin
from tactopose_drake.core.shape.free_spin import turn_toward
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import FloatArray

# A Gaussian in three dimensions lies within this many standard deviations with probability 95 % (root of chi-square).
_SIGMAS = 2.795
_LEAST_WEIGHT = 0.01  # of a mode that is kept besides the likeliest
_SAMPLES = 1000  # number of poses drawn from a belief


@dataclasses.dataclass(frozen=True, kw_only=True)
class Tolerance:
    """How close poses must be to count as the same.

    Attributes:
        translation: between the objects' origins, m; between their middles, if these are far from the origins.
        rotation: between their orientations, rad.

    Raises:
        InvalidInputError: a number that is not positive.
    """

    translation: float = 0.010
    rotation: float = math.radians(15.0)

    def __post_init__(self) -> None:
        check_numbers("Tolerance", self)

    @property
    def sigmas(self) -> FloatArray:
        """Standard deviations of increments (w, v) of which 95 % are within it, shape (6,), rad and m."""
        return np.repeat([self.rotation, self.translation], 3) / _SIGMAS


class Twins(NamedTuple):
    """For n poses, their symmetric images nearest to a reference.

    Attributes:
        X_PO: shape (n, 3, 4).
        increments: from the reference to them, shape (n, 6), rad and m.
        same: whether they equal the reference within a tolerance, shape (n,).
    """

    X_PO: FloatArray
    increments: FloatArray
    same: NDArray[np.bool_]


def nearest_twins(model: ObjectModel, X_PO: FloatArray, X_reference: FloatArray, tolerance: Tolerance) -> Twins:
    """For each pose (n, 3, 4), the symmetric image nearest to another pose (3, 4)."""
    if has_far_origin(model):
        p_OC = model.middle
        X_PC, X_near = move_origin(X_PO, p_OC), move_origin(X_reference, p_OC)
        found = nearest_twins(model.about_middle, X_PC, X_near, tolerance)
        X_twin = move_origin(found.X_PO, -p_OC)
        return Twins(X_twin, increments_between(X_reference, X_twin), found.same)
    twins = compose(X_PO[:, None], model.symmetry_poses[None])
    shape = twins.shape[:2]
    twins = turn_toward(twins.reshape(-1, 3, 4), X_reference, model.symmetries)
    increments = increments_between(X_reference, twins)
    translation, rotation = np.linalg.norm(increments[:, 3:], axis=1), np.linalg.norm(increments[:, :3], axis=1)
    off = np.maximum(translation / tolerance.translation, rotation / tolerance.rotation).reshape(shape)
    row, best = np.arange(len(X_PO)), off.argmin(axis=1)
    return Twins(twins.reshape(*shape, 3, 4)[row, best], increments.reshape(*shape, 6)[row, best], off[row, best] < 1.0)


def merged_modes(model: ObjectModel, belief: GaussianMixture, tolerance: Tolerance = Tolerance()) -> GaussianMixture:
    """Merges modes that are the same within a tolerance, sorts them by weight, and drops negligible ones.

    Args:
        model: the object, whose symmetric images are the same.
        belief: of its pose.
        tolerance: how close poses must be to count as the same.

    Raises:
        InvalidInputError: a belief without a mode.
    """
    belief = checked_mixture("belief", belief)
    if has_far_origin(model):
        return mixture_of_origin(merged_modes(*about_middle(model, belief), tolerance), model.middle)
    left = belief.likely(_LEAST_WEIGHT)
    left = left[np.argsort(-belief.weights[left], kind="stable")]
    poses, masses, covariances = [], [], []
    while len(left):
        X = belief.X_PO[left[0]]
        twins = nearest_twins(model, belief.X_PO[left], X, tolerance)
        members, off = left[twins.same], twins.increments[twins.same]
        J = increments_of_images(belief.X_PO[members], twins.X_PO[twins.same])
        of_twins = J @ belief.covariance[members] @ np.swapaxes(J, 1, 2)
        share = belief.weights[members] / belief.weights[members].sum()
        poses.append(X)
        masses.append(belief.weights[members].sum())
        covariances.append(np.einsum("n,nij->ij", share, of_twins) + np.einsum("n,ni,nj->ij", share, off, off))
        left = left[~twins.same]
    order = np.argsort(-np.array(masses), kind="stable")
    weights = np.array(masses)[order] / np.sum(masses)
    return GaussianMixture(np.array(poses)[order], weights, np.array(covariances)[order])


def resolved_share(model: ObjectModel, belief: GaussianMixture, tolerance: Tolerance = Tolerance()) -> float:
    """The probability that the object is within the tolerance of the pose about which most of the belief lies.

    Unlike the largest mode's weight, it is small if that mode is wide. It is computed from poses drawn from the belief.

    Args:
        model: the object, whose symmetric images are the same.
        belief: of its pose.
        tolerance: how close poses must be.

    Raises:
        InvalidInputError: a belief without a mode.
    """
    model, belief = about_middle(model, checked_mixture("belief", belief))
    drawn = belief.sample(_SAMPLES, np.random.default_rng(0))
    best = merged_modes(model, belief, tolerance).X_PO[0]
    return float(nearest_twins(model, drawn, best, tolerance).same.mean())
