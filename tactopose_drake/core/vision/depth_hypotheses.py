"""The poses of an object that depth images leave ambiguous: detected, tracked, and summarised by pose and covariance.

A fit has only local information. A mug whose handle is hidden fits as well with the handle elsewhere, or upside down;
a tracker of a single one of these poses would be certain of it, whichever it is. So all poses that agree with the
picture about as well as the best one are tracked, and the covariance covers them.
"""

from dataclasses import dataclass

import numpy as np

from tactopose_drake.core.poses import compose, increments_between, retract
from tactopose_drake.core.posterior.moved_origin import has_far_origin, move_measurement
from tactopose_drake.core.shape.free_spin import turn_toward
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import FloatArray
from tactopose_drake.core.vision.depth_detection import find_poses
from tactopose_drake.core.vision.depth_pictures import DepthPicture
from tactopose_drake.core.vision.depth_tracking import DepthTrackerModel, TrackedPose, fit_pose

_ALIKE = 0.5  # in standard deviations of a depth: by how much less than the best one a pose may agree
_APART = np.array([0.09, 0.005])  # rad and m, from which on two poses are different
_MOST = 9  # most poses that are tracked, as some may be lost: each stands for a range of a hidden handle's angles
_SAMPLES = np.random.default_rng(0).normal(size=(64, 6))  # of each pose except the best, for the second moment


@dataclass(frozen=True, eq=False)
class TrackedPoses:
    """Poses that agree with a picture about equally well.

    Attributes:
        found: the fits, the best first.
        covariance: second moment of the increment (w, v), v in C, about the best one, with all equally probable, shape
            (6, 6), rad and m.
    """

    found: tuple[TrackedPose, ...]
    covariance: FloatArray

    @property
    def best(self) -> TrackedPose:
        """The pose that agrees best."""
        return self.found[0]

    def of_frame_at(self, p_OQ: FloatArray) -> "TrackedPoses":
        """The poses of the frame Q at p_OQ, shape (3,), m, with O's axes."""
        _, covariance = move_measurement(self.best.X_CO, self.covariance, p_OQ)
        return TrackedPoses(tuple(fit.of_frame_at(p_OQ) for fit in self.found), covariance)


def track_poses(
    picture: DepthPicture, object_model: ObjectModel, before: TrackedPoses | None, model: DepthTrackerModel
) -> TrackedPoses | None:
    """Tracks the object; searches the whole picture if it was not known, or is not where it was.

    Args:
        picture: the depth image.
        object_model: the object.
        before: its poses in the previous picture, or None if nothing is known.
        model: how to fit.

    Returns:
        The poses, or None if the object is not found.
    """
    if has_far_origin(object_model):
        p_OM = object_model.middle
        at_middle = None if before is None else before.of_frame_at(p_OM)
        tracked = track_poses(picture, object_model.about_middle, at_middle, model)
        return None if tracked is None else tracked.of_frame_at(-p_OM)
    earlier = () if before is None else before.found
    fits = [fit_pose(picture, object_model, one.X_CO, one.covariance, model) for one in earlier]
    found = [fit for fit in fits if fit is not None] or find_poses(picture, object_model, model)
    return _alike(sorted(found, key=lambda fit: fit.disagreement), picture, object_model) if found else None


def _alike(found: list[TrackedPose], picture: DepthPicture, object_model: ObjectModel) -> TrackedPoses:
    """Those of the ranked fits that agree about as well as the best one, and differ from each other."""
    best = found[0]
    most = best.disagreement + _ALIKE * picture.camera.depth_noise * best.X_CO[2, 3] ** 2
    kept, moment = [best], best.covariance
    for fit in found[1:]:
        if fit.disagreement > most or len(kept) == _MOST:
            break
        if all(_are_apart(_ways(object_model, one, fit.X_CO[None])[0]) for one in kept):
            kept.append(fit)
            X_CO = retract(fit.X_CO, _SAMPLES @ np.linalg.cholesky(fit.covariance).T)
            ways = _ways(object_model, best, X_CO)
            moment = moment + ways.T @ ways / len(ways)
    return TrackedPoses(tuple(kept), moment / len(kept))


def _ways(object_model: ObjectModel, one: TrackedPose, X_CO: FloatArray) -> FloatArray:
    """Increments from a pose to the nearest symmetric image of each of others (n, 3, 4), shape (n, 6)."""
    images = compose(X_CO[:, None], object_model.symmetry_poses)
    turned = turn_toward(images.reshape(-1, 3, 4), one.X_CO, object_model.symmetries)
    ways = increments_between(one.X_CO, turned).reshape(*images.shape[:2], 6)
    nearest = np.argmin(np.linalg.norm(ways[..., :3], axis=2), axis=1)
    found: FloatArray = ways[np.arange(len(ways)), nearest]
    return found


def _are_apart(way: FloatArray) -> bool:
    return bool(np.any(np.linalg.norm(way.reshape(2, 3), axis=1) > _APART))
