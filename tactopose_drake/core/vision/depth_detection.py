"""Detects a known object in a depth image without prior knowledge, except which pixels belong to the hand.

Evenly spread orientations are each placed at the points seen and fitted to them, and the best of these are refined by
the tracker. Poses are ranked by how well their own depth image agrees with the picture: places where the object should
be seen and is not, and where something is seen that it does not explain, count against a pose.

Many objects look similar upside down, or turned about an axis, like a mug whose handle is hidden. So the best pose is
also tried upside down and turned, until nothing improves.
"""

import math

import numpy as np

from tactopose_drake.core.poses import (
    compose,
    exp_so3,
    make_poses,
    random_rotations,
    retract,
    transform_points,
)
from tactopose_drake.core.posterior.moved_origin import has_far_origin
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import FloatArray
from tactopose_drake.core.vision.depth_pictures import DepthPicture, fit_to_picture
from tactopose_drake.core.vision.depth_tracking import (
    DepthTrackerModel,
    TrackedPose,
    fit_pose,
    residuals,
)

_ORIENTATIONS = 400  # number of orientations tried; any is within some 25 degrees of one of them
_STEPS = 10  # of each fit
_POINTS = 200  # used by these fits
_REFINED = 24  # number of the best that the tracker refines
_TURNS = 12  # rotations about each axis of the box of the best one, and the same upside down
_ROUNDS = 3  # most rounds of turning the best one
_BETTER = 1e-5  # least improvement of the best one's agreement for another round, m
# Prior covariance of the object: rad about each axis and m along each.
_ANYWHERE = np.diag(np.repeat([math.pi, 1.0], 3) ** 2)


def find_poses(picture: DepthPicture, object_model: ObjectModel, model: DepthTrackerModel) -> list[TrackedPose]:
    """Finds poses of the object, those that agree best with a picture first; none if too few points are seen.

    Everything that is seen, except the hand if the picture knows it, is taken for the object.

    Args:
        picture: the depth image.
        object_model: the object.
        model: how the tracker fits.
    """
    if has_far_origin(object_model):
        return [fit.of_frame_at(-object_model.middle) for fit in find_poses(picture, object_model.about_middle, model)]
    points = picture.points(without_hand=True)
    if len(points) < model.least_pixels:
        return []
    few = points[np.linspace(0, len(points) - 1, min(len(points), _POINTS)).astype(int)]
    found = _refined(picture, object_model, _roughly_fitted(few, object_model, _starts(few, object_model)), model)
    for _ in range(_ROUNDS):
        if not found:
            break
        best = found[0]
        turned = _roughly_fitted(few, object_model, compose(best.X_CO[None], _turns(object_model)))
        found = _in_order([*found, *_refined(picture, object_model, turned, model)])
        if found[0].disagreement > best.disagreement - _BETTER:
            break
    return found


def _starts(points: FloatArray, object_model: ObjectModel) -> FloatArray:
    """Start poses (B, 3, 4) with random orientations, at which the visible side is at the centroid of the points."""
    starts = make_poses(random_rotations(np.random.default_rng(0), _ORIENTATIONS), np.zeros((_ORIENTATIONS, 3)))
    samples = object_model.samples
    facing = starts[:, 2, :3] @ samples.normals.T < 0.0
    seen = transform_points(starts, samples.points)
    starts[:, :, 3] = points.mean(axis=0) - np.einsum("bni,bn->bi", seen, facing / facing.sum(axis=1, keepdims=True))
    return starts


def _turns(object_model: ObjectModel) -> FloatArray:
    """Rotations about the axes of the object's box, upright and upside down, X_OO' (6 * _TURNS, 3, 4)."""
    angles = np.linspace(0.0, 2.0 * math.pi, _TURNS, endpoint=False)
    spins = exp_so3((angles[:, None, None] * np.eye(3)).reshape(-1, 3)).reshape(_TURNS, 3, 3, 3)
    flips = exp_so3(math.pi * np.eye(3)[[1, 2, 0]])
    R_OT = np.concatenate([spins, flips @ spins]).reshape(-1, 3, 3)
    return make_poses(R_OT, object_model.middle - R_OT @ object_model.middle)


def _roughly_fitted(points: FloatArray, object_model: ObjectModel, X_CO: FloatArray) -> FloatArray:
    """Poses (B, 3, 4) after some robust Gauss-Newton steps from starts (B, 3, 4)."""
    poses, width, ridge = X_CO, 0.02, np.diag(np.repeat([1e-3, 1.0], 3))
    for _ in range(_STEPS):
        distance, J = residuals(points, object_model, poses)
        weighted = np.swapaxes(J / (1.0 + (distance / width) ** 2)[:, :, None], 1, 2)
        step = -np.linalg.solve(weighted @ J + ridge, weighted @ distance[:, :, None])[:, :, 0]
        step *= np.minimum(1.0, 0.5 / np.maximum(np.linalg.norm(step[:, :3], axis=1), 1e-9))[:, None]
        poses, width = retract(poses, np.asarray(step, dtype=np.float64)), max(0.7 * width, 0.003)
    return poses


def _refined(
    picture: DepthPicture, object_model: ObjectModel, X_CO: FloatArray, model: DepthTrackerModel
) -> list[TrackedPose]:
    """The tracker's fits from the best of poses (B, 3, 4), ranked."""
    order = np.argsort([fit_to_picture(picture, object_model, X).disagreement for X in X_CO])
    fits = [fit_pose(picture, object_model, X, _ANYWHERE, model) for X in X_CO[order[:_REFINED]]]
    return _in_order([fit for fit in fits if fit is not None])


def _in_order(found: list[TrackedPose]) -> list[TrackedPose]:
    return sorted(found, key=lambda fit: fit.disagreement)
