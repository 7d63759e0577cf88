"""Objects whose frame has its origin far away, as scans have that were never moved to theirs.

A small turn about such an origin moves the whole object, so that turns and shifts can hardly be told apart, neither by
numbers nor by people. The search takes its increments about the object's middle C then; what it finds is reported for
the file's own frame O all the same.
"""

import dataclasses
import math

import numpy as np
from pydrake.math import RigidTransform

from tactopose_drake.core.evidence.gaussian_prior import GaussianPrior
from tactopose_drake.core.poses import exp_so3, skew
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import FloatArray
from tactopose_drake.estimation.prior import PosePrior
from tactopose_drake.estimation.results import PoseEstimate, PoseHypothesis

_FAR = 1.0  # from the origin to the object's middle, in its sizes
# Draws of three standard normal numbers, each with its opposite, whose covariance is exactly the identity.
_DRAWN = np.random.default_rng(0).standard_normal((200, 3))
_NORMAL = np.concatenate([_DRAWN, -_DRAWN]) @ np.linalg.inv(np.linalg.cholesky(_DRAWN.T @ _DRAWN / len(_DRAWN))).T


def has_far_origin(model: ObjectModel) -> bool:
    """Whether the object is farther from its frame's origin than it is large."""
    return math.hypot(*model.middle.tolist()) > _FAR * model.size


def prior_about_middle(prior: GaussianPrior | None, p_OC: FloatArray) -> PosePrior | None:
    """The prior of C's pose: its sigmas are taken for those of the object's middle."""
    if prior is None:
        return None
    return PosePrior(
        RigidTransform(pose=prior.mean) @ RigidTransform(p_OC), prior.sigma_translation, prior.sigma_rotation
    )


def reported_for_origin(estimate: PoseEstimate, p_OC: FloatArray) -> PoseEstimate:
    """An estimate of the pose of C, which is at p_OC, shape (3,), m, with O's axes, as one of O's."""
    hypotheses = tuple(_of_origin(hypothesis, p_OC) for hypothesis in estimate.hypotheses)
    return dataclasses.replace(estimate, hypotheses=hypotheses)


def about_middle(hypothesis: PoseHypothesis, model: ObjectModel) -> PoseHypothesis:
    """The hypothesis of the pose of the object's middle, where its origin is far away; otherwise itself.

    That is what people mean by how far an object may be off, and what of its pose is not determined.
    """
    if not has_far_origin(model):
        return hypothesis
    straight = hypothesis.covariance - _bend(hypothesis, model.middle)
    return _moved(hypothesis, -model.middle, straight)


def _of_origin(hypothesis: PoseHypothesis, p_OC: FloatArray) -> PoseHypothesis:
    moved = _moved(hypothesis, p_OC, hypothesis.covariance)
    return dataclasses.replace(moved, covariance=moved.covariance + _bend(moved, p_OC))


def _bend(hypothesis: PoseHypothesis, p_OC: FloatArray) -> FloatArray:
    """What the arc of O about C adds to the covariance (6, 6) of O's pose: centimetres by turns of some degrees.

    It is the mean product of what is left of R exp(w) p_OC beside its part that is linear in w.
    """
    w = _NORMAL @ np.linalg.cholesky(hypothesis.covariance[:3, :3]).T
    left = (exp_so3(w) @ p_OC - p_OC - np.cross(w, p_OC)) @ hypothesis.X_PO.rotation().matrix().T
    bend = np.zeros((6, 6))
    bend[3:, 3:] = left.T @ left / len(left)
    return bend


def _moved(hypothesis: PoseHypothesis, p_OC: FloatArray, covariance: FloatArray) -> PoseHypothesis:
    """The hypothesis of O's pose by that of C's, with what is linear in the increments."""
    # p_PO = p_PC - R p_OC, so with R exp(w) its increment is v_O = v_C + R [p_OC]x w.
    J = np.eye(6)
    J[3:, :3] = hypothesis.X_PO.rotation().matrix() @ skew(p_OC)
    free = hypothesis.free_directions @ J.T
    if len(free):
        free = np.linalg.qr(free.T)[0].T
    return dataclasses.replace(
        hypothesis,
        X_PO=hypothesis.X_PO @ RigidTransform(-p_OC),
        covariance=J @ covariance @ J.T,
        free_directions=free,
    )
