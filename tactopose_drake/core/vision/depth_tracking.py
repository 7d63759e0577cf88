"""A tracker of a known object in depth images: what it sees around fingers, and the pose that fits it best.

The points that are seen are fitted to the object's signed distance grid: point to plane [C92], without a search for the
nearest points. Where the fingers hide the object, nothing holds the fit but the pose before: the tracker's error is
that of real occlusion.

Sources: [C92] Y. Chen and G. Medioni, Object modelling by registration of multiple range images, Image and Vision
Computing, 1992; [K12] K. Khoshelham and S. Elberink, Accuracy and resolution of Kinect depth data, Sensors, 2012.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.poses import increments_between, retract, transform_points
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import FloatArray, positive_number
from tactopose_drake.core.vision.rasterizer import Camera, inverse_depths
from tactopose_drake.errors import InvalidInputError


@dataclasses.dataclass(kw_only=True, slots=True)
class DepthTrackerModel:
    """What the camera measures and how the tracker fits."""

    width: int = 240  # of the image, pixels
    height: int = 180  # pixels
    focal_length: float = 200.0  # pixels
    # Standard deviation of a depth z is this times z^2, 1/m; 1.43e-3 is the Kinect's [K12]. It is the same all over a
    # patch of pixels for another share of its variance, which no averaging over the object takes away.
    depth_noise: float = 1.43e-3
    common_share: float = 0.3
    # Whether the fingers' own pixels are known from the joints and left out. If not, whatever is near the object counts
    # as the object.
    knows_hand: bool = True
    gate: float = 0.03  # farthest from where the object was expected that a pixel counts, m
    least_pixels: int = 60  # of the object
    most_hidden: float = 0.8  # share of the object's pixels that may be hidden
    sigma_translation: float = 0.05  # motion between frames, m: standard deviation along each axis
    sigma_rotation_deg: float = 15.0  # likewise about each axis
    # Distance beyond which points count less, at the first step of the fit, m. It shrinks by a factor from step to
    # step, and for the last steps it is three sigma.
    first_width: float = 0.03
    width_factor: float = 0.6
    narrowing_steps: int = 8
    last_steps: int = 8

    def validate(self) -> None:
        """Raises InvalidInputError if a value is out of its range."""
        for field in dataclasses.fields(self):
            if field.name != "knows_hand":
                zero = field.name in ("depth_noise", "common_share")
                positive_number(f"DepthTrackerModel.{field.name}", getattr(self, field.name), allow_zero=zero)
        for name in ("common_share", "most_hidden", "width_factor"):
            if getattr(self, name) > 1.0:
                raise InvalidInputError(f"DepthTrackerModel.{name}: is {getattr(self, name):g}; allowed is up to 1.")

    @property
    def widths(self) -> list[float]:
        """Distances beyond which points count less, step by step, m; 0 where it is three sigma."""
        narrowing = [self.first_width * self.width_factor**k for k in range(self.narrowing_steps)]
        return [*narrowing, *(self.last_steps * [0.0])]

    @property
    def information(self) -> FloatArray:
        """The inverse covariance of the motion between frames, shape (6, 6)."""
        sigma = np.repeat([math.radians(self.sigma_rotation_deg), self.sigma_translation], 3)
        return np.diag(sigma**-2)


@dataclass(frozen=True, eq=False)
class DepthPicture:
    """What a depth camera sees of object and hand.

    Attributes:
        p_CQ: points on what is seen, in the camera's frame, shape (n, 3), m.
        on_hand: which of them are the hand's, as rendered from its joints, shape (n,).
        hidden_share: of the object's pixels, 0 to 1.
    """

    p_CQ: FloatArray
    on_hand: NDArray[np.bool_]
    hidden_share: float


@dataclass(frozen=True, eq=False)
class TrackedPose:
    """The pose that fits a picture best.

    Attributes:
        X_CO: shape (3, 4).
        covariance: of the increment (w, v), v in C, shape (6, 6), rad and m.
        residual: root mean square of the points' distances from the surface, m.
        points: how many were fitted.
    """

    X_CO: FloatArray
    covariance: FloatArray
    residual: float
    points: int


def take_picture(
    object_vertices: FloatArray,
    object_faces: NDArray[np.int32],
    hand_vertices: FloatArray,
    hand_faces: NDArray[np.int32],
    model: DepthTrackerModel,
    generator: np.random.Generator,
) -> DepthPicture:
    """Renders the depth of object and hand, and adds noise.

    Args:
        object_vertices: in the camera's frame C, z forward, shape (v, 3), m.
        object_faces: vertex indices, shape (f, 3).
        hand_vertices: likewise.
        hand_faces: likewise.
        model: camera and noise.
        generator: of the noise.
    """
    camera = Camera(np.eye(3, 4), model.focal_length, model.width, model.height)
    of_object = inverse_depths(object_vertices, object_faces, camera)
    of_hand = inverse_depths(hand_vertices, hand_faces, camera)
    whole, hidden = of_object > 0.0, (of_object > 0.0) & (of_hand > of_object)
    seen = np.maximum(of_object, of_hand)
    row, column = np.nonzero(seen)
    depth = 1.0 / seen[row, column].astype(np.float64)
    sigma = model.depth_noise * depth**2
    common, single = math.sqrt(model.common_share), math.sqrt(1.0 - model.common_share)
    # Errors in common: a random plane over the image.
    slope = generator.normal(size=3) @ np.array(
        [np.ones(len(row)), (row + 0.5) / model.height - 0.5, (column + 0.5) / model.width - 0.5]
    )
    depth = depth + sigma * (single * generator.normal(size=len(row)) + common * slope)
    rays = np.column_stack(
        [column + 0.5 - 0.5 * model.width, row + 0.5 - 0.5 * model.height, np.full(len(row), model.focal_length)]
    )
    share = float(hidden.sum() / whole.sum()) if whole.any() else 1.0
    return DepthPicture(rays * (depth / model.focal_length)[:, None], (of_hand > of_object)[row, column], share)


def fit_pose(
    picture: DepthPicture, object_model: ObjectModel, X_CO: FloatArray, model: DepthTrackerModel
) -> TrackedPose | None:
    """The pose of the object that explains the points; None where too few are seen.

    Args:
        picture: what is seen.
        object_model: the object.
        X_CO: where it was before, shape (3, 4).
        model: how to fit.
    """
    if picture.hidden_share > model.most_hidden:
        return None
    points = picture.p_CQ[~picture.on_hand] if model.knows_hand else picture.p_CQ
    if len(points) < model.least_pixels:
        return None
    pose = X_CO
    if model.knows_hand:  # all that is left is the object: it has moved by about as much as its points have
        facing = _facing_points(object_model, X_CO)
        shift = points.mean(axis=0) - facing.mean(axis=0) if len(facing) else np.zeros(3)
        pose = retract(X_CO[None], np.concatenate([np.zeros(3), shift])[None])[0]
    expected, information = pose, model.information
    sigma = np.maximum(model.depth_noise * points[:, 2] ** 2, 1e-4)
    for width in model.widths:
        gate = model.gate * max(1.0, width / (model.first_width * model.width_factor**2))
        distance, J, near = _residuals(points, object_model, pose, gate)
        if near.sum() < model.least_pixels:
            return None
        weight = near / (sigma**2 * (1.0 + (distance / np.maximum(3.0 * sigma, width)) ** 2))  # Cauchy's
        offset = increments_between(expected[None], pose[None])[0]
        hessian = (J * weight[:, None]).T @ J + information
        step = -np.linalg.solve(hessian, J.T @ (weight * distance) + information @ offset)
        pose = retract(pose[None], step[None])[0]
        if np.abs(step[:3]).max() < 1e-5 and np.abs(step[3:]).max() < 1e-6 and width == 0.0:
            break
    distance, J, near = _residuals(points, object_model, pose, model.gate)
    if near.sum() < model.least_pixels:
        return None
    residual = float(np.sqrt(np.mean(distance[near] ** 2)))
    # What is common to all points does not average out; nor does whatever makes the points fit worse than their noise.
    scale = np.maximum(sigma, residual)[near]
    independent = (J[near] / scale[:, None]).T @ (J[near] / scale[:, None])
    effective = independent / (1.0 + model.common_share * near.sum())
    covariance = np.linalg.inv(effective + information)
    return TrackedPose(pose, 0.5 * (covariance + covariance.T), residual, int(near.sum()))


def _residuals(
    points: FloatArray, object_model: ObjectModel, X_CO: FloatArray, gate: float
) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
    """Signed distances (n,), m, their derivatives by the increment (n, 6), and which points count (n,)."""
    R_CO = X_CO[:, :3]
    p_OQ = (points - X_CO[:, 3]) @ R_CO
    distance, n_O = object_model.grid.distance_and_normal(p_OQ)
    J = -np.concatenate([np.cross(p_OQ, n_O), n_O @ R_CO.T], axis=1)
    return distance, J, np.abs(distance) < gate


def _facing_points(object_model: ObjectModel, X_CO: FloatArray) -> FloatArray:
    """Points of the surface that face the camera, in C, shape (k, 3), m."""
    p_CQ = transform_points(X_CO[None], object_model.samples.points)[0]
    n_CQ = object_model.samples.normals @ X_CO[:, :3].T
    facing: FloatArray = p_CQ[np.einsum("ni,ni->n", p_CQ, n_CQ) < 0.0]
    return facing
