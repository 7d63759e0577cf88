"""Where a known object is in a depth image, of which nothing is known but which pixels are the hand's.

Orientations that are spread evenly are each brought to the points that are seen and fitted to them; of the best, that
one wins whose own depth image agrees most with the picture: where the object should be seen and is not, and where
something is seen that it does not explain, counts against it.
"""

import dataclasses
import math

import numpy as np

from tactopose_drake.core.poses import random_rotations, retract
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import FloatArray
from tactopose_drake.core.vision.depth_pictures import DepthPicture, expected_picture
from tactopose_drake.core.vision.depth_tracking import (
    DepthTrackerModel,
    TrackedPose,
    fit_pose,
    residuals,
)

_ORIENTATIONS = 250  # that are tried; any is then within some 25 degrees of one of them
_STEPS = 6  # of each one's fit
_POINTS = 200  # that these fits use
_REFINED = 8  # of the best, which the tracker fits
_DISAGREEMENT = 0.01  # m, of depths; what differs by more counts as this
# What is known of the object before it is seen: rad about each axis and m along each.
_ANYWHERE = np.diag(np.repeat([math.pi, 1.0], 3) ** 2)


def find_pose(picture: DepthPicture, object_model: ObjectModel, model: DepthTrackerModel) -> TrackedPose | None:
    """The pose of the object that agrees best with a picture; None where too few points are seen.

    All that is seen, but for the hand, is taken for the object.

    Args:
        picture: what is seen.
        object_model: the object.
        model: how the tracker fits, which has the last word.
    """
    points = picture.points(without_hand=True)
    if len(points) < model.least_pixels:
        return None
    few = points[np.linspace(0, len(points) - 1, min(len(points), _POINTS)).astype(int)]
    middle, rotations = object_model.vertices.mean(axis=0), random_rotations(np.random.default_rng(0), _ORIENTATIONS)
    candidates = []
    for R_CO in rotations:
        start = np.column_stack([R_CO, points.mean(axis=0) - R_CO @ middle])
        seen = expected_picture(object_model, start, picture).points(without_hand=True)
        start[:, 3] += few.mean(axis=0) - seen.mean(axis=0) if len(seen) else 0.0
        X_CO = _roughly_fitted(few, object_model, start)
        candidates.append((_disagreement(picture, object_model, X_CO), X_CO))
    candidates.sort(key=lambda candidate: candidate[0])
    known = dataclasses.replace(model, knows_hand=True)
    best: tuple[float, TrackedPose | None] = (math.inf, None)
    for _, X_CO in candidates[:_REFINED]:
        fitted = fit_pose(picture, object_model, X_CO, _ANYWHERE, known)
        if fitted is not None:
            best = min(best, (_disagreement(picture, object_model, fitted.X_CO), fitted), key=lambda entry: entry[0])
    return best[1]


def _roughly_fitted(points: FloatArray, object_model: ObjectModel, X_CO: FloatArray) -> FloatArray:
    """The pose after some steps from a start."""
    pose, width, ridge = X_CO, 0.02, np.diag(np.repeat([1e-3, 1.0], 3))
    for _ in range(_STEPS):
        distance, J, _ = residuals(points, object_model, pose, math.inf)
        weight = 1.0 / (1.0 + (distance / width) ** 2)
        step = -np.linalg.solve((J * weight[:, None]).T @ J + ridge, J.T @ (weight * distance))
        step *= min(1.0, 0.5 / max(float(np.linalg.norm(step[:3])), 1e-9))
        pose, width = retract(pose[None], step[None])[0], max(0.7 * width, 0.003)
    return pose


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
