"""Tracks a known object in depth images: finds the pose that best fits what is seen around the fingers.

The points are fitted to the object's signed distance grid: point-to-plane registration [C92] without a search for
nearest points. Where fingers hide the object, only the previous pose constrains the fit: the tracker's error is that of
real occlusion.

Sources: [C92] Y. Chen and G. Medioni, Object modelling by registration of multiple range images, Image and Vision
Computing, 1992.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from tactopose_drake.core.parameter_checks import check_numbers
from tactopose_drake.core.poses import increments_between, retract
from tactopose_drake.core.posterior.moved_origin import has_far_origin, move_measurement
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import FloatArray, flag
from tactopose_drake.core.vision.depth_pictures import DepthPicture, expected_picture, fit_to_picture

_REACH = 0.05  # distance beyond the object's size from its expected place up to which a point may be its own, m
_LEAST_SIGMA = 1e-4  # least standard deviation of a point, m
_EXPLAINED = 0.005  # distance from the surface up to which a point is explained by it, m
_TURNED = 1.8  # standard deviation about each axis of an object of unknown orientation, rad
_SPIN = 0.02  # standard deviation about an axis of continuous symmetry, where all angles are equivalent, rad


@dataclass(kw_only=True, slots=True)
class DepthTrackerModel:
    """Parameters of the tracker's fit."""

    # Whether the hand's own pixels are known from the joints and left out. If not, everything that is seen is fitted,
    # and the covariance includes that the object may be where points are unexplained.
    knows_hand: bool = True
    gate: float = 0.03  # distance from the object's expected surface up to which a point counts, m
    least_pixels: int = 60  # least number of the object's pixels
    most_hidden: float = 0.8  # largest share of the object's pixels that may be hidden
    most_seen_through: float = 0.5  # largest share of the others that may see something farther, before it is lost
    sigma_translation: float = 0.05  # standard deviation of the motion between frames along each axis, m
    sigma_rotation_deg: float = 15.0  # standard deviation of the rotation between frames about each axis, deg
    first_width: float = 0.03  # width of the robust loss at the first step of the fit, m
    width_factor: float = 0.6  # factor by which this width shrinks from step to step
    narrowing_steps: int = 8  # number of steps in which it shrinks
    last_steps: int = 8  # number of steps at the end, in which it is three sigma

    def validate(self) -> None:
        """Raises InvalidInputError if a value is out of its range."""
        flag("DepthTrackerModel.knows_hand", self.knows_hand)
        shares = dict.fromkeys(("most_hidden", "most_seen_through", "width_factor"), 1.0)
        check_numbers("DepthTrackerModel", self, most=shares)

    @property
    def widths(self) -> list[float]:
        """Widths of the robust loss, step by step, m; 0 stands for three sigma."""
        narrowing = [self.first_width * self.width_factor**k for k in range(self.narrowing_steps)]
        return [*narrowing, *(self.last_steps * [0.0])]

    @property
    def motion(self) -> FloatArray:
        """The covariance of the motion between frames, shape (6, 6)."""
        return np.diag(np.repeat([math.radians(self.sigma_rotation_deg), self.sigma_translation], 3) ** 2)


@dataclass(frozen=True, eq=False)
class TrackedPose:
    """The pose that best fits a picture.

    Attributes:
        X_CO: shape (3, 4).
        covariance: of the increment (w, v), v in C, shape (6, 6), rad and m.
        residual: rms distance of the points from the surface, m.
        points: number of points fitted.
        hidden_share: share of the object's pixels at this pose at which something nearer is seen, 0 to 1.
        disagreement: of picture and object at this pose, m, see `PictureFit`.
    """

    X_CO: FloatArray
    covariance: FloatArray
    residual: float
    points: int
    hidden_share: float
    disagreement: float

    def of_frame_at(self, p_OQ: FloatArray) -> "TrackedPose":
        """The pose of the frame Q at p_OQ, shape (3,), m, with O's axes."""
        X_CQ, covariance = move_measurement(self.X_CO, self.covariance, p_OQ)
        return replace(self, X_CO=X_CQ, covariance=covariance)


def fit_pose(
    picture: DepthPicture,
    object_model: ObjectModel,
    X_CO: FloatArray,
    covariance: FloatArray,
    model: DepthTrackerModel,
) -> TrackedPose | None:
    """Fits the object's pose to the points; None if too few are seen, or the object is seen through.

    If the origin of O is far from the object, the motion between frames is that of the object's middle.

    Args:
        picture: the depth image.
        object_model: the object.
        X_CO: its previous pose, shape (3, 4).
        covariance: of the increment (w, v) from it, v in C, shape (6, 6), rad and m.
        model: how to fit.
    """
    if has_far_origin(object_model):
        p_OM = object_model.middle
        at_middle = move_measurement(X_CO, covariance, p_OM)
        fit = fit_pose(picture, object_model.about_middle, *at_middle, model)
        return None if fit is None else fit.of_frame_at(-p_OM)
    points = _points_about(picture, object_model, X_CO, model)
    if len(points) < model.least_pixels:
        return None
    pose = _moved_with(points, picture, object_model, X_CO) if model.knows_hand else X_CO
    found = _least_squares(points, picture, object_model, pose, model)
    if found is None:
        return None
    distance, J = residuals(points, object_model, found)
    near = np.abs(distance) < model.gate
    agreement = fit_to_picture(picture, object_model, found)
    if (
        near.sum() < model.least_pixels
        or agreement.hidden_share > model.most_hidden
        or agreement.seen_through > model.most_seen_through
    ):
        return None
    residual = float(np.sqrt(np.mean(distance[near] ** 2)))
    # Common errors do not average out; nor do those that make the fit worse than the points' noise, including what is
    # seen beside and through the object.
    scale = np.maximum(sigmas(points, picture), max(residual, agreement.misfit))[near]
    independent = (J[near] / scale[:, None]).T @ (J[near] / scale[:, None])
    effective = independent / (1.0 + picture.camera.common_share * near.sum())
    posterior = np.linalg.inv(effective + np.linalg.inv(covariance + model.motion) + _spin_information(object_model))
    if not model.knows_hand:
        posterior = posterior + _elsewhere(points, distance)
    covariance = 0.5 * (posterior + posterior.T)
    return TrackedPose(found, covariance, residual, int(near.sum()), agreement.hidden_share, agreement.disagreement)


def sigmas(points: FloatArray, picture: DepthPicture) -> FloatArray:
    """Standard deviations of points in C (n, 3) from the camera's noise, shape (n,), m."""
    sigma: FloatArray = np.maximum(picture.camera.depth_noise * points[:, 2] ** 2, _LEAST_SIGMA)
    return sigma


def residuals(points: FloatArray, object_model: ObjectModel, X_CO: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Distances (..., n), m, of points (n, 3) from an object at poses (..., 3, 4); their derivatives, (..., n, 6)."""
    R_CO = X_CO[..., :3]
    p_OQ = (points - X_CO[..., None, :, 3]) @ R_CO
    distance, n_O = object_model.grid.distance_and_normal(p_OQ)
    return distance, -np.concatenate([np.cross(p_OQ, n_O), n_O @ np.swapaxes(R_CO, -1, -2)], axis=-1)


def _points_about(
    picture: DepthPicture, object_model: ObjectModel, X_CO: FloatArray, model: DepthTrackerModel
) -> FloatArray:
    """The points that may belong to the object, as far as can be told in advance."""
    points = picture.points(without_hand=model.knows_hand)
    middle = X_CO[:, :3] @ object_model.vertices.mean(axis=0) + X_CO[:, 3]
    chosen: FloatArray = points[np.linalg.norm(points - middle, axis=1) < 0.5 * object_model.size + _REACH]
    return chosen


def _moved_with(points: FloatArray, picture: DepthPicture, object_model: ObjectModel, X_CO: FloatArray) -> FloatArray:
    """Shifts the pose by the displacement of the points' centroid, as all of them are assumed to be the object's."""
    expected = expected_picture(object_model, X_CO, picture).points(without_hand=True)
    shift = points.mean(axis=0) - expected.mean(axis=0) if len(expected) else np.zeros(3)
    return retract(X_CO, np.concatenate([np.zeros(3), shift]))


def _elsewhere(points: FloatArray, distance: FloatArray) -> FloatArray:
    """The covariance (6, 6) to add, as points that the pose does not explain may be the object instead.

    If the hand cannot be told from the object, the probability of that is their share.
    """
    share = float(np.mean(np.abs(distance) > _EXPLAINED))
    return share * np.diag([_TURNED**2] * 3 + [float(np.var(points, axis=0).max())] * 3)


def _spin_information(object_model: ObjectModel) -> FloatArray:
    """Information on the angles about the object's axes of continuous symmetry, which fixes them, shape (6, 6)."""
    axes = np.array([symmetry.axis for symmetry in object_model.continuous_symmetries]).reshape(-1, 3)
    information = np.zeros((6, 6))
    information[:3, :3] = axes.T @ axes / _SPIN**2
    return information


def _least_squares(
    points: FloatArray,
    picture: DepthPicture,
    object_model: ObjectModel,
    expected: FloatArray,
    model: DepthTrackerModel,
) -> FloatArray | None:
    """The pose near the expected one that best fits the points, by iteratively reweighted least squares."""
    pose, information, sigma = expected, np.linalg.inv(model.motion), sigmas(points, picture)
    for width in model.widths:
        gate = model.gate * max(1.0, width / (model.first_width * model.width_factor**2))
        distance, J = residuals(points, object_model, pose)
        near = np.abs(distance) < gate
        if near.sum() < model.least_pixels:
            return None
        weight = near / (sigma**2 * (1.0 + (distance / np.maximum(3.0 * sigma, width)) ** 2))  # Cauchy's
        offset = increments_between(expected, pose)
        hessian = (J * weight[:, None]).T @ J + information
        step = -np.linalg.solve(hessian, J.T @ (weight * distance) + information @ offset)
        pose = retract(pose, np.asarray(step, dtype=np.float64))
        if np.abs(step[:3]).max() < 1e-5 and np.abs(step[3:]).max() < 1e-6 and width == 0.0:
            break
    return pose
