"""The poses of an object that depth images leave open: found, followed, and stated as one pose and its covariance.

A fit knows its own neighbourhood alone. A mug whose handle is hidden fits as well with the handle elsewhere, or upside
down; whoever follows only one of these poses is sure of it, whichever it is. So those are followed that agree with the
picture about as well as the best one, and the covariance reaches as far as they do.
"""

from dataclasses import dataclass

import numpy as np

from tactopose_drake.core.poses import compose, increments_between
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.shape.free_spin import turn_toward
from tactopose_drake.core.validation import FloatArray
from tactopose_drake.core.vision.depth_detection import find_poses
from tactopose_drake.core.vision.depth_pictures import DepthPicture
from tactopose_drake.core.vision.depth_tracking import DepthTrackerModel, TrackedPose, fit_pose

_ALIKE = 0.5  # of a depth's standard deviation, by which a pose may agree less than the best one and stay
_APART = np.array([0.09, 0.005])  # rad and m, from which on two poses are not one and the same
# That are followed. Each is as likely as the best one for the covariance, in whose ellipsoid of 95 % it then lies.
_MOST = 9


@dataclass(frozen=True, eq=False)
class TrackedPoses:
    """Poses that agree with a picture about equally well.

    Attributes:
        found: the fits, the best first.
        covariance: of the best one's increment (w, v), v in C, that reaches as far as the others, shape (6, 6), rad and
            m.
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
    kept, spread = [best], np.zeros((6, 6))
    for fit in found[1:]:
        if fit.disagreement > most or len(kept) == _MOST:
            break
        if all(_are_apart(_way(object_model, one, fit)) for one in kept):
            kept.append(fit)
            way = _way(object_model, best, fit)
            spread += np.outer(way, way)
    return TrackedPoses(tuple(kept), best.covariance + spread / len(kept))


def _way(object_model: ObjectModel, one: TrackedPose, other: TrackedPose) -> FloatArray:
    """The increment from a pose to the nearest of those that look like another, shape (6,)."""
    images = compose(other.X_CO[None], object_model.symmetry_poses)
    ways = increments_between(one.X_CO, turn_toward(images, one.X_CO, object_model.symmetries))
    way: FloatArray = ways[np.argmin(np.linalg.norm(ways[:, :3], axis=1))]
    return way


def _are_apart(way: FloatArray) -> bool:
    return bool(np.any(np.linalg.norm(way.reshape(2, 3), axis=1) > _APART))
