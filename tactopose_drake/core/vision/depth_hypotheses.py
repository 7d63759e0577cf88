"""The poses of an object that depth images leave open: found, followed, and stated as one pose and its covariance.

A fit knows its own neighbourhood alone. A mug whose handle is hidden fits as well with the handle elsewhere, or upside
down; whoever follows only one of these poses is sure of it, whichever it is. So those are followed that agree with the
picture about as well as the best one, and the covariance reaches as far as they do.
"""

from dataclasses import dataclass

import numpy as np

from tactopose_drake.core.poses import compose, increments_between, retract
from tactopose_drake.core.shape.free_spin import turn_toward
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import FloatArray
from tactopose_drake.core.vision.depth_detection import find_poses
from tactopose_drake.core.vision.depth_pictures import DepthPicture
from tactopose_drake.core.vision.depth_tracking import DepthTrackerModel, TrackedPose, fit_pose

_ALIKE = 0.5  # of a depth's standard deviation, by which a pose may agree less than the best one and stay
_APART = np.array([0.09, 0.005])  # rad and m, from which on two poses are not one and the same
_MOST = 9  # that are followed, some of which may be lost: of a hidden handle's angles each stands for some
_SAMPLES = np.random.default_rng(0).normal(size=(64, 6))  # of each but the best, by which it counts


@dataclass(frozen=True, eq=False)
class TrackedPoses:
    """Poses that agree with a picture about equally well.

    Attributes:
        found: the fits, the best first.
        covariance: of the best one's increment (w, v), v in C, if each is as probable, shape (6, 6), rad and m: the
            second moment about the best one.
    """

    found: tuple[TrackedPose, ...]
    covariance: FloatArray

    @property
    def best(self) -> TrackedPose:
        """The pose that agrees best."""
        return self.found[0]


def track_poses(
    picture: DepthPicture, object_model: ObjectModel, before: TrackedPoses | None, model: DepthTrackerModel
) -> TrackedPoses | None:
    """Where the object is now; it is looked for in the whole picture where it was nowhere, or is not where it was.

    Args:
        picture: what is seen.
        object_model: the object.
        before: where it was in the picture before; None where nothing is known.
        model: how to fit.

    Returns:
        None where it is not found.
    """
    earlier = () if before is None else before.found
    fits = [fit_pose(picture, object_model, one.X_CO, one.covariance, model) for one in earlier]
    found = [fit for fit in fits if fit is not None] or find_poses(picture, object_model, model)
    return _alike(sorted(found, key=lambda fit: fit.disagreement), picture, object_model) if found else None


def _alike(found: list[TrackedPose], picture: DepthPicture, object_model: ObjectModel) -> TrackedPoses:
    """Those of the fits, the best first, that agree about as well as it does, and are not one and the same."""
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
    """The increments from a pose to the nearest of those that look like each of others (n, 3, 4), shape (n, 6)."""
    images = compose(X_CO[:, None], object_model.symmetry_poses)
    turned = turn_toward(images.reshape(-1, 3, 4), one.X_CO, object_model.symmetries)
    ways = increments_between(one.X_CO, turned).reshape(*images.shape[:2], 6)
    nearest = np.argmin(np.linalg.norm(ways[..., :3], axis=2), axis=1)
    found: FloatArray = ways[np.arange(len(ways)), nearest]
    return found


def _are_apart(way: FloatArray) -> bool:
    return bool(np.any(np.linalg.norm(way.reshape(2, 3), axis=1) > _APART))
