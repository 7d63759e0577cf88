"""Converts poses of an object's frame O into those of a parallel frame C at its middle, for objects far from O.

A small rotation about a far origin moves the whole object, so rotations and translations can hardly be told apart,
neither numerically nor by a reader. Everything is then computed for C, and the result is expressed for O.
"""

import dataclasses
import math

import numpy as np

from tactopose_drake.core.evidence.gaussian_prior import GaussianPrior
from tactopose_drake.core.poses import exp_so3, skew
from tactopose_drake.core.posterior.gaussian_mixture import GaussianMixture
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import FloatArray

_FAR = 1.0  # distance from the origin to the object's middle, over the object's size
# Antithetic draws of three standard normal numbers, scaled so that their covariance is exactly the identity.
_DRAWN = np.random.default_rng(0).standard_normal((200, 3))
_NORMAL = np.concatenate([_DRAWN, -_DRAWN]) @ np.linalg.inv(np.linalg.cholesky(_DRAWN.T @ _DRAWN / len(_DRAWN))).T


def has_far_origin(model: ObjectModel) -> bool:
    """Whether the object's middle is farther from its frame's origin than the object is large."""
    return math.hypot(*model.middle.tolist()) > _FAR * model.size


def move_origin(X_PO: FloatArray, p_OC: FloatArray) -> FloatArray:
    """Poses (n, 3, 4) of the frame at p_OC, shape (3,), m, from those of O."""
    return np.concatenate([X_PO[..., :3], X_PO[..., :3] @ p_OC[:, None] + X_PO[..., 3:]], axis=-1)


def prior_of_middle(prior: GaussianPrior, p_OC: FloatArray) -> GaussianPrior:
    """The prior of C's pose, with C at p_OC, shape (3,), m: the sigmas are taken to be those of the middle."""
    return GaussianPrior(move_origin(prior.mean, p_OC), prior.sigma_translation, prior.sigma_rotation)


def increments_of_origin(R_PO: FloatArray, p_OC: FloatArray) -> FloatArray:
    """Jacobians (n, 6, 6) of the increments (w, v) of O's poses with respect to those of C's, at rotations (n, 3, 3).

    From p_PO = p_PC - R p_OC follows, with R exp(w), that v_O = v_C + R [p_OC]x w.
    """
    J = np.tile(np.eye(6), (len(R_PO), 1, 1))
    J[:, 3:, :3] = R_PO @ skew(p_OC)
    return J


def move_measurement(X_PO: FloatArray, covariance: FloatArray, p_OC: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The pose (3, 4) of the frame at p_OC, shape (3,), m, from that of O, and its covariance (6, 6), linearised."""
    J = increments_of_origin(X_PO[None, :, :3], -p_OC)[0]
    moved = J @ covariance @ J.T
    return move_origin(X_PO, p_OC), 0.5 * (moved + moved.T)


def arc_covariance(R_PO: FloatArray, covariance: FloatArray, p_OC: FloatArray) -> FloatArray:
    """What the curvature of O's arc about C adds to the covariances (n, 6, 6) of O: centimetres at a few degrees.

    It is the second moment of the part of R exp(w) p_OC that is nonlinear in w.

    Args:
        R_PO: rotations, shape (n, 3, 3).
        covariance: of their increments, shape (n, 6, 6).
        p_OC: where C is, shape (3,), m.
    """
    values, vectors = np.linalg.eigh(covariance[:, :3, :3])  # Some turns may be known for certain.
    w = _NORMAL @ ((vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :]) @ np.swapaxes(vectors, 1, 2))
    left = (exp_so3(w) @ p_OC - p_OC - np.cross(w, p_OC)) @ np.swapaxes(R_PO, 1, 2)
    added = np.zeros((len(R_PO), 6, 6))
    added[:, 3:, 3:] = np.swapaxes(left, 1, 2) @ left / left.shape[1]
    return added


def mixture_of_origin(mixture: GaussianMixture, p_OC: FloatArray) -> GaussianMixture:
    """A mixture over poses of O from one over those of C, which is at p_OC, shape (3,), m."""
    R = mixture.X_PO[:, :, :3]
    J = increments_of_origin(R, p_OC)
    covariance = J @ mixture.covariance @ np.swapaxes(J, 1, 2) + arc_covariance(R, mixture.covariance, p_OC)
    return dataclasses.replace(mixture, X_PO=move_origin(mixture.X_PO, -p_OC), covariance=covariance)


def mixture_of_middle(mixture: GaussianMixture, p_OC: FloatArray) -> GaussianMixture:
    """A mixture over poses of C, which is at p_OC, shape (3,), m, from one over those of O."""
    R = mixture.X_PO[:, :, :3]
    J = increments_of_origin(R, -p_OC)
    # A belief that ignores the arc may become indefinite: negative eigenvalues are clipped below.
    left = mixture.covariance - arc_covariance(R, mixture.covariance, p_OC)
    values, vectors = np.linalg.eigh(J @ left @ np.swapaxes(J, 1, 2))
    covariance = vectors * np.maximum(values, 0.0)[:, None] @ np.swapaxes(vectors, 1, 2)
    return dataclasses.replace(mixture, X_PO=move_origin(mixture.X_PO, p_OC), covariance=covariance)


def about_middle(model: ObjectModel, mixture: GaussianMixture) -> tuple[ObjectModel, GaussianMixture]:
    """The same object in a frame near it, and the same belief about its pose, if its origin is far away."""
    if not has_far_origin(model):
        return model, mixture
    return model.about_middle, mixture_of_middle(mixture, model.middle)
