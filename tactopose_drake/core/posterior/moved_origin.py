"""Poses of one frame of an object by those of another, with the same axes, as of one whose origin is far away.

A small turn about an origin that is far away moves the whole object, so that turns and shifts can hardly be told apart,
neither by numbers nor by people. Then everything is computed for a frame C at the object's middle, and what is found is
said of the object's own frame O.
"""

import dataclasses
import math

import numpy as np

from tactopose_drake.core.evidence.gaussian_prior import GaussianPrior
from tactopose_drake.core.poses import exp_so3, skew
from tactopose_drake.core.posterior.gaussian_mixture import GaussianMixture
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import FloatArray

_FAR = 1.0  # from the origin to the object's middle, in its sizes
# Draws of three standard normal numbers, each with its opposite, whose covariance is exactly the identity.
_DRAWN = np.random.default_rng(0).standard_normal((200, 3))
_NORMAL = np.concatenate([_DRAWN, -_DRAWN]) @ np.linalg.inv(np.linalg.cholesky(_DRAWN.T @ _DRAWN / len(_DRAWN))).T


def has_far_origin(model: ObjectModel) -> bool:
    """Whether the object is farther from its frame's origin than it is large."""
    return math.hypot(*model.middle.tolist()) > _FAR * model.size


def move_origin(X_PO: FloatArray, p_OC: FloatArray) -> FloatArray:
    """Poses (n, 3, 4) of the frame at p_OC, shape (3,), m, by those of O."""
    return np.concatenate([X_PO[..., :3], X_PO[..., :3] @ p_OC[:, None] + X_PO[..., 3:]], axis=-1)


def prior_of_middle(prior: GaussianPrior, p_OC: FloatArray) -> GaussianPrior:
    """The prior of the pose of C, which is at p_OC, shape (3,), m: its sigmas are taken for those of the middle."""
    return GaussianPrior(move_origin(prior.mean, p_OC), prior.sigma_translation, prior.sigma_rotation)


def increments_of_origin(R_PO: FloatArray, p_OC: FloatArray) -> FloatArray:
    """Matrices (n, 6, 6) that give the increments (w, v) of O's poses by those of C's, at rotations (n, 3, 3).

    As p_PO = p_PC - R p_OC, so with R exp(w) the increment is v_O = v_C + R [p_OC]x w.
    """
    J = np.tile(np.eye(6), (len(R_PO), 1, 1))
    J[:, 3:, :3] = R_PO @ skew(p_OC)
    return J


def arc_covariance(R_PO: FloatArray, covariance: FloatArray, p_OC: FloatArray) -> FloatArray:
    """What the arc of O about C adds to the covariances (n, 6, 6) of O's poses: centimetres by turns of some degrees.

    It is the mean product of what is left of R exp(w) p_OC beside its part that is linear in w.

    Args:
        R_PO: rotations, shape (n, 3, 3).
        covariance: of their increments, shape (n, 6, 6).
        p_OC: where C is, shape (3,), m.
    """
    w = _NORMAL @ np.swapaxes(np.linalg.cholesky(covariance[:, :3, :3]), 1, 2)
    left = (exp_so3(w) @ p_OC - p_OC - np.cross(w, p_OC)) @ np.swapaxes(R_PO, 1, 2)
    added = np.zeros((len(R_PO), 6, 6))
    added[:, 3:, 3:] = np.swapaxes(left, 1, 2) @ left / left.shape[1]
    return added


def mixture_of_origin(mixture: GaussianMixture, p_OC: FloatArray) -> GaussianMixture:
    """A mixture over poses of O by one over those of C, which is at p_OC, shape (3,), m."""
    R = mixture.X_PO[:, :, :3]
    J = increments_of_origin(R, p_OC)
    covariance = J @ mixture.covariance @ np.swapaxes(J, 1, 2) + arc_covariance(R, mixture.covariance, p_OC)
    return dataclasses.replace(mixture, X_PO=move_origin(mixture.X_PO, -p_OC), covariance=covariance)


def mixture_of_middle(mixture: GaussianMixture, p_OC: FloatArray) -> GaussianMixture:
    """A mixture over poses of C, which is at p_OC, shape (3,), m, by one over those of O."""
    R = mixture.X_PO[:, :, :3]
    J = increments_of_origin(R, -p_OC)
    # Of a belief that leaves the arc out no more is taken off than there is.
    left = mixture.covariance - arc_covariance(R, mixture.covariance, p_OC)
    values, vectors = np.linalg.eigh(J @ left @ np.swapaxes(J, 1, 2))
    covariance = vectors * np.maximum(values, 0.0)[:, None] @ np.swapaxes(vectors, 1, 2)
    return dataclasses.replace(mixture, X_PO=move_origin(mixture.X_PO, p_OC), covariance=covariance)


def about_middle(model: ObjectModel, mixture: GaussianMixture) -> tuple[ObjectModel, GaussianMixture]:
    """The same object in a frame near it, and the same belief of its pose, where its origin is far away."""
    if not has_far_origin(model):
        return model, mixture
    return model.about_middle, mixture_of_middle(mixture, model.middle)
