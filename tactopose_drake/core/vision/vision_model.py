"""A model of visual pose estimation, whose error grows with the hidden share of the object."""

import dataclasses
import math

import numpy as np
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
