"""A model of visual pose estimation, whose error grows with the share of the object that the hand hides."""

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaincinv, ndtr

from tactopose_drake.core.evidence.gaussian_prior import GaussianPrior
from tactopose_drake.core.parameter_checks import check_numbers
from tactopose_drake.core.poses import retract
from tactopose_drake.core.validation import FloatArray, finite_array


@dataclasses.dataclass(kw_only=True, slots=True)
class VisionModel:
    """The magnitude of the error: it grows linearly with the object's hidden share, until the view is lost."""

    translation_clear: float = 0.005  # translation error when nothing is hidden, m
    translation_hidden: float = 0.036  # translation error when the view is lost, m
    rotation_clear_deg: float = 2.0  # rotation error when nothing is hidden, deg
    rotation_hidden_deg: float = 18.0  # rotation error when the view is lost, deg
    lost_share: float = 0.25  # the hidden share at which the view is lost, up to 1

    def validate(self) -> None:
        """Raises InvalidInputError if an error is not positive; a prior needs a sigma."""
        check_numbers("VisionModel", self, most={"lost_share": 1.0})


def hidden_share(p_CQ: FloatArray, n_CQ: FloatArray, p_CH: FloatArray, radius: FloatArray) -> float:
    """The share of the object's camera side that spheres hide.

    The camera side is the surface that faces the camera; self-occlusion is neglected.

    Args:
        p_CQ: points on the object's surface, spread evenly, in the camera's frame C, shape (n, 3), m.
        n_CQ: outward normals there, shape (n, 3).
        p_CH: centres of the spheres, shape (h, 3), m.
        radius: their radii, shape (h,), m.

    Returns:
        From 0 (all is visible) to 1; 0 if nothing faces the camera.
    """
    facing = np.einsum("ni,ni->n", p_CQ, n_CQ) < 0.0
    if not facing.any():
        return 0.0
    return float(np.mean(segments_hit_spheres(p_CQ[facing], p_CH, radius)))


def segments_hit_spheres(p_CQ: FloatArray, p_CH: FloatArray, radius: FloatArray) -> NDArray[np.bool_]:
    """Tests which segments from the origin of C to the points Q pass through a sphere.

    Args:
        p_CQ: end points, shape (n, 3), m.
        p_CH: centres, shape (h, 3), m.
        radius: radii, shape (h,), m.

    Returns:
        Shape (n,), bool.
    """
    length = np.linalg.norm(p_CQ, axis=1)
    direction = p_CQ / np.where(length > 0.0, length, 1.0)[:, None]
    along = np.clip(direction @ p_CH.T, 0.0, length[:, None])  # position of the segment's point nearest to the centre
    squared = np.sum(p_CH**2, axis=1) - 2.0 * along * (direction @ p_CH.T) + along**2
    hit: NDArray[np.bool_] = np.any(squared < radius**2, axis=1)
    return hit


def measure_pose(
    X_PO: FloatArray, hidden: float, normal_noise: FloatArray, model: VisionModel, stretch: float = 1.0
) -> GaussianPrior:
    """Simulates a pose from vision, given the object's true pose.

    The magnitude of the error follows from the hidden share alone, its direction is random. An error of length e in a
    random direction has a standard deviation of e / sqrt(3) along each axis, which is that of the prior.

    Args:
        X_PO: true pose in the palm frame, shape (3, 4).
        hidden: the hidden share, 0 to 1.
        normal_noise: standard normal numbers, shape (6,): directions of the rotation (in O) and the translation (in P).
        model: magnitude of the error, valid.
        stretch: factor by which this error is larger than the prior states, see `tail_stretch`.
    """
    lost = min(hidden / model.lost_share, 1.0)
    translation = (1.0 - lost) * model.translation_clear + lost * model.translation_hidden
    rotation = math.radians((1.0 - lost) * model.rotation_clear_deg + lost * model.rotation_hidden_deg)
    increment = stretch * np.concatenate([rotation * _unit(normal_noise[:3]), translation * _unit(normal_noise[3:])])
    return GaussianPrior(
        retract(finite_array("X_PO", X_PO, (3, 4)), increment),
        sigma_translation=translation / math.sqrt(3.0),
        sigma_rotation=rotation / math.sqrt(3.0),
    )


def tail_stretch(normal_noise: float, degrees_of_freedom: float) -> float:
    """The factor that turns a Gaussian error into a Student-t one: sqrt(nu / chi-square with nu degrees of freedom).

    Args:
        normal_noise: a standard normal number, from which the chi-square one is computed.
        degrees_of_freedom: nu, > 0; the fewer, the heavier the tails.
    """
    share = float(np.clip(ndtr(normal_noise), 1e-12, 1.0))
    return math.sqrt(0.5 * degrees_of_freedom / float(gammaincinv(0.5 * degrees_of_freedom, share)))


def _unit(v: FloatArray) -> FloatArray:
    length = float(np.linalg.norm(v))
    return v / length if length > 0.0 else np.array([1.0, 0.0, 0.0])
