"""Objects whose frame O has its origin far away, such as scans in the scanner's frame.

The search then uses increments about the object's middle C; results are still reported for the file's own frame O. See
`core.posterior.moved_origin`.
"""

import dataclasses
from collections.abc import Callable

import numpy as np
from pydrake.math import RigidTransform

from tactopose_drake.core.posterior.moved_origin import arc_covariance, has_far_origin, increments_of_origin
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import FloatArray
from tactopose_drake.estimation.pose_hypothesis import PoseHypothesis
from tactopose_drake.estimation.results import PoseEstimate


def with_near_origin(model: ObjectModel, estimate: Callable[[ObjectModel], PoseEstimate]) -> PoseEstimate:
    """Applies `estimate` to the model in a frame at its middle if its origin is far away; returns the pose of O."""
    if not has_far_origin(model):
        return estimate(model)
    found, p_OC = estimate(model.about_middle), model.middle
    return dataclasses.replace(found, hypotheses=tuple(_of_origin(each, p_OC) for each in found.hypotheses))


def about_middle(hypothesis: PoseHypothesis, model: ObjectModel) -> PoseHypothesis:
    """The hypothesis for the frame C at the object's middle if the object's origin is far away; otherwise itself.

    Standard deviations and free directions are easier to interpret about the middle.
    """
    if not has_far_origin(model):
        return hypothesis
    return _moved(hypothesis, -model.middle, hypothesis.covariance - _arc(hypothesis, model.middle))


def directions_of_origin(free: FloatArray, R_PO: FloatArray, p_OC: FloatArray) -> FloatArray:
    """Converts free directions of C's pose into those of O's, both orthonormal rows (f, 6).

    Args:
        free: free directions of C's pose.
        R_PO: rotation of both frames, shape (3, 3).
        p_OC: position of C in O, shape (3,), m.
    """
    moved: FloatArray = free @ increments_of_origin(R_PO[None], p_OC)[0].T
    return np.linalg.qr(moved.T)[0].T if len(moved) else moved


def _of_origin(hypothesis: PoseHypothesis, p_OC: FloatArray) -> PoseHypothesis:
    """Converts a hypothesis of C's pose into one of O's; C is at p_OC, shape (3,), m, with O's axes."""
    moved = _moved(hypothesis, p_OC, hypothesis.covariance)
    return dataclasses.replace(moved, covariance=moved.covariance + _arc(hypothesis, p_OC))


def _arc(hypothesis: PoseHypothesis, p_OC: FloatArray) -> FloatArray:
    arc: FloatArray = arc_covariance(hypothesis.X_PO.rotation().matrix()[None], hypothesis.covariance[None], p_OC)[0]
    return arc


def _moved(hypothesis: PoseHypothesis, p_OC: FloatArray, covariance: FloatArray) -> PoseHypothesis:
    """Converts a hypothesis of C's pose into one of O's, to first order in the increments."""
    R_PO = hypothesis.X_PO.rotation().matrix()
    J = increments_of_origin(R_PO[None], p_OC)[0]
    return dataclasses.replace(
        hypothesis,
        X_PO=hypothesis.X_PO @ RigidTransform(-p_OC),
        covariance=J @ covariance @ J.T,
        free_directions=directions_of_origin(hypothesis.free_directions, R_PO, p_OC),
    )
