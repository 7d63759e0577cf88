"""Where a known object is in a depth image, of which nothing is known but which pixels are the hand's.

Orientations that are spread evenly are each brought to the points that are seen and fitted to them; of the best, that
one wins whose own depth image agrees most with the picture: where the object should be seen and is not, and where
something is seen that it does not explain, counts against it.
"""

import math

import numpy as np

from tactopose_drake.core.poses import make_poses, random_rotations, retract, transform_points
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import FloatArray
from tactopose_drake.core.vision.depth_pictures import DepthPicture, expected_picture
from tactopose_drake.core.vision.depth_tracking import (
    DepthTrackerModel,
    TrackedPose,
    fit_pose,
)

_ORIENTATIONS = 400  # that are tried; any is then within some 25 degrees of one of them
_STEPS = 10  # of each one's fit
_POINTS = 200  # that these fits use
_REFINED = 24  # of the best, which the tracker fits
_DISAGREEMENT = 0.01  # m, of depths; what differs by more counts as this
# What is known of the object before it is seen: rad about each axis and m along each.
_ANYWHERE = np.diag(np.repeat([math.pi, 1.0], 3) ** 2)


def find_pose(picture: DepthPicture, object_model: ObjectModel, model: DepthTrackerModel) -> TrackedPose | None:
    """The pose of the object that agrees best with a picture; None where too few points are seen.

    All that is seen, but for the hand where the picture knows it, is taken for the object.

    Args:
        picture: what is seen.
        object_model: the object.
        model: how the tracker fits, which has the last word.
    """
    points = picture.points(without_hand=True)
    if len(points) < model.least_pixels:
        return None
    few = points[np.linspace(0, len(points) - 1, min(len(points), _POINTS)).astype(int)]
    starts = make_poses(random_rotations(np.random.default_rng(0), _ORIENTATIONS), np.zeros((_ORIENTATIONS, 3)))
    samples = object_model.samples
    facing = np.einsum("bij,nj->bni", starts[:, :, :3], samples.normals)[:, :, 2] < 0.0
    seen = transform_points(starts, samples.points)
    starts[:, :, 3] = few.mean(axis=0) - np.einsum("bni,bn->bi", seen, facing / facing.sum(axis=1, keepdims=True))
    fitted = _roughly_fitted(few, object_model, starts)
    order = np.argsort([_disagreement(picture, object_model, X_CO) for X_CO in fitted])
    best: tuple[float, TrackedPose | None] = (math.inf, None)
    for X_CO in fitted[order[:_REFINED]]:
        found = fit_pose(picture, object_model, X_CO, _ANYWHERE, model)
        if found is not None:
            best = min(best, (_disagreement(picture, object_model, found.X_CO), found), key=lambda entry: entry[0])
    return best[1]


def _roughly_fitted(points: FloatArray, object_model: ObjectModel, X_CO: FloatArray) -> FloatArray:
    """Poses (B, 3, 4) after some steps from starts (B, 3, 4)."""
    poses, width, ridge = X_CO, 0.02, np.diag(np.repeat([1e-3, 1.0], 3))
    for _ in range(_STEPS):
        R_CO = poses[:, :, :3]
        p_OQ = (points - poses[:, None, :, 3]) @ R_CO
        distance, n_O = object_model.grid.distance_and_normal(p_OQ.reshape(-1, 3))
        distance, n_O = distance.reshape(p_OQ.shape[:2]), n_O.reshape(p_OQ.shape)
        J = -np.concatenate([np.cross(p_OQ, n_O), n_O @ np.swapaxes(R_CO, 1, 2)], axis=2)
        weighted = np.swapaxes(J / (1.0 + (distance / width) ** 2)[:, :, None], 1, 2)
        step = -np.linalg.solve(weighted @ J + ridge, weighted @ distance[:, :, None])[:, :, 0]
        step *= np.minimum(1.0, 0.5 / np.maximum(np.linalg.norm(step[:, :3], axis=1), 1e-9))[:, None]
        poses, width = retract(poses, step), max(0.7 * width, 0.003)
    return poses


def _disagreement(picture: DepthPicture, object_model: ObjectModel, X_CO: FloatArray) -> float:
    """How far the picture and the object's own image are apart, on average over the pixels of either, m."""
    expected = expected_picture(object_model, X_CO, picture).depth
    either = (np.isfinite(expected) | np.isfinite(picture.depth)) & ~picture.hand
    if not either.any():
        return _DISAGREEMENT
    apart = np.full(int(either.sum()), _DISAGREEMENT)
    both = np.isfinite(expected[either]) & np.isfinite(picture.depth[either])
    apart[both] = np.minimum(np.abs(expected[either][both] - picture.depth[either][both]), _DISAGREEMENT)
    return float(apart.mean())
